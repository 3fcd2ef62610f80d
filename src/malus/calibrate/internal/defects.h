// Defect pixels, as the dark frames of one gain and the response show them.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"
#include "malus/noise/calibration.h"
#include "malus/noise/tukey_lambda.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus {

/// Read noise of a channel's ordinary pixels, to judge the others by.
struct ReadTail {
  double lambda = kNormalLambda, scale_dn = 0;
};

/// What one frame alone adds to a pixel: its value that lies farthest from the pixel's mean.
struct FarthestValue {
  int row = 0, col = 0;
  double above_mean_dn = 0;  ///< of all frames
};

/// Dark frames of one gain, to judge pixels by.
struct DarkPixels {
  View<const float> shading_dn, sum_of_squares;
  int frames = 0;
  std::vector<ReadTail> tails = {};    ///< per channel; empty: not known
  std::vector<double> constancy = {};  ///< per channel: EqualValues::chance_of_constancy
  double step_dn = 0;                  ///< of the codes; 0: there are none
  /// Of the pixels that stand out, in the order of find_defects; empty: not known.
  std::vector<FarthestValue> farthest = {};
};

/// Pixels that stand out by more than kDefectDeviations robust deviations: "hot" in the dark
/// shading, "noisy" in temporal variance (and above four times the channel's), "stuck" with less
/// than a fiftieth of it over 20 frames or more, "dead" with less than half of the response.
/// Of heavy tails a single value can make a pixel hot or noisy: such pixels must be farther out
/// than is likely anywhere among the channel's, and stand out without their farthest value too
/// (by six deviations) where that is known.
/// Of noise narrower than a code pixels are constant by chance, others jump by a code, and most
/// show no deviation: where constancy is likely, none is stuck, and what rounding alone can do
/// makes none hot or noisy. A pixel that follows the light is not stuck.
/// response may be empty.
struct FoundDefects {
  /// In the order of the channels, rows and columns of each; where more than most_defects are
  /// found the worst: stuck and dead ones, then those that stand out farthest.
  std::vector<DefectPixel> listed;
  std::int64_t found = 0;  ///< listed or not
};
FoundDefects find_defects(const DarkPixels& dark, View<const float> response,
                          const MosaicGeometry& geometry);

/// 1 where a pixel is "stuck" by its dark frames alone, which flats may contradict; empty where
/// none is.
Image constant_pixels(const DarkPixels& dark, const MosaicGeometry& geometry);

/// Twice the share that is warned of, but 100000 in small frames, and no more than a million, which
/// is what a model file holds.
std::size_t most_defects(const MosaicGeometry& geometry);

/// Finds the farthest value of each pixel that stands out, in a pass over the same frames. Of fewer
/// than six frames the others are too few to tell anything, and it finds none.
class FarthestValues {
 public:
  /// dark: without tails and farthest values. dark.shading_dn, the mean frame, must outlive this.
  FarthestValues(const DarkPixels& dark, const MosaicGeometry& geometry);
  /// drift_dn: per channel, this frame's mean above that of all frames.
  void add(View<const float> dn, const std::vector<double>& drift_dn);
  /// Gives them away.
  std::vector<FarthestValue> release() { return std::move(values_); }

 private:
  MosaicGeometry geometry_;
  View<const float> mean_dn_;
  std::vector<FarthestValue> values_;
};

/// What the listed pixels add to the temporal variance of dark.sum_of_squares, mean over the
/// channel's pixels; DN² per channel. Contract: at least two frames.
std::vector<double> temporal_excess_dn2(const DarkPixels& dark,
                                        const std::vector<DefectPixel>& defects,
                                        const MosaicGeometry& geometry);

}  // namespace malus
