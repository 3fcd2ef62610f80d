// What the mosaic filter must know of the whole frame: its cells' means, principal axes and linear
// estimates.
#include "malus/base/parallel.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

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

/// Step between the cells that are read, each way: about kCellsPerAlignment of every alignment are.
int cells_apart(int rows, int cols, const SensorLayout& layout) {
  const double cells = std::ceil(static_cast<double>(rows) / layout.rows()) *
                       std::ceil(static_cast<double>(cols) / layout.cols());
  return std::max(1, static_cast<int>(std::ceil(std::sqrt(cells / kCellsPerAlignment))));
}

/// Where the cells of one row or column phase begin.
std::vector<int> cell_starts(int phase, int size, int period, int apart) {
  std::vector<int> starts;
  for (int at = phase; at < size; at += apart * period) starts.push_back(at);
  return starts;
}

/// The pixels of cells that begin in one row, by column; asked for once, as they serve the cells of
/// all column phases.
class CellRow {
 public:
  CellRow(const std::vector<std::vector<int>>& starts, int cols, int period) {
    std::vector<bool> read(static_cast<std::size_t>(cols + kCell));
    for (const auto& phase : starts)
      for (const int start : phase)
        for (int c = 0; c < kCell; ++c) read[static_cast<std::size_t>(start + c)] = true;
    for (int c = 0; c < cols + kCell; ++c)
      if (read[static_cast<std::size_t>(c)]) columns_.push_back({c, folded(c, cols, period)});
    values_.resize(read.size() * kCell);
  }
  void load(const PixelSource& pixel, int row, int rows, int period) {
    for (int r = 0; r < kCell; ++r) {
      const int from = folded(row + r, rows, period);
      for (const auto& [column, folded_column] : columns_)
        values_[static_cast<std::size_t>(column * kCell + r)] = pixel(from, folded_column);
    }
  }
  CellVector cell(int start) const {
    CellVector cell;
    for (int r = 0; r < kCell; ++r)
      for (int c = 0; c < kCell; ++c)
        cell[static_cast<std::size_t>(r * kCell + c)] =
            values_[static_cast<std::size_t>((start + c) * kCell + r)];
    return cell;
  }

 private:
  std::vector<std::pair<int, int>> columns_;  ///< and where those beyond the border are mirrored
  std::vector<float> values_;                 ///< [column][row]
};

/// Of the cells of one row phase, by column phase.
std::vector<CellSums> sum_cells(const FrameSource& frame, int row_phase) {
  const SensorLayout& layout = frame.layout;
  const int apart = cells_apart(frame.rows, frame.cols, layout);
  std::vector<std::vector<int>> starts;
  for (int phase = 0; phase < layout.cols(); ++phase)
    starts.push_back(cell_starts(phase, frame.cols, layout.cols(), apart));
  CellRow cells(starts, frame.cols, layout.cols());
  std::vector<CellSums> sums(starts.size());
  for (const int row : cell_starts(row_phase, frame.rows, layout.rows(), apart)) {
    cells.load(frame.pixel, row, frame.rows, layout.rows());
    for (std::size_t phase = 0; phase < starts.size(); ++phase)
      for (const int start : starts[phase]) sums[phase].add(cells.cell(start));
  }
  return sums;
}

}  // namespace

CellStatistics measure_cells(const FrameSource& frame) {
  const SensorLayout& layout = frame.layout;
  CellStatistics statistics;
  statistics.period_rows = layout.rows();
  statistics.period_cols = layout.cols();
  const auto alignments = static_cast<std::size_t>(layout.channels());
  statistics.means.resize(alignments);
  statistics.rotations.resize(alignments);
  statistics.axes_prior.resize(alignments);
  statistics.smoothing.resize(alignments);
  parallel_for(0, layout.rows(), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t row_phase = begin; row_phase < end; ++row_phase) {
      const auto sums = sum_cells(frame, static_cast<int>(row_phase));
      for (std::size_t phase = 0; phase < sums.size(); ++phase) {
        const auto i = static_cast<std::size_t>(row_phase) * sums.size() + phase;
        CellVector eigenvalues;
        statistics.means[i] = sums[phase].mean();
        statistics.rotations[i] = internal::principal_axes(sums[phase].covariance(), &eigenvalues);
        statistics.axes_prior[i] = axes_prior(statistics.rotations[i]);
        statistics.smoothing[i] = wiener_matrix(statistics.rotations[i], eigenvalues);
      }
    }
  });
  return statistics;
}

}  // namespace malus
