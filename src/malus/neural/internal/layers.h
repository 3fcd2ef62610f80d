// Pieces that several networks share.
#pragma once

#include <functional>

#include <torch/torch.h>

namespace malus::internal {
struct PixelAttention;
struct RowNorm;
class PackedLinear;
struct StripLayer;
}  // namespace malus::internal

namespace malus {

/// Pads right and below to a multiple: by reflection where the picture is large enough, else by
/// repetition of the edge.
torch::Tensor pad_to_multiple(const torch::Tensor& x, std::int64_t multiple);

/// The same with zeros (NAFNet).
torch::Tensor zero_pad_to_multiple(const torch::Tensor& x, std::int64_t multiple);

/// x through a stage's blocks, of which there may be none: libtorch's own forward wants one.
torch::Tensor through(torch::nn::Sequential blocks, const torch::Tensor& x);

/// The same in place by the kernels: block->filter(x, spare) overwrites x and spare, a tensor of
/// its size or undefined, and leaves its result in x. So a stage takes memory for two tensors once.
template <class Block>
torch::Tensor filtered(const torch::nn::Sequential& blocks, torch::Tensor x) {
  torch::Tensor spare;
  for (const auto& block : blocks->children()) block->template as<Block>()->filter(x, spare);
  return x;
}

/// inside(windows, mask) on x [batch, rows, cols, channels] cut into windows of [batch * windows,
/// window², channels], put together again; sizes are multiples of window. The windows are shifted
/// by `shift` rows and columns, around the borders, and mask [windows, window², window²] (0 or
/// -100, to be added) keeps apart what only wrapping brought together; without a shift it is
/// undefined. Swin, Liu et al. ICCV 2021, 3.2.
torch::Tensor in_windows(
    torch::Tensor x, std::int64_t window, std::int64_t shift,
    const std::function<torch::Tensor(torch::Tensor windows, const torch::Tensor& mask)>& inside);

/// A layer norm for the kernels.
internal::RowNorm packed_norm(const torch::nn::LayerNorm& norm);

/// Multi-head attention inside windows with a relative position bias (Swin). Parameters as in
/// Uformer: qkv.to_q, qkv.to_kv, relative_position_bias_table, proj.
class WindowAttentionImpl : public torch::nn::Module {
 public:
  WindowAttentionImpl(std::int64_t dim, std::int64_t window, std::int64_t heads);
  /// x: [batch * windows, window², dim]; mask: undefined or [windows, window², window²].
  torch::Tensor forward(const torch::Tensor& x, const torch::Tensor& mask);
  /// The same for the kernels (internal/windows.h), with the norm before it.
  internal::PixelAttention packed(const torch::nn::LayerNorm& norm) const;

 private:
  torch::Tensor relative_bias() const;  ///< [heads, window², window²]

  std::int64_t heads_, head_dim_;
  torch::Tensor bias_table_, index_;
  torch::nn::Linear to_q_{nullptr}, to_kv_{nullptr}, proj_{nullptr};
};
TORCH_MODULE(WindowAttention);

/// Locally enhanced feed-forward (Uformer, LeFF): linear, GELU, depth-wise 3x3, GELU, linear.
/// Parameters linear1.0, dwconv.0, linear2.0. Works on [batch, rows, cols, channels].
class LeFFImpl : public torch::nn::Module {
 public:
  LeFFImpl(std::int64_t dim, std::int64_t hidden);
  torch::Tensor forward(const torch::Tensor& x);
  /// The same for the kernels (internal/strips.h), with the norm before it; and its last layer.
  internal::StripLayer packed(const torch::nn::LayerNorm& norm) const;
  internal::PackedLinear packed_project() const;

 private:
  torch::nn::Sequential linear1_{nullptr}, dwconv_{nullptr}, linear2_{nullptr};
};
TORCH_MODULE(LeFF);

}  // namespace malus
