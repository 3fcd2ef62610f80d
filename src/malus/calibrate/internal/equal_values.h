// How likely an ordinary pixel has one and the same value in every dark frame: rounded to codes,
// narrow noise leaves most pixels constant, and none of them is stuck.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Counts, over a series of frames, how often a pixel has the value that it had one frame before.
class EqualValues {
 public:
  explicit EqualValues(const MosaicGeometry& geometry);
  void add(View<const float> dn);
  /// Per channel, an upper estimate of the chance that all values of an ordinary pixel are equal:
  /// that of the one whose mean lies in the middle of a code. 1 without two frames.
  std::vector<double> chance_of_constancy() const;

 private:
  MosaicGeometry geometry_;
  Image previous_;
  int frames_ = 0;
  std::vector<double> equal_;  ///< per channel
};

/// Chance that normal noise stays in a code, from the middle of it, when two values of a pixel
/// whose mean may lie anywhere in a code are equal with this chance. Not too low where the means of
/// all pixels lie at one place in a code.
double chance_to_stay(double chance_of_equal_pair);

}  // namespace malus
