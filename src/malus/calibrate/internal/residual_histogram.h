// Histogram of the residuals of bias frames.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace malus {

/// Counts of |residual| in cells of equal width: cell i holds [i, i+1) * cell_dn. The distribution
/// is symmetric, so the sign carries nothing about shape and scale, but where the camera cuts it
/// off (cut_off_noise.h). Unbounded: nothing is clipped.
class ResidualHistogram {
 public:
  ResidualHistogram() = default;
  explicit ResidualHistogram(double cell_dn) : cell_dn_(cell_dn) {}
  struct Cell {
    std::int32_t index;
    double count;
  };
  double cell_dn() const { return cell_dn_; }
  double centre_dn(const Cell& cell) const { return (cell.index + 0.5) * cell_dn_; }
  /// Rising index, counts above zero.
  const std::vector<Cell>& cells() const { return cells_; }
  double count() const;
  double mean_square_dn2() const;  ///< of the cells' centres
  void add(const ResidualHistogram& other);
  /// Moves dense counts and the few cells beyond them in.
  void assign(const std::vector<std::uint32_t>& dense, std::vector<std::int32_t>& beyond);
  /// Counts that need not be whole.
  void assign(const std::vector<double>& counts);

 private:
  double cell_dn_ = 1.0;
  std::vector<Cell> cells_;
};

/// One channel's of all frames: frames[frame][channel], of one width of cells.
ResidualHistogram pooled_over_frames(const std::vector<std::vector<ResidualHistogram>>& frames,
                                     std::size_t channel);

}  // namespace malus
