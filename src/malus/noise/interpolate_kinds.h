// Gaussian and non-parametric calibrations between two measured gains; the physics kind has its
// joint model (joint_gain.h).
#pragma once

#include "malus/noise/calibration.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Slope, offset and K go geometrically with the gain in dB where both ends are positive, else
/// linearly; bias_dn goes linearly in the slope. Contract: low, gain and high rise.
GaussianCalibration interpolated(const GaussianCalibration& low, const GaussianCalibration& high,
                                 const GainSetting& gain);

/// Quantile functions at equal probability: Q = (1-t) Q_low + t Q_high per level, with t such that
/// the standard deviation goes geometrically with the gain in dB, as noise does. Levels are those
/// of both gains inside the range they share; between a gain's levels its distributions are mixed
/// by the fractional distance, as when sampling. Bin edges are mixed like the quantiles of the
/// darkest level, which bins are finest for. samples holds the smaller count.
NonparametricCalibration interpolated(const NonparametricCalibration& low,
                                      const NonparametricCalibration& high,
                                      const GainSetting& gain);

/// Indices i such that calibrations i and i+1 lie on different conversion gains, judged by the
/// calibrations alone (joint_gain.h, conversion_gain_breaks). Where a non-parametric one lacks K,
/// that of all counts as the gain setting tells it.
std::vector<int> conversion_gain_breaks(const std::vector<GaussianCalibration>& calibrations);
std::vector<int> conversion_gain_breaks(const std::vector<NonparametricCalibration>& calibrations);

/// A gain that they serve, by (seed, frame): uniform in dB between the measured gains, but not
/// between two conversion gains; one of them where none are joined. Contract: there are some.
GainSetting random_gain(const std::vector<GaussianCalibration>& calibrations, std::uint64_t seed,
                        std::uint32_t frame);
GainSetting random_gain(const std::vector<NonparametricCalibration>& calibrations,
                        std::uint64_t seed, std::uint32_t frame);

}  // namespace malus
