// A linear layer with a depth-wise 3x3 convolution after it, over strips of a picture, so that the
// wide values between them live in the cache only: the heart of LeFF (Uformer), of Restormer's
// attention and feed-forward and of NAFNet's first half.
#pragma once

#include "malus/neural/internal/packed.h"

#include <functional>

namespace malus::internal {

/// norm and expand -> (gelu) -> depth-wise 3x3.
struct StripLayer {
  NormedLinear expand;  ///< outputs in multiples of kLane
  bool gelu = false;
  PackedDepthwise depthwise;
};

/// A piece of a picture whose wide values are ready.
struct StripPiece {
  std::ptrdiff_t task;    ///< < strip_tasks: for sums that are folded in order
  std::ptrdiff_t pixel;   ///< the first one's place in [batch, rows, cols]
  std::ptrdiff_t pixels;  ///< that follow one another there
  float* wide;            ///< [pixels, expand.cols()]
};

/// How many tasks a picture [batch, rows, cols, channels] is cut into; depends on its size alone.
std::ptrdiff_t strip_tasks(const torch::Tensor& x);

/// Calls use for all pieces of x (contiguous, channels last), each once, on many threads; it may
/// overwrite the wide values.
void for_each_strip(const torch::Tensor& x, const StripLayer& layer,
                    const std::function<void(const StripPiece&)>& use);

/// gated (of x's size) = first half · second half of the wide values; returns the means of its
/// channels [batch, channels], the same for any number of threads. Not with gelu.
torch::Tensor strip_gate(const torch::Tensor& x, const StripLayer& layer,
                         const torch::Tensor& gated);

/// x + project(activation(strip)), where the activation is gelu, or halves the values by gating;
/// into another tensor of x's size where one is given.
enum class StripActivation { kGelu, kGateWithGelu };
torch::Tensor strip_feed_forward(const torch::Tensor& x, const StripLayer& layer,
                                 StripActivation activation, const PackedLinear& project,
                                 const torch::Tensor& into = {});

}  // namespace malus::internal
