#include "malus/denoise/internal/stated_error.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/mosaic_filter.h"
#include "malus/denoise/internal/stack_kernel.h"
#include "malus/image/sum_around.h"

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
constexpr double kOfCombinations = 1.45, kOfWiener = 1.1;
// Where the estimate bends sharply as much again may have been lost, but not more than this.
constexpr double kMostLost = 0.1;
// Of the noise, what the detail step cannot take back and a coarser scale replaces.
constexpr double kCoarseShare = 0.15;
// Residuals of noise alone are seldom larger, mean over three cells per side.
constexpr double kMostResidual = 1.4;
// Of true copies: this many times the noise let through, and what coarser scales let through.
constexpr double kOfCopies = 3.0, kLeastOfCopies = 0.0005;
// Blocks are copies where their samples differ by less than the estimate bends. Chosen blocks look
// more alike than they are, by this; and little is not told from nothing.
constexpr double kChosenAlike = 0.05, kLeastUnlike = 0.02;
// Light is even where blocks are less unlike than this at every scale and the estimate bends less
// than that.
constexpr double kUnlikeOfEven = 0.2, kBendOfEven = 0.002;

class CellMeans {
 public:
  explicit CellMeans(const StatedErrorInput& input)
      : input_(input),
        row0_(input.noisy->row0),
        col0_(input.noisy->col0),
        residual_(*input.noisy),
        bend_(*input.noisy),
        bend_root_(*input.noisy) {
    if (input.doubt) doubt_ = values_of<const float>(*input.doubt);
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
  /// The same of 5x5 cells, the square of the mean root: one strong bend does not make a pattern.
  double bend_around(int i, int k) const {
    double sum = 0;
    for (int a = -2; a <= 2; ++a)
      for (int b = -2; b <= 2; ++b)
        sum += bend_root_.values(std::clamp(i + a, first_row_, end_row_ - 1),
                                 std::clamp(k + b, first_col_, end_col_ - 1));
    return sum * sum / (25 * 25);
  }
  /// How unlike the blocks of the stacks here are; `coarse` of all coarser scales.
  double unlike(int i, int k) const { return input_.unlike->values(i, k); }
  double coarse_unlike(int i, int k) const {
    if (!input_.coarse_unlike) return kUnlikeAny;
    const auto at = [](int cell, int count) { return std::clamp(cell / 2, 0, count - 1); };
    return (*input_.coarse_unlike)(at(residual_.first_row + i, input_.coarse_unlike->rows()),
                                   at(residual_.first_col + k, input_.coarse_unlike->cols()));
  }
  double doubt(int i, int k) const {
    if (!doubt_) return 1;
    return double{
        doubt_.near((residual_.first_row + i) * kCell, (residual_.first_col + k) * kCell)};
  }
  /// Squared residual, means over 3x3 cells with the weights 1 2 1.
  double residual(int i, int k) const {
    const View<const float> inside = residual_.values.view().window(
        first_row_, first_col_, end_row_ - first_row_, end_col_ - first_col_);
    return sum_around(inside, i - first_row_, k - first_col_) / 16;
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
    bend_root_.values(i, k) = std::sqrt(bend_.values(i, k));
  }

  const StatedErrorInput& input_;
  int row0_, col0_;
  CellMap residual_, bend_, bend_root_;
  ReferenceValues<const float> doubt_;
  int first_row_, end_row_, first_col_, end_col_;
};

// 0 where the stacks hold true copies, 1 where they hold what merely looks alike.
double resemblance(const CellMeans& cells, int i, int k) {
  const double unlike = cells.unlike(i, k), around = cells.bend_around(i, k),
               bend = std::min(cells.bend(i, k), around),
               told = std::max(unlike + kChosenAlike, kLeastUnlike);
  // Beside structure blocks are copies if they differ by little of it; where there is none, if they
  // do not differ at coarse scales either.
  const double of_structure = told < bend ? told / bend : 1.0;
  const double of_even =
      std::max(std::max(unlike, cells.coarse_unlike(i, k)) / kUnlikeOfEven, around / kBendOfEven);
  const double share = of_structure * std::clamp(of_even, 0.0, 1.0);
  return share * share;
}

// What a cell adds to the noise let through, and takes of it.
struct CellTerms {
  double noise, lost, missing, resemblance;
};

CellTerms terms_of(const CellMeans& cells, double kept, int i, int k) {
  // Where fine detail was taken back there is none, and what remains of the noise is coarse.
  const double fine = kept * kept * kept;
  // Gains that expect more noise let less of it through, but the signal that they expect to lose is
  // as much again.
  return {(kCoarseShare + (1 - kCoarseShare) * fine) * cells.doubt(i, k),
          fine * std::min(cells.bend(i, k), kMostLost),
          std::max(cells.residual(i, k) - kMostResidual, 0.0), resemblance(cells, i, k)};
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
        const double noise = error(r, c), alike = factor * grown(terms.noise * noise + terms.lost),
                     copies = std::min(kOfCopies * noise + kLeastOfCopies, alike);
        error(r, c) =
            static_cast<float>(copies + terms.resemblance * (alike - copies) + terms.missing);
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
