#include "malus/neural/internal/strips.h"

#include "malus/neural/internal/tasks.h"

#include <algorithm>
#include <cstring>

namespace malus::internal {
namespace {

// Pixels that a product should see at once, of few channels and of many, whose weights come from
// farther away; columns of a strip, rows of a task: enough that the weights' way through the cache
// pays, and few enough that the wide values stay there.
constexpr std::ptrdiff_t kStripPixels = 96, kManyPixels = 256, kManyChannels = 256;
constexpr std::ptrdiff_t kMostCols = 64, kLeastRows = 8, kMostRows = 32;
// Bytes of wide rows in the cache where strips may be longer than kMostCols.
constexpr std::ptrdiff_t kRingBytes = 320 * 1024;

struct StripGrid {
  std::ptrdiff_t batch, rows, cols, channels, band, chunk, bands, chunks;
  explicit StripGrid(const torch::Tensor& x) : StripGrid(x, kMostCols) {
    set_band(std::min(rows, std::clamp(rows / 2, kLeastRows, kMostRows)));
  }
  // As few rows and columns twice as the threads allow.
  StripGrid(const torch::Tensor& x, const StripLayer& layer)
      : StripGrid(x,
                  std::max(kMostCols, kRingBytes / (3 * layer.expand.cols() *
                                                    static_cast<std::ptrdiff_t>(sizeof(float))))) {
    const std::ptrdiff_t parts = batch * chunks, wanted = (task_threads() + parts - 1) / parts;
    set_band(std::max((rows + wanted - 1) / wanted, std::min(rows, kLeastRows)));
  }

 private:
  StripGrid(const torch::Tensor& x, std::ptrdiff_t most_cols)
      : batch(x.size(0)), rows(x.size(1)), cols(x.size(2)), channels(x.size(3)) {
    chunks = (cols + most_cols - 1) / most_cols;
    chunk = (cols + chunks - 1) / chunks;
    chunks = (cols + chunk - 1) / chunk;
  }
  void set_band(std::ptrdiff_t rows_of_band) {
    band = rows_of_band;
    bands = (rows + band - 1) / band;
  }
};

// Where gated values go and their columns' sums: one row of them for every row of a task.
struct GateTarget {
  float *gated, *sums;
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
    // Rows whose wide values are needed, in groups of one size.
    first_ = std::max<std::ptrdiff_t>(row0_ - 1, 0);
    end_ = std::min(row1_ + 1, grid.rows);
    const std::ptrdiff_t pixels = grid.channels < kManyChannels ? kStripPixels : kManyPixels,
                         most = std::clamp(pixels / cols(), std::ptrdiff_t{1}, std::ptrdiff_t{16}),
                         groups = (end_ - first_ + most - 1) / most;
    group_ = (end_ - first_ + groups - 1) / groups;
    slots_ = group_ + 2;
  }

  void run(const float* x, const std::function<void(const StripPiece&)>& use) {
    take_memory(group_ * cols() * wide_);
    for_row_groups(x, [&](std::ptrdiff_t first, std::ptrdiff_t end) { filter(first, end, use); });
  }
  void run(const float* x, const GateTarget& target) {
    take_memory(0);
    for_row_groups(x, [&](std::ptrdiff_t first, std::ptrdiff_t end) { gate(first, end, target); });
  }

 private:
  std::ptrdiff_t cols() const { return col1_ - col0_; }
  float* slot(std::ptrdiff_t row) const {
    return ring_ + (row - row0_ + 1) % slots_ * slot_pixels_ * wide_;
  }
  std::ptrdiff_t place(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return (image_ * grid_.rows + row) * grid_.cols + col;
  }
  void take_memory(std::ptrdiff_t filtered) {
    const std::ptrdiff_t normal = layer_.expand.memory(slot_pixels_, group_),
                         ring = slots_ * slot_pixels_ * wide_;
    scratch_.emplace(normal + ring + filtered + 3 * kLane);
    normal_ = scratch_->take(normal);
    ring_ = scratch_->take(ring);
    filtered_ = scratch_->take(filtered);
  }

  // Calls use(first, end) for rows whose neighbours are ready.
  template <class Use>
  void for_row_groups(const float* x, const Use& use) {
    if (row0_ == 0) std::fill_n(slot(-1), slot_pixels_ * wide_, 0.0F);
    std::ptrdiff_t done = row0_;
    for (std::ptrdiff_t first = first_; first < end_; first += group_) {
      const std::ptrdiff_t end = std::min(first + group_, end_), ready = std::min(end - 1, row1_);
      widen(x, first, end);
      if (ready > done) use(done, ready);
      done = std::max(done, ready);
    }
    if (done == row1_) return;
    std::fill_n(slot(grid_.rows), slot_pixels_ * wide_, 0.0F);
    use(done, row1_);
  }

