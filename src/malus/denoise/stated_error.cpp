#include "malus/denoise/internal/stated_error.h"

#include "malus/base/parallel.h"
#include "malus/denoise/mosaic_filter.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus::internal {
namespace {

// The error grows more slowly than what is known of it, by this power: where weights let little
// noise through their stacks are wrong by more than by that. Measured, as all numbers here
// (docs/uncertainty.md).
double grown(double known) { return std::cbrt(known * known); }
// Of combinations and of Wiener filters: weights come from a pilot that knows the same samples.
constexpr double kOfCombinations = 1.45, kOfWiener = 1.2;
// Where the estimate bends sharply as much again may have been lost, but not more than this.
constexpr double kMostLost = 0.1;
// Of the noise, what the detail step cannot take back and a coarser scale replaces.
constexpr double kCoarseShare = 0.15;
// Residuals of noise alone are seldom larger, mean over three cells per side.
constexpr double kMostResidual = 1.4;

class CellMeans {
 public:
  explicit CellMeans(const StatedErrorInput& input)
      : input_(input),
        row0_(input.noisy->row0),
        col0_(input.noisy->col0),
        residual_(*input.noisy),
        bend_(*input.noisy) {
    const int rows = input.estimate->rows(), cols = input.estimate->cols();
    first_row_ = std::max(row0_, 0) / kCell - residual_.first_row;
    first_col_ = std::max(col0_, 0) / kCell - residual_.first_col;
    end_row_ = (std::min(row0_ + rows, input.frame_rows) - 1) / kCell + 1 - residual_.first_row;
    end_col_ = (std::min(col0_ + cols, input.frame_cols) - 1) / kCell + 1 - residual_.first_col;
    parallel_for(first_row_, end_row_, 4, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
        for (int k = first_col_; k < end_col_; ++k) measure(i, k);
    });
  }

  /// Everything below is asked for cells [first_row, end_row) x [first_col, end_col) of the maps.
  int first_row() const { return first_row_; }
  int end_row() const { return end_row_; }
  int first_col() const { return first_col_; }
  int end_col() const { return end_col_; }

  /// Second difference of the estimate, squared: 1 of unit noise.
  double bend(int i, int k) const { return bend_.values(i, k); }
  /// Squared residual, means over 3x3 cells with the weights 1 2 1.
  double residual(int i, int k) const {
    double sum = 0;
    for (int a = -1; a <= 1; ++a)
      for (int b = -1; b <= 1; ++b)
        sum += static_cast<double>((2 - std::abs(a)) * (2 - std::abs(b))) *
               residual_.values(std::clamp(i + a, first_row_, end_row_ - 1),
                                std::clamp(k + b, first_col_, end_col_ - 1));
    return sum / 16;
  }

  /// The pixels of a cell that lie in the tile and in the frame, in tile coordinates.
  template <class Action>
  void for_each_pixel(int i, int k, const Action& action) const {
    const auto span = [](int cell, int origin, int size, int frame) {
      const int begin = cell * kCell;
      return std::pair{std::max({begin, origin, 0}) - origin,
                       std::min({begin + kCell, origin + size, frame}) - origin};
    };
    const auto [top, bottom] =
        span(residual_.first_row + i, row0_, input_.estimate->rows(), input_.frame_rows);
    const auto [left, right] =
        span(residual_.first_col + k, col0_, input_.estimate->cols(), input_.frame_cols);
    for (int r = top; r < bottom; ++r)
      for (int c = left; c < right; ++c) action(r, c);
  }

 private:
  void measure(int i, int k) {
    const Image &estimate = *input_.estimate, &noisy = input_.noisy->pixels;
    const auto at = [](int position, int step, int origin, int size, int frame, int period) {
      return std::clamp(folded(origin + position + step, frame, period) - origin, 0, size - 1);
    };
    float residual = 0, bend = 0;
    int count = 0;
    for_each_pixel(i, k, [&](int r, int c) {
      const auto row = [&](int step) {
        return at(r, step, row0_, estimate.rows(), input_.frame_rows, input_.period_rows);
      };
      const auto col = [&](int step) {
        return at(c, step, col0_, estimate.cols(), input_.frame_cols, input_.period_cols);
      };
      const float middle = estimate(r, c), rest = noisy(r, c) - middle;
      const float second = 4 * middle - estimate(row(-input_.period_rows), c) -
                           estimate(row(input_.period_rows), c) -
                           estimate(r, col(-input_.period_cols)) -
                           estimate(r, col(input_.period_cols));
      residual += rest * rest;
      bend += second * second / 20;  // 4² + 4 * 1²
      ++count;
    });
    residual_.values(i, k) = residual / static_cast<float>(count);
    bend_.values(i, k) = bend / static_cast<float>(count);
  }

  const StatedErrorInput& input_;
  int row0_, col0_;
  CellMap residual_, bend_;
  int first_row_, end_row_, first_col_, end_col_;
};

// What a cell adds to the noise let through, and takes of it.
struct CellTerms {
  double noise, lost, missing;
};

CellTerms terms_of(const CellMeans& cells, double kept, int i, int k) {
  // Where fine detail was taken back there is none, and what remains of the noise is coarse.
  const double fine = kept * kept * kept;
  return {kCoarseShare + (1 - kCoarseShare) * fine, fine * std::min(cells.bend(i, k), kMostLost),
          std::max(cells.residual(i, k) - kMostResidual, 0.0)};
}

}  // namespace

void state_error(const StatedErrorInput& input, Image& error) {
  const CellMeans cells(input);
  const double factor = input.filter == StackFilter::ridge ? kOfCombinations : kOfWiener;
  const auto state_row = [&](int i) {
    for (int k = cells.first_col(); k < cells.end_col(); ++k) {
      const double kept = input.kept ? std::max(double{input.kept->values(i, k)}, 0.0) : 1.0;
      const CellTerms terms = terms_of(cells, kept, i, k);
      cells.for_each_pixel(i, k, [&](int r, int c) {
        error(r, c) = static_cast<float>(factor * grown(terms.noise * error(r, c) + terms.lost) +
                                         terms.missing);
      });
    }
  };
  parallel_for(cells.first_row(), cells.end_row(), 4,
               [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                 for (auto i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
                   state_row(i);
               });
}

}  // namespace malus::internal
