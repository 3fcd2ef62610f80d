// What pixels of a frame have in common from frame to frame (rows, a level that drifts): two sets
// of frames of one camera differ by it far more than as many independent pixels would.
#pragma once

#include "malus/base/statistics.h"
#include "malus/evaluate/noise_comparison.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace malus {

/// Means of the noise of one set, level by level, in bands of rows and frame by frame.
class CommonOffsets {
 public:
  CommonOffsets(std::size_t levels, int rows) : levels_(levels), rows_(rows) {}
  void add(std::size_t level, int row, double noise_dn) {
    Sum& sum = levels_[level].bands[static_cast<std::size_t>(row * kBands / rows_)];
    sum.noise_dn += noise_dn;
    sum.pixels += 1;
  }
  void end_frame();
  /// Variance of the mean of a level's samples beyond what pixels of this variance make if each is
  /// drawn alone [DN²]: that of the bands' means, or of the frames' where it is larger. From frame
  /// to frame, for what stays is no chance; of a single frame by how far bands lie off the line
  /// between their neighbours, which does not see rows that drift slowly.
  double mean_variance_dn2(std::size_t level, double pixel_variance_dn2) const;
  /// Of the means of frames; 0 of a single one.
  double frame_variance_dn2(std::size_t level) const;

 private:
  static constexpr int kBands = 8;
  struct Sum {
    double noise_dn = 0, pixels = 0;
    double mean() const { return noise_dn / pixels; }
  };
  struct Level {
    std::array<Sum, kBands> bands;  ///< of this frame
    std::array<Moments, kBands> of_bands;
    std::array<double, kBands> band_pixels{};
    Moments of_frames;
    double pixels = 0;
    double within_frame_dn2 = 0;  ///< of the mean of the last frame, by its bands
  };
  std::vector<Level> levels_;
  int rows_;
};

/// What jsd_bits of two such samples gains where their means differ by chance, by a difference of
/// this variance: to first order I variance / (8 ln 2), of the place's information I. Moving the
/// histogram of both by half a deviation tells I.
double jsd_of_offsets_bits(std::span<const std::int64_t> a, std::span<const std::int64_t> b,
                           double bin_width_dn, double variance_dn2);

/// What it gains where few rows and frames tell the spread of their offsets, of one set; to second
/// order, of normal noise: Σ ρ² σ_b⁴ / (N σ⁴ 8 ln 2) of N draws that correlate by ρ.
double jsd_of_spread_bits(const NoiseStructure& structure, const NoiseFrames& set,
                          const Image& frame, double frame_variance_dn2);

}  // namespace malus
