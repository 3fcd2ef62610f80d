#include "malus/neural/internal/convolution.h"

#include "malus/base/error.h"
#include "malus/neural/internal/matrix_unit.h"
#include "malus/neural/internal/tasks.h"

#include <algorithm>
#include <cstring>

namespace malus::internal {
namespace {

// Columns of a piece, most rows, and how many bytes its gathered input may take of the cache.
constexpr std::ptrdiff_t kCols = 64, kMostRows = 16, kPatchBytes = 384 * 1024;
// Pixels of a product without neighbours.
constexpr std::ptrdiff_t kPixelsPerTask = 192;
// Winograd: most channels in and out, beyond which its 36 matrices of weights cost more than the
// multiplications that they save; tiles along a row; bytes of a task's elements in the cache.
constexpr std::ptrdiff_t kWinogradChannels = 384, kTileCols = 16, kElementBytes = 640 * 1024;
// Where products round, direct ones beat Winograd's in float32 below this many outputs (a tenth to
// a quarter slower above), in a matrix unit always; Winograd's of rounded values would lose five
// times as much accuracy.
constexpr std::ptrdiff_t kRoundedWinogradOutputs = 64;
constexpr std::ptrdiff_t kElements = 36, kTile = 4, kWindow = 6;

void copy_values(const float* from, std::ptrdiff_t count, float* to) {
  std::copy_n(from, count, to);
}
void copy_values(const float* from, std::ptrdiff_t count, Bfloat16* to) {
  round_values(from, count, to);
}

// Channels of one pixel, joined from two pictures.
struct Source {
  const float *first, *second;
  std::ptrdiff_t first_channels, second_channels, rows, cols;
  Source(const torch::Tensor& x, const torch::Tensor& more)
      : first(x.data_ptr<float>()),
        second(more.defined() ? more.data_ptr<float>() : nullptr),
        first_channels(x.size(3)),
        second_channels(more.defined() ? more.size(3) : 0),
        rows(x.size(1)),
        cols(x.size(2)) {}
  std::ptrdiff_t channels() const { return first_channels + second_channels; }

  // count pixels from (row, col) of an image; zeros outside.
  template <class Value>
  void gather(std::ptrdiff_t image, std::ptrdiff_t row, std::ptrdiff_t col, std::ptrdiff_t count,
              Value* to) const {
    const std::ptrdiff_t begin = row < 0 || row >= rows
                                     ? count
                                     : std::clamp(-col, std::ptrdiff_t{0}, count),
                         end = std::clamp(cols - col, begin, count);
    std::fill_n(to, begin * channels(), Value{0});
    std::fill_n(to + end * channels(), (count - end) * channels(), Value{0});
    const std::ptrdiff_t pixel = (image * rows + row) * cols + col;
    if (second == nullptr) {
      copy_values(first + (pixel + begin) * first_channels, (end - begin) * first_channels,
                  to + begin * first_channels);
      return;
    }
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      Value* at = to + i * channels();
      copy_values(first + (pixel + i) * first_channels, first_channels, at);
      copy_values(second + (pixel + i) * second_channels, second_channels, at + first_channels);
    }
  }
};

// Pieces of the output, and the gathered input of one.
struct Pieces {
  std::ptrdiff_t rows, cols, band, chunk, bands, chunks, patch_rows, patch_cols;
  Pieces(const PackedConvolution& layer, const Source& source, std::ptrdiff_t value_bytes) {
    rows = (source.rows + 2 * layer.padding - layer.rows) / layer.stride + 1;
    cols = (source.cols + 2 * layer.padding - layer.cols) / layer.stride + 1;
    chunks = (cols + kCols - 1) / kCols;
    chunk = (cols + chunks - 1) / chunks;
    patch_cols = (chunk - 1) * layer.stride + layer.cols;
    const std::ptrdiff_t row_bytes = patch_cols * source.channels() * value_bytes;
    band = std::clamp(kPatchBytes / (layer.stride * row_bytes), std::ptrdiff_t{2}, kMostRows);
    band = std::min(band, std::max<std::ptrdiff_t>(rows / 2, 1));
    patch_rows = (band - 1) * layer.stride + layer.rows;
    bands = (rows + band - 1) / band;
    chunks = (cols + chunk - 1) / chunk;
  }
};

}  // namespace

