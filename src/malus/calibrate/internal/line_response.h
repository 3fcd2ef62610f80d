// Gains that the pixels of a row or a column have in common, in a map of the response.
#pragma once

#include "malus/base/statistics.h"
#include "malus/calibrate/internal/line_means.h"
#include "malus/calibrate/internal/response_window.h"

#include <algorithm>
#include <cstdint>

namespace malus {

// Gains that whole rows or columns have in common: windows take more of them than of a pixel's own.
class LineResponse {
 public:
  /// kept: share of the lines' variance that the light's polynomial leaves.
  LineResponse(int lines, int largest_radius, double kept)
      : means_(lines), largest_(largest_radius), kept_(kept) {}
  /// kept: share of the variance of the pixel's own response in this one.
  void add(int line, double response, double kept) {
    means_.add(line, response);
    lost_.add(1.0 - kept_ * kept_of_line(line, means_.lines(), largest_) / kept);
  }
  /// Variance of the lines' gains; of_pixels: of the pixels, what their lines share among it.
  double variance(double of_pixels) const {
    double squares = 0, kept = 0;
    for (int i = 0; i < means_.lines(); ++i) {
      squares += means_.mean(i) * means_.mean(i);
      kept += kept_ * kept_of_line(i, means_.lines(), largest_);
    }
    const double chance = means_.lines() / static_cast<double>(std::max<std::int64_t>(
                                               lost_.count(), 2 * means_.lines()));
    return kept > 0 ? (squares / kept - of_pixels * chance) / (1.0 - chance) : 0.0;
  }
  /// Of it, what the mean square of the pixels lacks.
  double lost() const { return lost_.mean(); }
  /// Sampling variance of that variance: lines are fewer than pixels.
  double error2(double variance) const {
    return 2.0 * variance * variance / std::max(means_.lines() - 1, 1);
  }

 private:
  LineMeans means_;
  int largest_;
  double kept_;
  Moments lost_;
};

}  // namespace malus
