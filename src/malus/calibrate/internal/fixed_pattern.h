// What stays the same from frame to frame in the dark: shading and DSNU.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/pixel_location.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Spatial variance of each channel about its mean, DN².
std::vector<double> channel_variances(View<const float> mosaic, const MosaicGeometry& geometry);

/// Mean and spatial variance per channel of the pixels that are no defects: those within
/// kDefectDeviations robust deviations of the channel's median. A few hot pixels would lift a plain
/// mean, and with it the bias that is taken off every other pixel. quantization_dn: step of a
/// mosaic that is a single frame, where most pixels may have one value and hide a deviation of 0.74
/// steps. listed: further pixels to leave out, in the order of find_defects. squares_dn2: sums of
/// squares over the frames, whose mean is to be of the same pixels: of heavy tails one value moves
/// a pixel's mean, which is left out then, and what is taken off for sampling must not hold it
/// either.
struct OrdinaryPixels {
  std::vector<double> mean_dn, variance_dn2;
  std::vector<double> variance_stderr_dn2;  ///< of pixels that are independent
  std::vector<double> squares_dn2;  ///< mean of the other mosaic over the same pixels; may be empty
  /// Of that variance, what whole rows and whole columns have in common, with what is left there of
  /// temporal row and column noise.
  std::vector<double> row_variance_dn2, column_variance_dn2;
  std::vector<double> within_groups_dn2;  ///< about the means of their row groups
};
OrdinaryPixels ordinary_pixels(View<const float> mosaic, double quantization_dn,
                               const MosaicGeometry& geometry,
                               const std::vector<DefectPixel>& listed = {},
                               View<const float> squares_dn2 = {});

/// Temporal variance of those pixels, whose squares are known, from this many frames (2 or more).
std::vector<double> temporal_of(const OrdinaryPixels& ordinary, int frames);

/// Mosaic minus one level per channel, in place.
void subtract_levels(Image& mosaic_dn, const std::vector<double>& level_dn,
                     const MosaicGeometry& geometry);

/// Sd of the fixed pattern: spatial variance of the mean frame minus temporal variance / frames; 0
/// where sampling explains all of it.
std::vector<double> dsnu_dn(std::vector<double> spatial_variance_dn2,
                            const std::vector<double>& temporal_variance_dn2, int frames);

/// Sampling variance that rows and columns of these variances add to the spatial variance of a
/// channel's pixels: there are fewer of them than of pixels.
double line_error_dn4(double row_dn2, double column_dn2, const MosaicGeometry& geometry,
                      int channel, const RowDrift& drift);

/// dsnu_dn and its standard error, that of a sensor's DSNU of which these pixels, rows and columns
/// are a sample, into `out`, whose bias_frames, row and column noise and temporal noise are known.
/// mean_frame: its ordinary pixels; temporal_variance_dn2: of the pixels that count.
void measure_dsnu(const OrdinaryPixels& mean_frame,
                  const std::vector<double>& temporal_variance_dn2, const MosaicGeometry& geometry,
                  PhysicsCalibration& out);

/// Sampling variance [DN²] of each channel's mean dark level as the bias of all such pixels: a
/// frame has few pixels, fewer rows and columns, and a fixed pattern of each. `bias`: as
/// measure_dsnu leaves it.
std::vector<double> pattern_error_of_mean(const OrdinaryPixels& mean_frame,
                                          const MosaicGeometry& geometry,
                                          const PhysicsCalibration& bias);

}  // namespace malus
