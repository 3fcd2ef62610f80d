#include "malus/neural/internal/strips.h"

#include "malus/neural/internal/tasks.h"

#include <algorithm>
#include <cstring>

namespace malus::internal {
namespace {

// Pixels that a product should see at once, columns of a strip, rows of a task: enough that the
// weights' way through the cache pays, and few enough that the wide values stay there.
constexpr std::ptrdiff_t kStripPixels = 96, kMostCols = 64, kLeastRows = 8, kMostRows = 32;

struct StripGrid {
  std::ptrdiff_t batch, rows, cols, channels, band, chunk, bands, chunks;
  explicit StripGrid(const torch::Tensor& x)
      : batch(x.size(0)), rows(x.size(1)), cols(x.size(2)), channels(x.size(3)) {
    band = std::min(rows, std::clamp(rows / 2, kLeastRows, kMostRows));
    bands = (rows + band - 1) / band;
    chunks = (cols + kMostCols - 1) / kMostCols;
    chunk = (cols + chunks - 1) / chunks;
    chunks = (cols + chunk - 1) / chunk;
  }
};

// One task's rows [row0, row1) and columns [col0, col1), filtered a few rows at a time. Wide rows
// lie in a ring of slots, each with a pixel more at both ends.
class StripTask {
 public:
  StripTask(const StripGrid& grid, const StripLayer& layer, std::ptrdiff_t task)
      : grid_(grid), layer_(layer), task_(task), wide_(layer.expand.cols()) {
    image_ = task / (grid.bands * grid.chunks);
    row0_ = task / grid.chunks % grid.bands * grid.band;
    row1_ = std::min(row0_ + grid.band, grid.rows);
    col0_ = task % grid.chunks * grid.chunk;
    col1_ = std::min(col0_ + grid.chunk, grid.cols);
    slot_pixels_ = cols() + 2;
    group_ = std::clamp(kStripPixels / slot_pixels_, std::ptrdiff_t{1}, std::ptrdiff_t{8});
    slots_ = group_ == 1 ? 3 : 2 * group_;
    const std::ptrdiff_t pixels = group_ * slot_pixels_;
    scratch_.emplace(pixels * (grid.channels + wide_) + slots_ * slot_pixels_ * wide_ + 3 * kLane);
    normal_ = scratch_->take(pixels * grid.channels);
    ring_ = scratch_->take(slots_ * slot_pixels_ * wide_);
    filtered_ = scratch_->take(pixels * wide_);
  }

  void run(const float* x, const std::function<void(const StripPiece&)>& use) {
    std::ptrdiff_t done = row0_;
    for (std::ptrdiff_t first = row0_ - 1; first <= row1_; first += group_) {
      const std::ptrdiff_t end = std::min(first + group_, row1_ + 1);
      widen(x, first, end);
      filter(done, std::min(end - 1, row1_), use);
      done = std::max(done, std::min(end - 1, row1_));
    }
  }

 private:
  std::ptrdiff_t cols() const { return col1_ - col0_; }
  float* slot(std::ptrdiff_t row) const {
    return ring_ + (row - row0_ + 1) % slots_ * slot_pixels_ * wide_;
  }
  std::ptrdiff_t place(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return (image_ * grid_.rows + row) * grid_.cols + col;
  }

  // Wide values of rows [first, end); pixels outside of the picture are zeros.
  void widen(const float* x, std::ptrdiff_t first, std::ptrdiff_t end) {
    const std::ptrdiff_t left = std::max<std::ptrdiff_t>(col0_ - 1, 0),
                         right = std::min(col1_ + 1, grid_.cols), channels = grid_.channels;
    const std::ptrdiff_t inner = (left - col0_ + 1);
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(first, 0), to = std::min(end, grid_.rows);
    for (std::ptrdiff_t row = first; row < end; ++row)
      if (row < 0 || row >= grid_.rows) std::fill_n(slot(row), slot_pixels_ * wide_, 0.0F);
    if (from >= to) return;
    for (std::ptrdiff_t row = from; row < to; ++row)
      normalize_rows(layer_.norm, x + place(row, left) * channels, channels, right - left, channels,
                     normal_ + ((row - from) * slot_pixels_ + inner) * channels);
    MatrixProduct p = layer_.expand.product();
    p.rows = right - left;
    p.a = normal_ + inner * channels;
    p.a_row = channels;
    p.c = slot(from) + inner * wide_;
    p.c_row = wide_;
    p.groups = to - from;
    p.a_group = slot_pixels_ * channels;
    p.c_group = slot_pixels_ * wide_;
    multiply(p);
    for (std::ptrdiff_t row = from; row < to; ++row) {
      if (layer_.gelu) gelu(slot(row) + inner * wide_, (right - left) * wide_);
      if (left == col0_) std::fill_n(slot(row), wide_, 0.0F);
      if (right == col1_) std::fill_n(slot(row) + (slot_pixels_ - 1) * wide_, wide_, 0.0F);
    }
  }

  // Rows [first, end), whose neighbours are ready.
  void filter(std::ptrdiff_t first, std::ptrdiff_t end,
              const std::function<void(const StripPiece&)>& use) {
    if (first >= end) return;
    for (std::ptrdiff_t row = first; row < end; ++row) {
      const float* const rows[3] = {slot(row - 1), slot(row), slot(row + 1)};
      depthwise_row(rows, layer_.depthwise.weight.data_ptr<float>(), layer_.depthwise.bias_data(),
                    cols(), wide_, filtered_ + (row - first) * cols() * wide_);
    }
    if (cols() == grid_.cols) {
      use({task_, place(first, 0), (end - first) * cols(), filtered_});
    } else {
      for (std::ptrdiff_t row = first; row < end; ++row)
        use({task_, place(row, col0_), cols(), filtered_ + (row - first) * cols() * wide_});
    }
  }

  const StripGrid& grid_;
  const StripLayer& layer_;
  std::ptrdiff_t task_, wide_, image_, row0_, row1_, col0_, col1_, slot_pixels_, group_, slots_;
  std::optional<Scratch> scratch_;
  float *normal_, *ring_, *filtered_;
};

}  // namespace

std::ptrdiff_t strip_tasks(const torch::Tensor& x) {
  const StripGrid grid(x);
  return grid.batch * grid.bands * grid.chunks;
}

void for_each_strip(const torch::Tensor& x, const StripLayer& layer,
                    const std::function<void(const StripPiece&)>& use) {
  const StripGrid grid(x);
  const float* data = x.data_ptr<float>();
  for_each_task(strip_tasks(x),
                [&](std::ptrdiff_t task) { StripTask(grid, layer, task).run(data, use); });
}

torch::Tensor strip_feed_forward(const torch::Tensor& x, const StripLayer& layer,
                                 StripActivation activation, const PackedLinear& project) {
  const std::ptrdiff_t channels = x.size(3);
  torch::Tensor y = torch::empty_like(x);
  const float* from = x.data_ptr<float>();
  float* to = y.data_ptr<float>();
  for_each_strip(x, layer, [&](const StripPiece& piece) {
    if (activation == StripActivation::kGelu)
      gelu(piece.wide, piece.pixels * layer.expand.cols());
    else
      gate_halves(piece.wide, piece.pixels, project.inner(), true, piece.wide);
    float* out = to + piece.pixel * channels;
    std::memcpy(out, from + piece.pixel * channels,
                sizeof(float) * static_cast<std::size_t>(piece.pixels * channels));
    project.run(piece.wide, piece.pixels, out, channels, true);
  });
  return y;
}

}  // namespace malus::internal
