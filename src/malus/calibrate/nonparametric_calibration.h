// The non-parametric model of one gain: distributions of noisy - clean at many signal levels, row
// noise kept apart (001, S1-S2).
#pragma once

#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/clean_frame.h"
#include "malus/calibrate/level_histograms.h"

#include <optional>
#include <vector>

namespace malus {

/// The same noise twice: as distributions to draw from, and as plain variances to fit a line to.
struct MeasuredLevels {
  NonparametricCalibration distributions;
  /// [channel][level]: rounding included, row noise taken off. No level borrows samples, nothing is
  /// binned; dark codes are not among them.
  std::vector<std::vector<LevelNoise>> noise;
  /// σ_b² per channel as measured, below zero where there is none, and its standard error.
  std::vector<double> row_variance_dn2, row_variance_stderr_dn2;
  std::vector<double> bias_dn;  ///< of dark pixels above black, where physics told it; else 0
};

/// One gain's frames. first: of the first source; tells the format of all, and the codes' lattice.
struct LevelFrames {
  std::vector<NoiseSource> sources;
  RawFrame first;
};

/// Clean is the mean of the frames themselves, averaged with the reference where there is one
/// (measure_clean): the fixed pattern is not noise. Row-group means of noisy - clean are taken off
/// first: row noise is in sigma_row. The channel's dark bias stays in, as the distributions' mean.
/// Integer bias frames make the dark level code by code, fixed pattern included, with row noise
/// deconvolved: unequal steps of the converter stay visible. physics: the same gain's bias results,
/// for the dark level, row noise and K; null: the black level is dark and row noise comes from the
/// darkest source. Two passes over each source. Throws InputError when fewer than two levels of a
/// channel have enough samples.
MeasuredLevels measure_levels(const LevelFrames& frames, const PhysicsCalibration* physics,
                              int row_group, const CalibrationSettings& settings,
                              Progress& progress);

}  // namespace malus
