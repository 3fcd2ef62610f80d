// Attention inside windows, one window at a time from the norm to the residual: its 64 pixels,
// their queries, keys and scores stay in the cache.
#pragma once

#include "malus/neural/internal/packed.h"
#include "malus/neural/internal/strips.h"

#include <optional>

namespace malus::internal {

/// SW-MA: pixels of a window attend to pixels (Swin).
struct PixelAttention {
  RowNorm norm;
  torch::Tensor modulator;  ///< [pixels, channels], added after the norm; or undefined
  PackedLinear to_qkv;      ///< queries, keys, values, each [heads, head's channels]
  torch::Tensor bias;       ///< [heads, pixels, pixels]: of relative positions
  PackedLinear project;
  std::ptrdiff_t heads = 1;
};

/// W-MSTA: channels of a head attend to channels, over a window's pixels.
struct ChannelAttention {
  RowNorm norm;
  PackedLinear to_qkv;  ///< as above; channels in the order of heads
  std::vector<float> temperature;
  PackedLinear project;  ///< takes channels in the order of heads
  std::ptrdiff_t heads = 1;
};

/// Whether the kernels do it: whole vectors in every head and window.
bool windows_apply(std::ptrdiff_t channels, std::ptrdiff_t heads, std::ptrdiff_t window);

/// x += attention of x in windows shifted by shift, then the same with channels (null: not).
/// x: [batch, rows, cols, channels], contiguous, rows and cols in multiples of window.
void attend_in_windows(const torch::Tensor& x, std::ptrdiff_t window, std::ptrdiff_t shift,
                       const PixelAttention& pixels, const ChannelAttention* channels);

/// A transformer's block: attention in windows, and what follows it in strips.
struct WindowBlock {
  PixelAttention pixels;
  std::optional<ChannelAttention> channels;
  StripLayer wide;
  PackedLinear project;
};

/// x as above -> the block's result, in place. spare: a tensor of x's size or undefined, which is
/// overwritten.
void filter_in_windows(const WindowBlock& block, std::ptrdiff_t window, std::ptrdiff_t shift,
                       torch::Tensor& x, torch::Tensor& spare);

}  // namespace malus::internal
