// What one frame tells about itself, per channel: for `malus info` and for sanity checks.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/raw_frame.h"

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace malus {

struct ChannelSummary {
  double mean_dn = 0;  ///< of the finite pixels, black included; NaN without any
  double minimum_dn = 0, maximum_dn = 0;
  double saturated_share = 0;    ///< pixels at or above white
  double below_black_share = 0;  ///< pixels below the black level
  std::int64_t pixels = 0, nonfinite = 0;
  /// Standard deviation of the noise [DN], see noise_guess; Undecided on too few pixels.
  Estimate<double> noise_dn = Undecided{"not measured"};
  /// Mean of the pixels that it was measured on, black included: a scene's flatter half may be
  /// brighter or darker than its mean. NaN where undecided.
  double noise_at_dn = std::numeric_limits<double>::quiet_NaN();
};

/// Per channel, mean of the finite pixels, black included; NaN without any.
std::vector<double> finite_means_dn(const RawFrame& frame);

/// One per channel of the layout.
std::vector<ChannelSummary> summarize(const RawFrame& frame);

/// Share of the finite pixels that lie above white by over a tenth of the range, where that is more
/// than the hot pixels of a sensor (a thousandth): then the white level is wrong. Else 0.
double share_beyond_white(const RawFrame& frame);

/// What is wrong with the declared black and white levels, in one sentence; empty where the pixels
/// agree with them: share_beyond_white, or more than a tenth of them below black by over a tenth of
/// the range (bias and noise stay within), or white beyond what the integers hold.
std::string level_complaint(const RawFrame& frame);

/// A deviation of noise, and the mean of the pixels that it was measured on.
struct NoiseGuess {
  double deviation_dn = 0, at_dn = 0;
};

/// Noise of one channel's plane from a single frame, in its own unit: MAD / 0.6745 of the response
/// to the 3x3 mask [1 -2 1; -2 4 -2; 1 -2 1] / 6, which ignores planes and straight horizontal or
/// vertical edges (Immerkær, "Fast noise variance estimation", CVIU 64(2), 1996), over the flatter
/// half of the 8x8 blocks. Includes fixed-pattern noise; texture in every block still raises it.
/// Pixels >= white or not finite are left out. Undecided below 256 usable responses, and where most
/// of them are the same (noise below the quantisation).
Estimate<NoiseGuess> noise_guess(View<const float> plane, double white_dn);

/// How integer data fill their container, e.g. 12 bits shifted left by four: values are
/// offset + step n + (0 .. spread).
struct ValueGrid {
  int step = 0;    ///< 1: no grid; 0: one single value
  int offset = 0;  ///< 0 <= offset < step
  int spread = 0;  ///< 0: the grid is exact, step is the greatest common divisor of all differences
};

/// Where the exact grid has step 1, powers of two from 256 down to 16 are tried: a grid that all
/// values keep to within an eighth of the step counts, too (16 n and 16 n - 1 from careless
/// scaling). Undecided for float data that are not whole numbers, and without finite pixels.
Estimate<ValueGrid> value_grid(View<const float> mosaic);

/// The converter that integer data tell of.
struct ConverterGuess {
  int bits = 0;      ///< 8, 10, 12, 14 or 16
  int white_dn = 0;  ///< its last code; of data that are scaled up, a step below the end
};

/// The least converter that holds the frame's largest value, or none where it is as wide as the
/// data's type and no step tells of scaling, or that type has no more than 8 bits. bits: of the
/// type; largest_dn: none where negative or NaN.
std::optional<ConverterGuess> converter_guess(int bits, double largest_dn, const ValueGrid& grid);

}  // namespace malus