PackedConvolution::PackedConvolution(const torch::nn::Conv2d& layer, float leak_of_activation)
    : taps(layer->weight, layer->bias),
      rows(layer->weight.size(2)),
      cols(layer->weight.size(3)),
      stride(layer->options.stride()->at(0)),
      padding((rows - 1) / 2),
      leak(leak_of_activation) {
  const std::int64_t in = taps.inner(), out = taps.cols();
  const bool direct =
      taps.product().pairs != nullptr && (has_matrix_unit() || out < kRoundedWinogradOutputs);
  if (rows != 3 || cols != 3 || stride != 1 || in % kLane != 0 || out % kLane != 0 ||
      in + out > kWinogradChannels || direct)
    return;
  const auto g = torch::tensor({{1.0 / 4, 0.0, 0.0},
                                {-1.0 / 6, -1.0 / 6, -1.0 / 6},
                                {-1.0 / 6, 1.0 / 6, -1.0 / 6},
                                {1.0 / 24, 1.0 / 12, 1.0 / 6},
                                {1.0 / 24, -1.0 / 12, 1.0 / 6},
                                {0.0, 0.0, 1.0}},
                               torch::kDouble);
  const auto elements = torch::matmul(torch::matmul(g, layer->weight.to(torch::kDouble)), g.t())
                            .permute({2, 3, 1, 0})
                            .to(torch::kFloat)
                            .contiguous();  // [6, 6, in, out]
  winograd = torch::empty({kElements, in * out}, torch::kFloat);
  for (std::int64_t i = 0; i < kElements; ++i)
    pack_columns(elements.data_ptr<float>() + i * in * out, in, out, out, 1,
                 winograd.data_ptr<float>() + i * in * out);
}

namespace {

// One task of convolve_by_winograd: tiles of rows [row0, row1) and columns [col0, col1).
void winograd_task(const PackedConvolution& layer, const Source& source, std::ptrdiff_t image,
                   std::ptrdiff_t row0, std::ptrdiff_t row1, std::ptrdiff_t col0,
                   std::ptrdiff_t col1, float* y) {
  const std::ptrdiff_t in = source.channels(), out = layer.taps.cols();
  const std::ptrdiff_t down = (row1 - row0 + kTile - 1) / kTile,
                       across = (col1 - col0 + kTile - 1) / kTile, tiles = down * across;
  const std::ptrdiff_t patch_cols = kTile * across + 2, patch_rows = kTile * down + 2;
  Scratch scratch(patch_rows * patch_cols * in + kElements * tiles * (in + out));
  float *patch = scratch.take(patch_rows * patch_cols * in),
        *v = scratch.take(kElements * tiles * in), *m = scratch.take(kElements * tiles * out);
  for (std::ptrdiff_t r = 0; r < patch_rows; ++r)
    source.gather(image, row0 - 1 + r, col0 - 1, patch_cols, patch + r * patch_cols * in);
  for (std::ptrdiff_t i = 0; i < tiles; ++i)
    winograd_input(patch + (i / across * patch_cols + i % across) * kTile * in, patch_cols * in, in,
                   v + i * in, tiles * in);
  MatrixProduct p{.rows = tiles, .inner = in, .cols = out, .a_row = in};
  p.c_row = out;
  for (std::ptrdiff_t e = 0; e < kElements; ++e) {
    p.a = v + e * tiles * in;
    p.b = layer.winograd.data_ptr<float>() + e * in * out;
    p.c = m + e * tiles * out;
    multiply(p);
  }
  for (std::ptrdiff_t i = 0; i < tiles; ++i) {
    const std::ptrdiff_t row = row0 + i / across * kTile, col = col0 + i % across * kTile;
    winograd_output({.m = m + i * out,
                     .m_element = tiles * out,
                     .channels = out,
                     .bias = layer.taps.product().bias,
                     .leak = layer.leak,
                     .y = y + ((image * source.rows + row) * source.cols + col) * out,
                     .y_row = source.cols * out,
                     .rows = std::min(kTile, row1 - row),
                     .cols = std::min(kTile, col1 - col)});
  }
}

torch::Tensor convolve_by_winograd(const PackedConvolution& layer, const torch::Tensor& x,
                                   const Source& source) {
  const std::ptrdiff_t out = layer.taps.cols(), rows = source.rows, cols = source.cols;
  const std::ptrdiff_t tile_bytes =
      kElements * (source.channels() + out) * static_cast<std::ptrdiff_t>(sizeof(float));
  const std::ptrdiff_t tiles =
      std::clamp(kElementBytes / tile_bytes, std::ptrdiff_t{16}, std::ptrdiff_t{64});
  const std::ptrdiff_t chunks = (cols + kTile * kTileCols - 1) / (kTile * kTileCols);
  const std::ptrdiff_t across = ((cols + kTile - 1) / kTile + chunks - 1) / chunks;
  const std::ptrdiff_t chunk = kTile * across,
                       band = kTile * std::max<std::ptrdiff_t>(tiles / across, 1),
                       bands = (rows + band - 1) / band;
  torch::Tensor y = torch::empty({x.size(0), rows, cols, out}, torch::kFloat);
  float* to = y.data_ptr<float>();
  for_each_task(x.size(0) * bands * chunks, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t row = task / chunks % bands * band, col = task % chunks * chunk;
    if (col < cols)
      winograd_task(layer, source, task / (bands * chunks), row, std::min(row + band, rows), col,
                    std::min(col + chunk, cols), to);
  });
  return y;
}