  // Wide values of rows [first, end); pixels outside of the picture are zeros.
  void widen(const float* x, std::ptrdiff_t first, std::ptrdiff_t end) {
    const std::ptrdiff_t left = std::max<std::ptrdiff_t>(col0_ - 1, 0),
                         right = std::min(col1_ + 1, grid_.cols), channels = grid_.channels,
                         inner = left - col0_ + 1;
    for (std::ptrdiff_t row = first; row < end;) {  // as far as slots follow one another
      const std::ptrdiff_t count = std::min(end - row, slots_ - (row - row0_ + 1) % slots_);
      MatrixProduct p{.rows = right - left, .a = x + place(row, left) * channels};
      p.a_row = p.ahead_row = channels;
      p.ahead = x + place(row + group_, left) * channels;
      p.c = slot(row) + inner * wide_;
      p.c_row = wide_;
      p.groups = count;
      p.a_group = p.ahead_group = grid_.cols * channels;
      p.c_group = slot_pixels_ * wide_;
      layer_.expand.run(p, normal_);
      row += count;
    }
    for (std::ptrdiff_t row = first; row < end; ++row) {
      if (layer_.gelu) gelu(slot(row) + inner * wide_, (right - left) * wide_);
      if (left == col0_) std::fill_n(slot(row), wide_, 0.0F);
      if (right == col1_) std::fill_n(slot(row) + (slot_pixels_ - 1) * wide_, wide_, 0.0F);
    }
  }

  void filter(std::ptrdiff_t first, std::ptrdiff_t end,
              const std::function<void(const StripPiece&)>& use) {
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

  void gate(std::ptrdiff_t first, std::ptrdiff_t end, const GateTarget& target) {
    const std::ptrdiff_t width = wide_ / 2;
    for (std::ptrdiff_t row = first; row < end; ++row) {
      const float* const rows[3] = {slot(row - 1), slot(row), slot(row + 1)};
      const std::ptrdiff_t piece =
          (image_ * grid_.rows + row) * grid_.chunks + task_ % grid_.chunks;
      depthwise_gate_row(rows, layer_.depthwise.weight.data_ptr<float>(),
                         layer_.depthwise.bias_data(), cols(), width,
                         target.gated + place(row, col0_) * width, target.sums + piece * width);
    }
  }

  const StripGrid& grid_;
  const StripLayer& layer_;
  std::ptrdiff_t task_, wide_, image_, row0_, row1_, col0_, col1_, slot_pixels_, first_, end_,
      group_, slots_;
  std::optional<Scratch> scratch_;
  float *normal_ = nullptr, *ring_ = nullptr, *filtered_ = nullptr;
};

// Means over the pixels of each picture, from sums of its pieces.
torch::Tensor means_of_sums(const torch::Tensor& sums, std::ptrdiff_t batch,
                            std::ptrdiff_t pixels) {
  const std::ptrdiff_t pieces = sums.size(0) / batch, width = sums.size(1);
  torch::Tensor means = torch::empty({batch, width}, torch::kFloat);
  std::vector<double> total(static_cast<std::size_t>(width));
  const float* from = sums.data_ptr<float>();
  for (std::ptrdiff_t image = 0; image < batch; ++image) {
    std::fill(total.begin(), total.end(), 0.0);
    for (std::ptrdiff_t piece = 0; piece < pieces; ++piece, from += width)
      for (std::ptrdiff_t c = 0; c < width; ++c)
        total[static_cast<std::size_t>(c)] += static_cast<double>(from[c]);
    for (std::ptrdiff_t c = 0; c < width; ++c)
      means.data_ptr<float>()[image * width + c] =
          static_cast<float>(total[static_cast<std::size_t>(c)] / static_cast<double>(pixels));
  }
  return means;
}

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

torch::Tensor strip_gate(const torch::Tensor& x, const StripLayer& layer,
                         const torch::Tensor& gated) {
  const StripGrid grid(x, layer);
  const torch::Tensor sums =
      torch::zeros({grid.batch * grid.rows * grid.chunks, layer.expand.cols() / 2});
  const GateTarget target{gated.data_ptr<float>(), sums.data_ptr<float>()};
  const float* data = x.data_ptr<float>();
  for_each_task(grid.batch * grid.bands * grid.chunks,
                [&](std::ptrdiff_t task) { StripTask(grid, layer, task).run(data, target); });
  return means_of_sums(sums, grid.batch, grid.rows * grid.cols);
}

torch::Tensor strip_feed_forward(const torch::Tensor& x, const StripLayer& layer,
                                 StripActivation activation, const PackedLinear& project,
                                 const torch::Tensor& into) {
  const std::ptrdiff_t channels = x.size(3);
  const torch::Tensor y = into.defined() ? into : torch::empty_like(x);
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
