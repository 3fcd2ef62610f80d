// What the pixels of a row, a column or another line of a frame have in common.
#pragma once

#include "malus/base/index.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <vector>

namespace malus {

/// Means over lines: rows, columns or groups of them. Every value belongs to one line.
class LineMeans {
 public:
  explicit LineMeans(int lines) : sums_(as_index(lines)), counts_(as_index(lines)) {}
  void add(int line, double value) {
    sums_[as_index(line)] += value;
    ++counts_[as_index(line)];
  }
  /// 0 of a line without values.
  double mean(int line) const {
    return counts_[as_index(line)] > 0 ? sums_[as_index(line)] / counts_[as_index(line)] : 0.0;
  }
  int lines() const { return static_cast<int>(counts_.size()); }
  /// Variance of the lines' means, less what pixels of this variance alone explain.
  double variance(double of_pixels) const {
    Moments means;
    double chance = 0;
    for (std::size_t i = 0; i < sums_.size(); ++i)
      if (counts_[i] > 0) {
        means.add(sums_[i] / counts_[i]);
        chance += of_pixels / counts_[i];
      }
    if (means.count() < 2) return 0;
    return std::max(means.variance() - chance / static_cast<double>(means.count()), 0.0);
  }

  /// Variance about the lines' means of pixels that have this one about the mean of all.
  double within(double variance) const {
    double sum = 0, of_lines = 0, count = 0, lines = 0;
    for (std::size_t i = 0; i < sums_.size(); ++i)
      if (counts_[i] > 0) {
        sum += sums_[i];
        of_lines += sums_[i] * sums_[i] / counts_[i];
        count += counts_[i];
        ++lines;
      }
    if (count <= lines) return variance;
    return std::max(variance * (count - 1) - of_lines + sum * sum / count, 0.0) / (count - lines);
  }

 private:
  std::vector<double> sums_;
  std::vector<int> counts_;
};

}  // namespace malus