// Windows gathered piece by piece: Value is that of the packed weights.
template <class Value>
torch::Tensor convolve_directly(const PackedConvolution& layer, const torch::Tensor& x,
                                const Source& source) {
  const Pieces pieces(layer, source, sizeof(Value));
  const std::ptrdiff_t in = source.channels(), out = layer.taps.cols();
  std::vector<std::ptrdiff_t> taps;
  for (std::ptrdiff_t r = 0; r < layer.rows; ++r)
    for (std::ptrdiff_t c = 0; c < layer.cols; ++c)
      taps.push_back((r * pieces.patch_cols + c) * in);
  torch::Tensor y = torch::empty({x.size(0), pieces.rows, pieces.cols, out}, torch::kFloat);
  float* to = y.data_ptr<float>();
  for_each_task(x.size(0) * pieces.bands * pieces.chunks, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t image = task / (pieces.bands * pieces.chunks),
                         row0 = task / pieces.chunks % pieces.bands * pieces.band,
                         col0 = task % pieces.chunks * pieces.chunk;
    const std::ptrdiff_t rows = std::min(pieces.band, pieces.rows - row0),
                         size = pieces.patch_rows * pieces.patch_cols * in;
    // One value more for products of pairs.
    const torch::Tensor patch =
        torch::empty({(size + 1) * static_cast<std::ptrdiff_t>(sizeof(Value))}, torch::kByte);
    auto* values = static_cast<Value*>(patch.data_ptr());
    values[size] = 0;
    for (std::ptrdiff_t r = 0; r < (rows - 1) * layer.stride + layer.rows; ++r)
      source.gather(image, row0 * layer.stride - layer.padding + r,
                    col0 * layer.stride - layer.padding, pieces.patch_cols,
                    values + r * pieces.patch_cols * in);
    MatrixProduct p = layer.taps.product();
    p.rows = std::min(pieces.chunk, pieces.cols - col0);
    if constexpr (std::is_same_v<Value, Bfloat16>)
      p.rounded = values;
    else
      p.a = values;
    p.a_row = layer.stride * in;
    p.taps = taps;
    p.c = to + ((image * pieces.rows + row0) * pieces.cols + col0) * out;
    p.c_row = out;
    p.groups = rows;
    p.a_group = layer.stride * pieces.patch_cols * in;
    p.c_group = pieces.cols * out;
    p.leak = layer.leak;
    multiply(p);
  });
  return y;
}

}  // namespace

torch::Tensor convolve(const PackedConvolution& layer, const torch::Tensor& x,
                       const torch::Tensor& more) {
  const Source source(x, more);
  if (layer.winograd.defined()) return convolve_by_winograd(layer, x, source);
  return layer.taps.product().pairs != nullptr ? convolve_directly<Bfloat16>(layer, x, source)
                                               : convolve_directly<float>(layer, x, source);
}

PackedDoubling::PackedDoubling(const torch::nn::ConvTranspose2d& layer) {
  for (std::int64_t r = 0; r < 2; ++r)
    for (std::int64_t c = 0; c < 2; ++c)
      corners[r][c] = {layer->weight.select(3, c).select(2, r).t(), layer->bias};
}

PackedDoubling::PackedDoubling(const torch::nn::Conv2d& shuffled) {
  const torch::Tensor weight = shuffled->weight.flatten(1).unflatten(0, {-1, 4});
  MALUS_REQUIRE(!shuffled->bias.defined());
  for (std::int64_t i = 0; i < 4; ++i) corners[i / 2][i % 2] = {weight.select(1, i), {}};
}

torch::Tensor double_size(const PackedDoubling& layer, const torch::Tensor& x,
                          const torch::Tensor& onto) {
  const std::ptrdiff_t rows = x.size(1), cols = x.size(2), in = x.size(3),
                       out = layer.corners[0][0].cols();
  torch::Tensor y =
      onto.defined() ? onto : torch::empty({x.size(0), 2 * rows, 2 * cols, out}, torch::kFloat);
  const float* from = x.data_ptr<float>();
  float* to = y.data_ptr<float>();
  const std::ptrdiff_t band = std::max<std::ptrdiff_t>(kPixelsPerTask / cols, 1);
  for_each_task((x.size(0) * rows + band - 1) / band, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t row0 = task * band, count = std::min(band, x.size(0) * rows - row0);
    for (std::ptrdiff_t corner = 0; corner < 4; ++corner) {
      MatrixProduct p = layer.corners[corner / 2][corner % 2].product();
      p.rows = cols;
      p.a = from + row0 * cols * in;
      p.a_row = in;
      p.c = to + ((2 * row0 + corner / 2) * 2 * cols + corner % 2) * out;
      p.c_row = 2 * out;
      p.groups = count;
      p.a_group = cols * in;
      p.c_group = 4 * cols * out;
      p.add = onto.defined();
      multiply(p);
    }
  });
  return y;
}

void add_linear(const PackedLinear& layer, const torch::Tensor& x, const torch::Tensor& y) {
  const std::ptrdiff_t in = layer.inner(), out = layer.cols(), pixels = x.numel() / in;
  const float* from = x.data_ptr<float>();
  float* to = y.data_ptr<float>();
  for_each_task((pixels + kPixelsPerTask - 1) / kPixelsPerTask, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t first = task * kPixelsPerTask;
    layer.run(from + first * in, std::min(kPixelsPerTask, pixels - first), to + first * out, out,
              true);
  });
}

}  // namespace malus::internal
