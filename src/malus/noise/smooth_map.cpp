#include "malus/noise/smooth_map.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

namespace malus {
namespace {

// Where block i of `blocks` begins among `count` pixels.
int block_begin(int i, int count, int blocks) {
  return static_cast<int>(std::int64_t{i} * count / blocks);
}

// The two blocks whose middles a pixel lies between, and how far it is on its way to the second;
// beyond the outermost middles their line goes on.
struct Between {
  int first = 0, second = 0;
  double way = 0;
};
Between between_blocks(int pixel, int count, int blocks) {
  if (blocks == 1) return {};
  const double at = (pixel + 0.5) * blocks / count - 0.5;
  const int first = std::clamp(static_cast<int>(std::floor(at)), 0, blocks - 2);
  return {first, first + 1, at - first};
}

}  // namespace

SmoothMap::SmoothMap(View<const float> map, int cell_rows, int cell_cols, double middle)
    : rows_(map.rows()), cols_(map.cols()), cell_rows_(cell_rows), cell_cols_(cell_cols) {
  const int down = cell_rows, across = cell_cols;
  for (int channel = 0; channel < down * across; ++channel) {
    Grid grid{channel / across, channel % across, 0, 0, {}};
    grid.rows = (rows_ - grid.first_row + down - 1) / down;
    grid.cols = (cols_ - grid.first_col + across - 1) / across;
    grid.medians = Image(std::max(grid.rows / kBlock, 1), std::max(grid.cols / kBlock, 1));
    channels_.push_back(std::move(grid));
  }
  for (Grid& grid : channels_) {
    Image& medians = grid.medians;
    parallel_for(0, medians.rows(), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      std::vector<double> pixels;
      for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
        for (int k = 0; k < medians.cols(); ++k) {
          pixels.clear();
          for (int r = block_begin(i, grid.rows, medians.rows());
               r < block_begin(i + 1, grid.rows, medians.rows()); ++r)
            for (int c = block_begin(k, grid.cols, medians.cols());
                 c < block_begin(k + 1, grid.cols, medians.cols()); ++c)
              pixels.push_back(map(grid.first_row + r * down, grid.first_col + c * across));
          medians(i, k) = static_cast<float>(median_of(pixels) - middle);
        }
    });
  }
}

bool SmoothMap::differs(const std::vector<double>& chance_variance) const {
  constexpr double kChance = 5;  // in standard errors of a sum of as many squares of normal draws
  double squares = 0, count = 0;
  for (std::size_t channel = 0; channel < channels_.size(); ++channel)
    for (const float median : channels_[channel].medians.values()) {
      ++count;
      const double square = double{median} * median;
      if (square > 0) squares += square / chance_variance[channel];
    }
  return squares / count > 1 + kChance * std::sqrt(2 / count);
}

double SmoothMap::span(int channel) const {
  const Image& medians = channels_[static_cast<std::size_t>(channel)].medians;
  const auto [least, most] = std::ranges::minmax(medians.values());
  return double{most} - least;
}

Image SmoothMap::values() const {
  Image out(rows_, cols_);
  parallel_for(0, rows_, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < static_cast<int>(end); ++row)
      for (int col = 0; col < cols_; ++col) {
        const Grid& grid =
            channels_[static_cast<std::size_t>(row % cell_rows_ * cell_cols_ + col % cell_cols_)];
        const Image& medians = grid.medians;
        const Between r = between_blocks(row / cell_rows_, grid.rows, medians.rows()),
                      c = between_blocks(col / cell_cols_, grid.cols, medians.cols());
        const auto in_row = [&](int i) {
          return (1 - c.way) * medians(i, c.first) + c.way * medians(i, c.second);
        };
        out(row, col) =
            static_cast<float>((1 - r.way) * in_row(r.first) + r.way * in_row(r.second));
      }
  });
  return out;
}

}  // namespace malus
