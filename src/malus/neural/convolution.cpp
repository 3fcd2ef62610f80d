#include "malus/neural/internal/convolution.h"

#include <algorithm>
#include <cstring>

namespace malus::internal {
namespace {

// Columns of a piece, most rows, and how many bytes its gathered input may take of the cache.
constexpr std::ptrdiff_t kCols = 64, kMostRows = 16, kPatchBytes = 384 * 1024;
// Pixels of a product without neighbours.
constexpr std::ptrdiff_t kPixels = 192;

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
  void gather(std::ptrdiff_t image, std::ptrdiff_t row, std::ptrdiff_t col, std::ptrdiff_t count,
              float* to) const {
    const std::ptrdiff_t begin = row < 0 || row >= rows
                                     ? count
                                     : std::clamp(-col, std::ptrdiff_t{0}, count),
                         end = std::clamp(cols - col, begin, count);
    std::fill_n(to, begin * channels(), 0.0F);
    std::fill_n(to + end * channels(), (count - end) * channels(), 0.0F);
    const std::ptrdiff_t pixel = (image * rows + row) * cols + col;
    if (second == nullptr) {
      std::copy_n(first + (pixel + begin) * first_channels, (end - begin) * first_channels,
                  to + begin * first_channels);
      return;
    }
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      float* at = to + i * channels();
      std::copy_n(first + (pixel + i) * first_channels, first_channels, at);
      std::copy_n(second + (pixel + i) * second_channels, second_channels, at + first_channels);
    }
  }
};

// Pieces of the output, and the gathered input of one.
struct Pieces {
  std::ptrdiff_t rows, cols, band, chunk, bands, chunks, patch_rows, patch_cols;
  Pieces(const PackedConvolution& layer, const Source& source) {
    rows = (source.rows + 2 * layer.padding - layer.rows) / layer.stride + 1;
    cols = (source.cols + 2 * layer.padding - layer.cols) / layer.stride + 1;
    chunks = (cols + kCols - 1) / kCols;
    chunk = (cols + chunks - 1) / chunks;
    patch_cols = (chunk - 1) * layer.stride + layer.cols;
    const std::ptrdiff_t row_bytes =
        patch_cols * source.channels() * static_cast<std::ptrdiff_t>(sizeof(float));
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
      leak(leak_of_activation) {}

torch::Tensor convolve(const PackedConvolution& layer, const torch::Tensor& x,
                       const torch::Tensor& more) {
  const Source source(x, more);
  const Pieces pieces(layer, source);
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
    const std::ptrdiff_t rows = std::min(pieces.band, pieces.rows - row0);
    const torch::Tensor patch =
        torch::empty({pieces.patch_rows * pieces.patch_cols * in}, torch::kFloat);
    float* values = patch.data_ptr<float>();
    for (std::ptrdiff_t r = 0; r < (rows - 1) * layer.stride + layer.rows; ++r)
      source.gather(image, row0 * layer.stride - layer.padding + r,
                    col0 * layer.stride - layer.padding, pieces.patch_cols,
                    values + r * pieces.patch_cols * in);
    MatrixProduct p = layer.taps.product();
    p.rows = std::min(pieces.chunk, pieces.cols - col0);
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

PackedDoubling::PackedDoubling(const torch::nn::ConvTranspose2d& layer) {
  for (std::int64_t r = 0; r < 2; ++r)
    for (std::int64_t c = 0; c < 2; ++c)
      corners[r][c] = {layer->weight.select(3, c).select(2, r).t(), layer->bias};
}

torch::Tensor double_size(const PackedDoubling& layer, const torch::Tensor& x) {
  const std::ptrdiff_t rows = x.size(1), cols = x.size(2), in = x.size(3),
                       out = layer.corners[0][0].cols();
  torch::Tensor y = torch::empty({x.size(0), 2 * rows, 2 * cols, out}, torch::kFloat);
  const float* from = x.data_ptr<float>();
  float* to = y.data_ptr<float>();
  const std::ptrdiff_t band = std::max<std::ptrdiff_t>(kPixels / cols, 1);
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
      multiply(p);
    }
  });
  return y;
}

void add_linear(const PackedLinear& layer, const torch::Tensor& x, const torch::Tensor& y) {
  const std::ptrdiff_t in = layer.inner(), out = layer.cols(), pixels = x.numel() / in;
  const float* from = x.data_ptr<float>();
  float* to = y.data_ptr<float>();
  for_each_task((pixels + kPixels - 1) / kPixels, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t first = task * kPixels;
    layer.run(from + first * in, std::min(kPixels, pixels - first), to + first * out, out, true);
  });
}

}  // namespace malus::internal
