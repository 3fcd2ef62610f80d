// Streaming estimate of NoiseStructure: one call per frame of noise.
#pragma once

#include "malus/evaluate/noise_comparison.h"
#include "malus/image/view.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Sums over frames of one size; deterministic for any number of threads.
class StructureSums {
 public:
  explicit StructureSums(const SensorLayout& layout);
  /// noise: frame minus clean, a mosaic. Pixels that are not finite are left out; of a channel with
  /// fewer than two others nothing is known (NaN, if it is so in all frames), and a frame with a
  /// row without any tells nothing of the row power.
  void add(const Image& noise);
  /// Contract: at least one frame was added.
  NoiseStructure result() const;

  /// Of pixels scaled to variance 1.
  struct Products {
    double sum = 0;
    std::int64_t pairs = 0;
    double mean() const { return pairs > 0 ? sum / static_cast<double>(pairs) : 0.0; }
    Products operator+(const Products& other) const {
      return {sum + other.sum, pairs + other.pairs};
    }
  };

 private:
  struct ChannelSums {
    double mean = 0, variance = 0, row_variance = 0, column_variance = 0;
    int frames = 0;  ///< that tell of the channel
  };
  SensorLayout layout_;
  int frames_ = 0;
  std::vector<ChannelSums> channels_;
  std::vector<Products> along_row_, along_column_;
  std::vector<double> row_power_;
  int row_power_frames_ = 0;
  Image before_;  ///< the last frame, channels scaled to mean 0 and variance 1
  Products between_frames_;
};

}  // namespace malus
