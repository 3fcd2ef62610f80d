// What stays the same from frame to frame in the dark: shading and DSNU; defect pixels.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/pixel_location.h"
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

/// dsnu_dn and its standard error, that of a sensor's DSNU of which these pixels are a sample, into
/// `out`, whose bias_frames, row and column noise and temporal noise are known. mean_frame: its
/// ordinary pixels; temporal_variance_dn2: of the pixels that count.
void measure_dsnu(const OrdinaryPixels& mean_frame,
                  const std::vector<double>& temporal_variance_dn2, const MosaicGeometry& geometry,
                  PhysicsCalibration& out);

/// Read noise of a channel's ordinary pixels, to judge the others by.
struct ReadTail {
  double lambda = 0.14, scale_dn = 0;
};

/// Dark frames of one gain, to judge pixels by.
struct DarkPixels {
  View<const float> shading_dn, sum_of_squares;
  int frames = 0;
  std::vector<ReadTail> tails;    ///< per channel
  std::vector<double> constancy;  ///< per channel: EqualValues::chance_of_constancy
  double step_dn = 0;             ///< of the codes; 0: there are none
};

/// Pixels that stand out by more than kDefectDeviations robust deviations: "hot" in the dark
/// shading, "noisy" in temporal variance (and above four times the channel's), "stuck" with less
/// than a fiftieth of it over 20 frames or more, "dead" with less than half of the response.
/// Of heavy tails a single value can make a pixel hot or noisy: such pixels must be farther out
/// than is likely anywhere among the channel's. Of noise narrower than a code pixels are constant
/// by chance, others jump by a code, and most show no deviation: where constancy is likely, none is
/// stuck, and what rounding alone can do makes none hot or noisy. A pixel that follows the light is
/// not stuck.
/// response may be empty. The list is in the order of the channels, rows and columns of each, and
/// ends at kMostDefects.
inline constexpr std::size_t kMostDefects = 100000;
std::vector<DefectPixel> find_defects(const DarkPixels& dark, View<const float> response,
                                      const MosaicGeometry& geometry);

/// What the listed pixels add to the temporal variance of dark.sum_of_squares, mean over the
/// channel's pixels; DN² per channel. Contract: at least two frames.
std::vector<double> temporal_excess_dn2(const DarkPixels& dark,
                                        const std::vector<DefectPixel>& defects,
                                        const MosaicGeometry& geometry);

}  // namespace malus
