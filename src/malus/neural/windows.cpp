#include "malus/neural/internal/windows.h"

#include "malus/neural/internal/matrix_unit.h"
#include "malus/neural/internal/tasks.h"
#include "malus/neural/internal/window_attention.h"

#include <algorithm>
#include <cmath>
#include <cstring>

namespace malus::internal {
namespace {

// One window's memory: values [pixels, channels], and what attention needs.
struct WindowBuffers {
  std::ptrdiff_t pixels, channels;
  float *x, *normal, *qkv, *mixed, *scores, *labels, *keys, *factors, *unit;
  WindowBuffers(std::ptrdiff_t pixel_count, std::ptrdiff_t channel_count, std::ptrdiff_t side,
                std::ptrdiff_t unit_values, Scratch& scratch)
      : pixels(pixel_count), channels(channel_count) {
    x = scratch.take(pixels * channels);
    normal = scratch.take(pixels * channels);
    qkv = scratch.take(3 * pixels * channels);
    mixed = scratch.take(pixels * channels);
    scores = scratch.take(side * side);
    labels = scratch.take(pixels);
    keys = scratch.take(side * side);
    factors = scratch.take(2 * channels);
    unit = scratch.take(unit_values);
  }
  static std::ptrdiff_t size(std::ptrdiff_t pixels, std::ptrdiff_t channels, std::ptrdiff_t side,
                             std::ptrdiff_t unit_values) {
    return 6 * pixels * channels + 2 * side * side + pixels + 2 * channels + unit_values +
           9 * kLane;
  }
};

// Whether what the layer gives is multiplied further in the matrix unit.
bool attends_in_unit(const PackedLinear& to_qkv) { return to_qkv.rounded() && has_matrix_unit(); }

WindowHeads heads_of(const WindowBuffers& w, std::ptrdiff_t heads) {
  return {w.pixels, heads, w.channels / heads, w.qkv, w.mixed, w.unit};
}

// What lies between the products before and after: of queries and keys scores, of these weights,
// and values mixed by them.
void mix_pixels(const PixelAttention& layer, bool masked, const WindowBuffers& w) {
  const std::ptrdiff_t n = w.pixels, width = w.channels / layer.heads, row = 3 * w.channels;
  const float scale = 1 / std::sqrt(static_cast<float>(width));
  if (attends_in_unit(layer.to_qkv))
    return attend_pixels_in_unit(heads_of(w, layer.heads), scale, layer.bias.data_ptr<float>(),
                                 masked ? w.labels : nullptr);
  for (std::ptrdiff_t head = 0; head < layer.heads; ++head) {
    const float *q = w.qkv + head * width, *k = q + w.channels, *v = k + w.channels;
    pack_columns(k, width, n, 1, row, w.keys);
    MatrixProduct scores{.rows = n, .inner = width, .cols = n, .a = q, .a_row = row};
    scores.b = w.keys;
    scores.c = w.scores;
    scores.c_row = n;
    multiply(scores);
    softmax_rows(w.scores, n, n, scale, layer.bias.data_ptr<float>() + head * n * n,
                 masked ? w.labels : nullptr);
    MatrixProduct mix{.rows = n, .inner = n, .cols = width, .a = w.scores, .a_row = n};
    mix.b = v;
    mix.b_inner = row;
    mix.c = w.mixed + head * width;
    mix.c_row = w.channels;
    multiply(mix);
  }
}

// Pixels attend to pixels; masked: labels tell parts of the picture apart.
void attend_pixels(const PixelAttention& layer, bool masked, const WindowBuffers& w) {
  normalize_rows(layer.norm, w.x, w.channels, w.pixels, w.channels, w.normal);
  if (layer.modulator.defined())
    add_scaled(w.normal, layer.modulator.data_ptr<float>(), 1, w.pixels * w.channels);
  layer.to_qkv.run(w.normal, w.pixels, w.qkv, 3 * w.channels);
  mix_pixels(layer, masked, w);
  layer.project.run(w.mixed, w.pixels, w.x, w.channels, true);
}

// Brings columns of queries and keys to length 1 over the window's pixels.
void unit_columns(float* values, std::ptrdiff_t row, std::ptrdiff_t pixels, std::ptrdiff_t count,
                  float* factors) {
  std::fill_n(factors, count, 0.0F);
  add_columns(values, row, pixels, count, true, factors);
  for (std::ptrdiff_t c = 0; c < count; ++c)
    factors[c] = 1 / std::max(std::sqrt(factors[c]), 1e-6F);
  scale_columns(values, row, pixels, count, factors, values, row);
}

void mix_channels(const ChannelAttention& layer, const WindowBuffers& w) {
  const std::ptrdiff_t n = w.pixels, width = w.channels / layer.heads, row = 3 * w.channels;
  if (attends_in_unit(layer.to_qkv))
    return attend_channels_in_unit(heads_of(w, layer.heads), layer.temperature.data());
  unit_columns(w.qkv, row, n, 2 * w.channels, w.factors);
  for (std::ptrdiff_t head = 0; head < layer.heads; ++head) {
    const float *q = w.qkv + head * width, *k = q + w.channels, *v = k + w.channels;
    // scores[i, j] = Σ over pixels of q[p, i] k[p, j]
    MatrixProduct scores{.rows = width, .inner = n, .cols = width, .a = q, .a_row = 1};
    scores.a_inner = row;
    scores.b = k;
    scores.b_inner = row;
    scores.c = w.scores;
    scores.c_row = width;
    multiply(scores);
    softmax_rows(w.scores, width, width, layer.temperature[static_cast<std::size_t>(head)], nullptr,
                 nullptr);
    // mixed[p, i] = Σ over channels of scores[i, j] v[p, j]
    pack_columns(w.scores, width, width, 1, width, w.keys);
    MatrixProduct mix{.rows = n, .inner = width, .cols = width, .a = v, .a_row = row};
    mix.b = w.keys;
    mix.c = w.mixed + head * width;
    mix.c_row = w.channels;
    multiply(mix);
  }
}

void attend_channels(const ChannelAttention& layer, const WindowBuffers& w) {
  normalize_rows(layer.norm, w.x, w.channels, w.pixels, w.channels, w.normal);
  layer.to_qkv.run(w.normal, w.pixels, w.qkv, 3 * w.channels);
  mix_channels(layer, w);
  layer.project.run(w.mixed, w.pixels, w.x, w.channels, true);
}

}  // namespace

bool windows_apply(std::ptrdiff_t channels, std::ptrdiff_t heads, std::ptrdiff_t window) {
  return channels % heads == 0 && channels / heads % kLane == 0 && window * window % kLane == 0;
}

void attend_in_windows(const torch::Tensor& x, std::ptrdiff_t window, std::ptrdiff_t shift,
                       const PixelAttention& pixels, const ChannelAttention* channels) {
  const std::ptrdiff_t rows = x.size(1), cols = x.size(2), width = x.size(3);
  const std::ptrdiff_t down = rows / window, n = window * window,
                       side = whole_lanes(std::max(n, width / pixels.heads)),
                       unit = attends_in_unit(pixels.to_qkv)
                                  ? attention_memory(n, width / pixels.heads)
                                  : 0;
  float* values = x.data_ptr<float>();
  const auto bytes = sizeof(float) * static_cast<std::size_t>(width);
  // A row of windows at a time.
  for_each_task(x.size(0) * down, [&](std::ptrdiff_t task) {
    Scratch scratch(WindowBuffers::size(n, width, side, unit));
    const WindowBuffers w(n, width, side, unit, scratch);
    const std::ptrdiff_t image = task / down, top = task % down * window;
    std::vector<std::ptrdiff_t> place(static_cast<std::size_t>(n));
    for (std::ptrdiff_t left = 0; left < cols; left += window) {
      for (std::ptrdiff_t i = 0; i < n; ++i) {
        const std::ptrdiff_t r = top + i / window, c = left + i % window;
        const auto at = static_cast<std::size_t>(i);
        place[at] = ((image * rows + (r + shift) % rows) * cols + (c + shift) % cols) * width;
        // Swin's regions: what the shift has wrapped to the last window's far side is another part.
        w.labels[i] = (r >= rows - shift ? 2.0F : 0.0F) + (c >= cols - shift ? 1.0F : 0.0F);
        std::memcpy(w.x + i * width, values + place[at], bytes);
      }
      attend_pixels(pixels, shift > 0 && (top + window == rows || left + window == cols), w);
      if (channels != nullptr) attend_channels(*channels, w);
      for (std::ptrdiff_t i = 0; i < n; ++i)
        std::memcpy(values + place[static_cast<std::size_t>(i)], w.x + i * width, bytes);
    }
  });
}

void filter_in_windows(const WindowBlock& block, std::ptrdiff_t window, std::ptrdiff_t shift,
                       torch::Tensor& x, torch::Tensor& spare) {
  attend_in_windows(x, window, shift, block.pixels, block.channels ? &*block.channels : nullptr);
  spare = strip_feed_forward(x, block.wide, StripActivation::kGelu, block.project, spare);
  std::swap(x, spare);
}

}  // namespace malus::internal
