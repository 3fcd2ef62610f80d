// Shape λ and scale σ_TL of read noise in the model, from the residuals of all bias frames
// (000, 3.2).
#pragma once

#include "malus/calibrate/internal/cut_off_noise.h"
#include "malus/calibrate/internal/frame_components.h"
#include "malus/calibrate/internal/residual_histogram.h"
#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Cells of a residual histogram per deviation.
inline constexpr double kCellsPerDeviation = 24.0;

/// Width of the cells for residuals of this deviation: they divide the converter's step, or are a
/// whole number of steps wide. Where no fixed pattern spreads the offsets, residuals lie on a
/// lattice: beside cells of any other width it makes a moiré that looks like another shape (λ by up
/// to 0.005), and differs between sessions. step_dn: 0: none.
double residual_cell_dn(double deviation_dn, double step_dn);

struct ShapeInput {
  const std::vector<std::vector<ResidualHistogram>>& residuals;  ///< [frame][channel]
  std::vector<double> pixel_variance_dn2;                        ///< per channel, rounding and all
  const FrameAnalyzer& analyzer;                                 ///< that made the residuals
  const std::vector<HiddenNoise>& hidden;                        ///< per channel; may be empty
  const std::vector<CutOffNoise>& cut_off;                       ///< per channel; may be empty
  double quantization_dn = 0, kept = 1;  ///< kept: share of a variance left in the residuals
  bool ppcc = false;                     ///< the papers' estimator
};

/// Fills sigma_tl, lambda, residual_cell_dn and residual_counts of `out` and appends warnings. A
/// shape that the residuals do not tell is nearly normal, with their variance. Noise that the
/// converter's step hides is normal with the variance of `hidden` less the row noise of `out`, or
/// at the standard's limit where that is not known either; 0 where no pixel changes its code. Of
/// noise that a law tells (CutOffNoise::by_law) the shape is the law's.
void measure_shapes(const ShapeInput& in, const SensorLayout& layout, PhysicsCalibration& out);

/// The law that is likeliest promises more variance than dark frames have where their noise is of
/// no Tukey-lambda law, or pixels that jump pull at λ. If it is 2 % more, and more than so many
/// values of the law lack by chance (five errors of a sample variance), σ_TL becomes that of the
/// frames' variance. Frames that have more than the law may owe it to a few pixels that jump: the
/// law stays as it is, and what σ_TL would be by three chance errors or more is in its standard
/// error. Nothing is done for noise below 0.75 steps, cut off, or of unknown shape. Reads
/// lambda, sigma_row, residual_counts, bias_frames and temporal_sd_dark (without defects), changes
/// sigma_tl.
void keep_dark_variance(double quantization_dn, PhysicsCalibration& out);

}  // namespace malus
