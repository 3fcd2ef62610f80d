// Streaming estimate of NoiseStructure: one call per frame of noise.
#pragma once

#include "malus/evaluate/noise_comparison.h"
#include "malus/image/view.h"

namespace malus {

/// Sums over frames of one size; deterministic for any number of threads.
class StructureSums {
 public:
  explicit StructureSums(const SensorLayout& layout);
  /// noise: frame minus clean, a mosaic. Pixels that are not finite count as the channel's mean;
  /// of a channel with fewer than two others nothing is known (NaN, if it is so in all frames).
  void add(const Image& noise);
  /// Contract: at least one frame was added.
  NoiseStructure result() const;

 private:
  struct ChannelSums {
    double mean = 0, variance = 0, row_variance = 0, column_variance = 0;
    int frames = 0;  ///< that tell of the channel
  };
  SensorLayout layout_;
  int frames_ = 0;
  std::vector<ChannelSums> channels_;
  std::vector<double> along_row_, along_column_, row_power_;
  Image before_;  ///< the last frame, channels scaled to mean 0 and variance 1
  double between_frames_ = 0;
};

}  // namespace malus
