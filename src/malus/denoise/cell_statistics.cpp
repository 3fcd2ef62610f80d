// What the mosaic filter must know of the whole frame: its cells' means, principal axes and linear
// estimates.
#include "malus/base/parallel.h"
#include "malus/denoise/mosaic_filter.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

using internal::CellMatrix;
using internal::CellVector;
using internal::kCell;
using internal::kLanes;

constexpr int kCellsPerAlignment = 65536;

// rotation * diag(s / (s + 1)) * rotation^T with s the signal's variance per component.
CellMatrix wiener_matrix(const CellMatrix& axes, const CellVector& eigenvalues) {
  CellMatrix matrix{};
  for (std::size_t i = 0; i < kLanes; ++i)
    for (std::size_t k = 0; k < kLanes; ++k) {
      float sum = 0;
      for (std::size_t c = 0; c < kLanes; ++c) {
        const float signal = std::max(eigenvalues[c] - 1.0f, 0.0f);
        sum += axes[i][c] * axes[k][c] * signal / (signal + 1.0f);
      }
      matrix[i][k] = sum;
    }
  return matrix;
}

// Energies, in units of the noise's variance, that the frame's axes lend to those of a stack:
// measured (docs/denoising-experiments.md). The first axis is the brightness, which every stack
// knows.
CellMatrix axes_prior(const CellMatrix& axes) {
  constexpr float kFirst = 0.24f, kRatio = 0.8f;
  CellMatrix matrix{};
  float energy = kFirst;
  for (std::size_t c = 1; c < kLanes; ++c, energy *= kRatio)
    for (std::size_t i = 0; i < kLanes; ++i)
      for (std::size_t k = 0; k < kLanes; ++k) matrix[i][k] += energy * axes[i][c] * axes[k][c];
  return matrix;
}

struct CellSums {
  double count = 0;
  std::array<double, kLanes> sum{};
  std::array<std::array<double, kLanes>, kLanes> products{};

  void add(const CellVector& cell) {
    count += 1;
    for (std::size_t i = 0; i < kLanes; ++i) {
      sum[i] += cell[i];
      for (std::size_t k = 0; k <= i; ++k) products[i][k] += static_cast<double>(cell[i]) * cell[k];
    }
  }
  CellVector mean() const {
    CellVector m{};
    for (std::size_t i = 0; i < kLanes; ++i)
      m[i] = static_cast<float>(sum[i] / std::max(count, 1.0));
    return m;
  }
  CellMatrix covariance() const {
    CellMatrix c{};
    for (std::size_t i = 0; i < kLanes; ++i)
      for (std::size_t k = 0; k <= i; ++k) {
        const double n = std::max(count, 1.0);
        c[i][k] = c[k][i] = static_cast<float>(products[i][k] / n - sum[i] / n * (sum[k] / n));
      }
    return c;
  }
};

CellSums sum_cells(const PixelSource& pixel, int rows, int cols, const SensorLayout& layout,
                   int row_phase, int col_phase) {
  const int down = (rows - row_phase + layout.rows() - 1) / layout.rows();
  const int across = (cols - col_phase + layout.cols() - 1) / layout.cols();
  const double cells = static_cast<double>(std::max(down, 0)) * std::max(across, 0);
  const int skip = std::max(1, static_cast<int>(std::ceil(std::sqrt(cells / kCellsPerAlignment))));
  CellSums sums;
  CellVector cell;
  for (int i = 0; i < down; i += skip)
    for (int k = 0; k < across; k += skip) {
      for (int r = 0; r < kCell; ++r)
        for (int c = 0; c < kCell; ++c)
          cell[static_cast<std::size_t>(r * kCell + c)] =
              pixel(folded(i * layout.rows() + row_phase + r, rows, layout.rows()),
                    folded(k * layout.cols() + col_phase + c, cols, layout.cols()));
      sums.add(cell);
    }
  return sums;
}

}  // namespace

CellStatistics measure_cells(const PixelSource& pixel, int rows, int cols,
                             const SensorLayout& layout) {
  CellStatistics statistics;
  statistics.period_rows = layout.rows();
  statistics.period_cols = layout.cols();
  const auto alignments = static_cast<std::size_t>(layout.channels());
  statistics.means.resize(alignments);
  statistics.rotations.resize(alignments);
  statistics.axes_prior.resize(alignments);
  statistics.smoothing.resize(alignments);
  parallel_for(0, layout.channels(), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t a = begin; a < end; ++a) {
      const auto i = static_cast<std::size_t>(a);
      const CellSums sums =
          sum_cells(pixel, rows, cols, layout, static_cast<int>(a) / layout.cols(),
                    static_cast<int>(a) % layout.cols());
      CellVector eigenvalues;
      statistics.means[i] = sums.mean();
      statistics.rotations[i] = internal::principal_axes(sums.covariance(), &eigenvalues);
      statistics.axes_prior[i] = axes_prior(statistics.rotations[i]);
      statistics.smoothing[i] = wiener_matrix(statistics.rotations[i], eigenvalues);
    }
  });
  return statistics;
}

}  // namespace malus
