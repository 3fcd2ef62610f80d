// What every denoiser, classical or network, does before and after its filter: black and bias
// subtracted, pixels that are not numbers filled, row and column noise removed; and the default
// filter for frames that are prepared already.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/denoise/saturated_pixels.h"
#include "malus/noise/stabilize.h"

#include <string>
#include <vector>

namespace malus {

/// An input pixel that holds no light (light_range), to be put back.
struct NonfinitePixel {
  int row, col;
  float value;  ///< above black
};
/// In the frame's order.
inline bool precedes(const NonfinitePixel& a, const NonfinitePixel& b) {
  return a.row != b.row ? a.row < b.row : a.col < b.col;
}

/// A defect pixel, or an impulse (impulses.h), that was filled from its neighbours.
struct FilledPixel {
  int row, col;
  /// How far they contradict each other beyond their noise [DN²]; NaN where they cannot tell.
  float variance_dn2;
};

struct PreparedFrame {
  /// Above black and bias, every pixel finite. Row and column noise and the model's pattern are
  /// removed, but from noiseless areas, which have none.
  Image dn;
  SensorLayout layout;
  std::string source;                     ///< that of the frame
  double range_dn = 0;                    ///< white above the highest black level
  double highest_dn = 0;                  ///< white above the lowest black level
  SaturatedPixels saturated;              ///< as bright as white or brighter
  std::vector<float> saturated_dn;        ///< per channel: white, as dn
  std::vector<NonfinitePixel> nonfinite;  ///< in the frame's order
  std::vector<bool> is_noiseless;         ///< noiseless_areas
  std::vector<FilledPixel> filled;
  /// Per row group: variance of what is left of its offset, in units of the channels' sigma_row².
  std::vector<double> row_variance;
  std::vector<double> column_variance;  ///< the same per column, of sigma_column²
  std::vector<double> mean_dn;          ///< per channel
};

/// Throws InputError on a frame without pixels.
void require_pixels(const RawFrame& frame);

/// Throws InputError on a frame without pixels or with another layout than the profile's, as
/// require_levels (image/black_levels.h), and on a white that is not above black or beyond all that
/// cameras count.
void check_frame(const RawFrame& frame, const NoiseProfile& profile);

/// What is done to a frame besides the profile's bias and stabilisation.
struct PreparationSteps {
  bool remove_rows = true, remove_columns = true, fill_defects = true, fill_impulses = true,
       remove_pattern = true;
  bool compare_noise = true;  ///< the profile's against the frame's own (noise_check.h)
};

/// Fills the report's fields about the input. Contract: check_frame has passed.
PreparedFrame prepare_frame(RawFrame frame, const NoiseProfile& profile, PreparationSteps steps,
                            Denoised& report);

/// One per channel; strength multiplies the deviation.
std::vector<Stabilizer> make_stabilizers(const NoiseProfile& profile, double highest_dn,
                                         double strength);

/// The mosaic filter of settings.method, which is on_mosaic: fills dn_above_black and tiles
/// of the result, and variance_dn2 where the result holds one of the frame's size. InputError and
/// Cancelled as denoise_frame.
void filter_prepared(const PreparedFrame& frame, const NoiseProfile& profile,
                     const DenoiseSettings& settings, Progress& progress, Denoised& result);

/// Measures the result's means and puts the pixels that are not numbers back.
void complete_result(const PreparedFrame& frame, Denoised& result);

}  // namespace malus
