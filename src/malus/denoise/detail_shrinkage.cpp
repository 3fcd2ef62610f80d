#include "malus/denoise/internal/detail_shrinkage.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/detail_kernel.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace malus::internal {
namespace {

constexpr int kStep = 4 * kCell;  ///< mosaic pixels between blocks
constexpr int kOverlap = kDetailBlock / kStep;
// The spectrum of passed noise: its energy by frequency [cycles per cell], in bands that end here,
// and by component, over the share of the samples' noise that the stacks let through. Measured on
// smooth scenes (docs/denoising-experiments.md, "Detail of smooth light").
constexpr double kBandEnds[kDetailBands] = {0.045, 0.07, 0.1, 0.14, 0.18, 0.22, 0.28, 0.35, 0.8};
constexpr double kBandEnergies[kDetailBands] = {220, 150, 110, 75, 50, 33, 18, 8, 0.7};
constexpr double kGroupEnergies[std::size(kDetailGroups)] = {1, 0.5, 0.12, 0.04};

void fill_dct(DetailJob& job) {
  for (int k = 0; k < kDetailSide; ++k)
    for (int i = 0; i < kDetailSide; ++i)
      job.dct[k][i] = static_cast<float>(std::sqrt((k ? 2.0 : 1.0) / kDetailSide) *
                                         std::cos(std::numbers::pi * (i + 0.5) * k / kDetailSide));
}

void fill_bands(DetailJob& job) {
  int count[kDetailBands] = {};
  job.band_of[0] = -1;
  for (int i = 1; i < kDetailCells; ++i) {
    const double frequency = std::hypot(i / kDetailSide, i % kDetailSide) / (2.0 * kDetailSide);
    const auto* band = std::lower_bound(std::begin(kBandEnds), std::end(kBandEnds), frequency);
    job.band_of[i] = static_cast<int>(band - std::begin(kBandEnds));
    ++count[job.band_of[i]];
  }
  for (int band = 0; band < kDetailBands; ++band) {
    job.share[band] = static_cast<float>(count[band]) / (kDetailCells - 1);
    int lane = 0;
    for (std::size_t group = 0; group < std::size(kDetailGroups); ++group) {
      const int values = (kDetailGroups[group] - lane) * count[band];
      for (; lane < kDetailGroups[group]; ++lane)
        job.per_noise[band][lane] =
            static_cast<float>(1 / (kBandEnergies[band] * kGroupEnergies[group] * values));
    }
  }
}

void fill_window(DetailJob& job) {
  const auto bump = [](int i) {
    return std::sin(std::numbers::pi * (i + 0.5) / kDetailSide) + 0.5;
  };
  double profile[kDetailSide];
  for (int i = 0; i < kDetailSide; ++i) {
    double sum = 0;  // of the blocks that overlap here
    for (int k = i % (kStep / kCell); k < kDetailSide; k += kStep / kCell) sum += bump(k);
    profile[i] = bump(i) / sum;
  }
  for (int i = 0; i < kDetailCells; ++i)
    job.window[i] = static_cast<float>(profile[i / kDetailSide] * profile[i % kDetailSide]);
}

// Noise that the stacks of a block let through: of those that let through least most, as in the
// average of their estimates. 0 where there is none.
float passed_in(const ReferenceMap& passed, int row, int col) {
  double sum = 0;
  int count = 0;
  const auto within = [&](int begin, int first, int size) {
    const int from = -floor_div(-(begin - kCell), passed.step) - first;
    const int to = -floor_div(-(begin - kCell + kDetailBlock), passed.step) - first;
    return std::pair{std::clamp(from, 0, size), std::clamp(to, 0, size)};
  };
  const auto [row_begin, row_end] = within(row, passed.first_row, passed.values.rows());
  const auto [col_begin, col_end] = within(col, passed.first_col, passed.values.cols());
  for (int r = row_begin; r < row_end; ++r)
    for (int c = col_begin; c < col_end; ++c)
      if (const float share = passed.values(r, c); share > 0) {
        sum += 1.0 / static_cast<double>(share);
        ++count;
      }
  return count > 0 ? static_cast<float>(count / sum) : 0.0f;
}

// Tile positions of a block's rows (or columns); beyond the frame's border it is folded.
void positions(int begin, int origin, int size, int frame_size, int (&at)[kDetailBlock]) {
  for (int i = 0; i < kDetailBlock; ++i)
    at[i] = std::clamp(folded(begin + i, frame_size, kCell) - origin, 0, size - 1);
}

class Shrinkage {
 public:
  Shrinkage(const StackTile& estimate, int frame_rows, int frame_cols, const CellMatrix& axes,
            const ReferenceMap& passed, float threshold, Image& out, CellMap* kept)
      : estimate_(estimate),
        frame_rows_(frame_rows),
        frame_cols_(frame_cols),
        passed_(passed),
        threshold_(threshold),
        out_(out),
        kept_(kept) {
    for (std::size_t i = 0; i < kLanes; ++i)
      for (std::size_t k = 0; k < kLanes; ++k) back_[k][i] = axes[i][k];
    job_.axes = &axes;
    job_.axes_back = &back_;
    fill_dct(job_);
    fill_bands(job_);
    fill_window(job_);
  }

