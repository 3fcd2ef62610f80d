// Attention of one window's heads in the processor's matrix unit: queries, keys, values and weights
// are rounded to bfloat16, scores, softmax and sums are float32.
#pragma once

#include <cstddef>

namespace malus::internal {

/// One window: rows of queries, keys and values, each [heads, width]; what comes out is [pixels,
/// heads, width]. pixels and width in multiples of kLane (kernels.h).
struct WindowHeads {
  std::ptrdiff_t pixels = 0, heads = 1, width = 0;
  const float* qkv = nullptr;
  float* mixed = nullptr;
  float* memory = nullptr;  ///< attention_memory values, aligned for vectors
};
std::ptrdiff_t attention_memory(std::ptrdiff_t pixels, std::ptrdiff_t width);

/// mixed = softmax over pixels of (q · k · scale + bias) · v; bias [heads, pixels, pixels]. labels
/// (null: none): as in softmax_rows (kernels.h). Needs has_matrix_unit().
void attend_pixels_in_unit(const WindowHeads& window, float scale, const float* bias,
                           const float* labels);
/// The same among a head's channels, over the window's pixels: queries and keys are brought to
/// length 1 there, and scores are multiplied by their head's temperature. Needs has_matrix_unit().
void attend_channels_in_unit(const WindowHeads& window, const float* temperatures);

}  // namespace malus::internal
