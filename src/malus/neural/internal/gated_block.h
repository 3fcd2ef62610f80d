// NAFNet's block (Chen et al., ECCV 2022) for the kernels of a forward pass.
#pragma once

#include "malus/neural/internal/strips.h"

namespace malus::internal {

/// x += project(attention · gate(depthwise(widen(norm x)))), then
/// x += narrow(gate(feed_forward(norm x))), where the attention is a linear layer of the gated
/// values' means over the picture. Channels in multiples of kLane.
struct GatedBlock {
  StripLayer wide;            ///< twice the channels
  PackedLinear attention;     ///< in float32: few values that scale all others
  PackedLinear project;       ///< with the residual's scale, as narrow
  NormedLinear feed_forward;  ///< gated
  PackedLinear narrow;

  /// x: [batch, rows, cols, channels], contiguous, in place.
  void filter(const torch::Tensor& x) const;

 private:
  void second_half(float* x, const float* gated, const float* factors, std::ptrdiff_t pixels) const;
};

}  // namespace malus::internal