  /// The blocks whose first row is this one of the frame.
  void add_row(int row) const {
    const int cols = out_.cols(), first = floor_div(estimate_.col0, kStep) - kOverlap + 1;
    DetailBlock block;
    int row_at[kDetailBlock], col_at[kDetailBlock];
    positions(row, estimate_.row0, out_.rows(), frame_rows_, row_at);
    for (int col = first * kStep; col < estimate_.col0 + cols; col += kStep) {
      positions(col, estimate_.col0, cols, frame_cols_, col_at);
      const bool folds = std::adjacent_find(std::begin(col_at), std::end(col_at), [](int a, int b) {
                           return b != a + 1;
                         }) != std::end(col_at);
      for (int r = 0; r < kDetailBlock; ++r) {
        const float* from = estimate_.pixels.row(row_at[r]);
        float* to = block.pixels + r * kDetailBlock;
        if (folds)
          for (int c = 0; c < kDetailBlock; ++c) to[c] = from[col_at[c]];
        else
          std::copy_n(from + col_at[0], kDetailBlock, to);
      }
      const float kept =
          shrink_detail_block(job_, threshold_ * passed_in(passed_, row, col), block);
      add(block, row - estimate_.row0, col - estimate_.col0);
      if (kept_) add_kept(kept, row / kCell - kept_->first_row, col / kCell - kept_->first_col);
    }
  }

 private:
  void add(const DetailBlock& block, int row, int col) const {
    const int row_begin = std::max(-row, 0), row_end = std::min(kDetailBlock, out_.rows() - row);
    const int col_begin = std::max(-col, 0), col_end = std::min(kDetailBlock, out_.cols() - col);
    for (int r = row_begin; r < row_end; ++r) {
      float* to = out_.row(row + r) + col;
      const float* from = block.pixels + r * kDetailBlock;
      for (int c = col_begin; c < col_end; ++c) to[c] += from[c];
    }
  }

  // Blocks begin at whole cells of the frame.
  void add_kept(float kept, int row, int col) const {
    for (int i = 0; i < kDetailCells; ++i) {
      const int r = row + i / kDetailSide, c = col + i % kDetailSide;
      if (r >= 0 && r < kept_->values.rows() && c >= 0 && c < kept_->values.cols())
        kept_->values(r, c) += kept * job_.window[i];
    }
  }

  const StackTile& estimate_;
  int frame_rows_, frame_cols_;
  const ReferenceMap& passed_;
  float threshold_;
  Image& out_;
  CellMap* kept_;
  CellMatrix back_;
  DetailJob job_{};
};

}  // namespace

Image shrink_detail(const StackTile& estimate, int frame_rows, int frame_cols,
                    const CellMatrix& axes, const ReferenceMap& passed, float threshold,
                    CellMap* kept) {
  const int rows = estimate.pixels.rows(), cols = estimate.pixels.cols();
  Image out(rows, cols);
  const Shrinkage shrinkage(estimate, frame_rows, frame_cols, axes, passed, threshold, out, kept);
  // Bands of block rows in two groups: blocks of one band reach into the next. Bands belong to the
  // frame, so that sums have the same order in every tile.
  const int first = floor_div(estimate.row0, kDetailBlock) - 1;
  const int bands = floor_div(estimate.row0 + rows - 1, kDetailBlock) - first + 1;
  for (int parity = 0; parity < 2; ++parity)
    parallel_for(0, bands, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int b = first + static_cast<int>(begin); b < first + static_cast<int>(end); ++b)
        if ((b & 1) == parity)
          for (int row = b * kDetailBlock; row < (b + 1) * kDetailBlock; row += kStep)
            if (row + kDetailBlock > estimate.row0 && row < estimate.row0 + rows)
              shrinkage.add_row(row);
    });
  return out;
}

}  // namespace malus::internal
