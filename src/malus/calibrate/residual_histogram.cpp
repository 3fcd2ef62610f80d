#include "malus/calibrate/internal/residual_histogram.h"

#include "malus/base/error.h"

#include <algorithm>

namespace malus {

double ResidualHistogram::count() const {
  double total = 0;
  for (const Cell& cell : cells_) total += cell.count;
  return total;
}

double ResidualHistogram::mean_square_dn2() const {
  double sum = 0.0;
  for (const Cell& cell : cells_) sum += cell.count * centre_dn(cell) * centre_dn(cell);
  return sum / count();
}

void ResidualHistogram::add(const ResidualHistogram& other) {
  MALUS_REQUIRE(other.cell_dn_ == cell_dn_);
  std::vector<Cell> merged;
  merged.reserve(std::max(cells_.size(), other.cells_.size()) + 16);
  auto a = cells_.begin();
  auto b = other.cells_.begin();
  while (a != cells_.end() || b != other.cells_.end()) {
    if (b == other.cells_.end() || (a != cells_.end() && a->index < b->index)) {
      merged.push_back(*a++);
    } else if (a == cells_.end() || b->index < a->index) {
      merged.push_back(*b++);
    } else {
      merged.push_back({a->index, a->count + b->count});
      ++a;
      ++b;
    }
  }
  cells_ = std::move(merged);
}

void ResidualHistogram::assign(const std::vector<std::uint32_t>& dense,
                               std::vector<std::int32_t>& beyond) {
  cells_.clear();
  for (std::size_t i = 0; i < dense.size(); ++i)
    if (dense[i] > 0) cells_.push_back({static_cast<std::int32_t>(i), double{1} * dense[i]});
  std::sort(beyond.begin(), beyond.end());
  for (const std::int32_t index : beyond) {
    if (!cells_.empty() && cells_.back().index == index)
      cells_.back().count += 1;
    else
      cells_.push_back({index, 1});
  }
}

void ResidualHistogram::assign(const std::vector<double>& counts) {
  cells_.clear();
  for (std::size_t i = 0; i < counts.size(); ++i)
    if (counts[i] > 0) cells_.push_back({static_cast<std::int32_t>(i), counts[i]});
}

ResidualHistogram pooled_over_frames(const std::vector<std::vector<ResidualHistogram>>& frames,
                                     std::size_t channel) {
  ResidualHistogram pooled(frames.front()[channel].cell_dn());
  for (const auto& frame : frames) pooled.add(frame[channel]);
  return pooled;
}

}  // namespace malus
