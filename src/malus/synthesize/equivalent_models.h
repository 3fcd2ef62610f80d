// What calibrating a camera with known physics noise would find with ever more frames: its
// heteroscedastic Gaussian and its non-parametric model. They stand in for measured ones where
// experiments compare kinds of models (001), and give noise on noise its Gaussian variant.
#pragma once

#include "malus/noise/model.h"
#include "malus/synthesize/compiled.h"

#include <vector>

namespace malus {

/// One Gaussian per level with the physics noise's variance: slope K, offset with read noise, rows
/// and quantisation; bias mu.
GaussianCalibration gaussian_equivalent(const PhysicsNoise& noise, const GainSetting& gain);

/// The distribution of noisy - clean at `levels` signals, closer together in the dark, up to
/// white_dn (above black), on bins of about a quarter of the dark noise's deviation, but no more
/// than kMostEquivalentBins. Row noise apart, quantisation in it. Each level's distribution is
/// exact to 1e-5.
NonparametricCalibration nonparametric_equivalent(const PhysicsNoise& noise,
                                                  const GainSetting& gain, double white_dn,
                                                  int levels = 48);
inline constexpr int kMostEquivalentBins = 2048;

/// The model with both kinds at these gains where it has a physics part and lacks them. Throws
/// InputError on gains that its physics does not know.
NoiseModel with_equivalents(NoiseModel model, const std::vector<GainSetting>& gains);

/// A model's Gaussian at a gain: calibrated, else its physics part's equivalent. Throws InputError
/// where there is neither.
GaussianCalibration gaussian_of(const NoiseModel& model, const GainSetting& gain);

/// Noise on noise (renoise.h) between two heteroscedastic Gaussians: the Gaussian of the variances'
/// difference, never less than none, at the level of the clean signal that it is applied to. The
/// result is rounded by the camera, which the target's variance already holds: quantization_dn.
CompiledNoise gaussian_difference(const SensorLayout& layout, const GaussianCalibration& from,
                                  const GaussianCalibration& to, double quantization_dn);
/// Of physics noise at two gains of one sensor: row noise stays noise of rows.
CompiledNoise gaussian_difference(const PhysicsNoise& from, const PhysicsNoise& to);

/// A frame of the target gain: noisy + a draw of the difference at the guide's signal, at
/// second_noise(address) (renoise.h). All DN above black and of one size.
Image gaussian_on_noise(const CompiledNoise& difference, View<const float> noisy_dn,
                        View<const float> guide_dn, const DrawAddress& address);

}  // namespace malus
