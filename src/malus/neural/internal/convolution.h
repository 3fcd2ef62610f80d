// Convolutions of pictures with their channels last, [batch, rows, cols, channels], contiguous, as
// products over windows that are gathered piece by piece.
#pragma once

#include "malus/neural/internal/packed.h"

namespace malus::internal {

/// A convolution with its activation. Padding is (size - 1) / 2 on all sides: so do the networks'
/// layers of 1x1, 3x3, 2x2 with stride 2 and 4x4 with stride 2.
struct PackedConvolution {
  PackedLinear taps;
  std::ptrdiff_t rows = 1, cols = 1, stride = 1, padding = 0;
  float leak = 1;  ///< y -> max(y, leak · y)
  /// For 3x3 with stride 1 and few enough channels: the weights of the 36 elements of Winograd's
  /// F(4x4, 3x3), packed one after the other.
  torch::Tensor winograd;

  PackedConvolution() = default;
  explicit PackedConvolution(const torch::nn::Conv2d& layer, float leak_of_activation = 1);
};

/// The channels of more follow those of x; more may be undefined.
torch::Tensor convolve(const PackedConvolution& layer, const torch::Tensor& x,
                       const torch::Tensor& more = {});

/// A transposed convolution of 2x2 with stride 2, or a 1x1 convolution whose channels a pixel
/// shuffle of 2 spreads: every pixel becomes four.
struct PackedDoubling {
  PackedLinear corners[2][2];

  PackedDoubling() = default;
  explicit PackedDoubling(const torch::nn::ConvTranspose2d& layer);
  explicit PackedDoubling(const torch::nn::Conv2d& shuffled);
};
/// onto (or undefined): a picture of the result's size that it is added to, in place.
torch::Tensor double_size(const PackedDoubling& layer, const torch::Tensor& x,
                          const torch::Tensor& onto = {});

/// y += linear(x) of every pixel.
void add_linear(const PackedLinear& layer, const torch::Tensor& x, const torch::Tensor& y);

/// The same picture with channels last, without a copy where it is so already; and back.
inline torch::Tensor channels_last(const torch::Tensor& x) {
  return x.permute({0, 2, 3, 1}).contiguous();
}
inline torch::Tensor channels_first(const torch::Tensor& x) { return x.permute({0, 3, 1, 2}); }

}  // namespace malus::internal
