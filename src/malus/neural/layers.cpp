#include "malus/neural/internal/layers.h"

#include "malus/neural/internal/strips.h"
#include "malus/neural/internal/windows.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

namespace F = torch::nn::functional;

torch::Tensor padded(const torch::Tensor& x, std::int64_t multiple, bool zeros) {
  const auto down = (multiple - x.size(2) % multiple) % multiple,
             right = (multiple - x.size(3) % multiple) % multiple;
  if (down == 0 && right == 0) return x;
  auto options = F::PadFuncOptions({0, right, 0, down});
  if (zeros) return F::pad(x, options);
  if (down < x.size(2) && right < x.size(3)) return F::pad(x, options.mode(torch::kReflect));
  return F::pad(x, options.mode(torch::kReplicate));
}

// Index of every pair of window positions into the table of (2w-1)² offsets, row offset major
// (Swin).
torch::Tensor relative_positions(std::int64_t window) {
  const auto n = window * window;
  auto index = torch::empty({n, n}, torch::kLong);
  auto at = index.accessor<std::int64_t, 2>();
  for (std::int64_t i = 0; i < n; ++i)
    for (std::int64_t j = 0; j < n; ++j)
      at[i][j] = (i / window - j / window + window - 1) * (2 * window - 1) +
                 (i % window - j % window + window - 1);
  return index;
}

torch::Tensor to_windows(const torch::Tensor& x, std::int64_t window) {
  const auto rows = x.size(1) / window, cols = x.size(2) / window, channels = x.size(3);
  return x.view({x.size(0), rows, window, cols, window, channels})
      .permute({0, 1, 3, 2, 4, 5})
      .reshape({-1, window * window, channels});
}

torch::Tensor from_windows(const torch::Tensor& windows, std::int64_t window, std::int64_t rows,
                           std::int64_t cols) {
  const auto channels = windows.size(2);
  return windows.view({-1, rows / window, cols / window, window, window, channels})
      .permute({0, 1, 3, 2, 4, 5})
      .reshape({-1, rows, cols, channels});
}

// Additive, for windows whose parts lie apart.
torch::Tensor shift_mask(std::int64_t rows, std::int64_t cols, std::int64_t window,
                         std::int64_t shift, const torch::TensorOptions& options) {
  auto region = torch::zeros({1, rows, cols, 1}, options);
  const std::array<std::array<std::int64_t, 2>, 3> row_parts = {
      {{0, rows - window}, {rows - window, rows - shift}, {rows - shift, rows}}};
  const std::array<std::array<std::int64_t, 2>, 3> col_parts = {
      {{0, cols - window}, {cols - window, cols - shift}, {cols - shift, cols}}};
  int label = 0;
  for (const auto& r : row_parts)
    for (const auto& c : col_parts) region.slice(1, r[0], r[1]).slice(2, c[0], c[1]).fill_(label++);
  const auto labels = to_windows(region, window).squeeze(2);
  const auto differ = labels.unsqueeze(1) != labels.unsqueeze(2);
  return torch::zeros(differ.sizes(), options).masked_fill_(differ, -100.0);
}

}  // namespace

torch::Tensor pad_to_multiple(const torch::Tensor& x, std::int64_t multiple) {
  return padded(x, multiple, false);
}
torch::Tensor zero_pad_to_multiple(const torch::Tensor& x, std::int64_t multiple) {
  return padded(x, multiple, true);
}

torch::Tensor through(torch::nn::Sequential blocks, const torch::Tensor& x) {
  return blocks->is_empty() ? x : blocks->forward(x);
}

torch::Tensor in_windows(
    torch::Tensor x, std::int64_t window, std::int64_t shift,
    const std::function<torch::Tensor(torch::Tensor windows, const torch::Tensor& mask)>& inside) {
  const auto rows = x.size(1), cols = x.size(2);
  torch::Tensor mask;
  if (shift > 0) {
    x = torch::roll(x, {-shift, -shift}, {1, 2});
    mask = shift_mask(rows, cols, window, shift, x.options().requires_grad(false));
  }
  x = from_windows(inside(to_windows(x, window), mask), window, rows, cols);
  return shift > 0 ? torch::roll(x, {shift, shift}, {1, 2}) : x;
}

internal::RowNorm packed_norm(const torch::nn::LayerNorm& norm) {
  return {norm->weight.data_ptr<float>(), norm->bias.data_ptr<float>(),
          static_cast<float>(norm->options.eps())};
}

WindowAttentionImpl::WindowAttentionImpl(std::int64_t dim, std::int64_t window, std::int64_t heads)
    : heads_(heads), head_dim_(dim / heads) {
  bias_table_ =
      register_parameter("relative_position_bias_table",
                         0.02 * torch::randn({(2 * window - 1) * (2 * window - 1), heads}));
  index_ = register_buffer("relative_position_index", relative_positions(window));
  const auto qkv = register_module("qkv", std::make_shared<torch::nn::Module>());
  to_q_ = qkv->register_module("to_q", torch::nn::Linear(dim, dim));
  to_kv_ = qkv->register_module("to_kv", torch::nn::Linear(dim, 2 * dim));
  proj_ = register_module("proj", torch::nn::Linear(dim, dim));
}

torch::Tensor WindowAttentionImpl::forward(const torch::Tensor& x, const torch::Tensor& mask) {
  const auto batch = x.size(0), n = x.size(1), dim = x.size(2);
  const auto split = [&](const torch::Tensor& t) {
    return t.view({batch, n, heads_, head_dim_}).transpose(1, 2);
  };
  const auto q = split(to_q_(x)) * (1.0 / std::sqrt(static_cast<double>(head_dim_)));
  const auto kv = to_kv_(x).chunk(2, -1);
  auto attention = torch::matmul(q, split(kv[0]).transpose(-2, -1));
  attention = attention + relative_bias().unsqueeze(0);
  if (mask.defined()) {
    const auto windows = mask.size(0);
    attention =
        (attention.view({batch / windows, windows, heads_, n, n}) + mask.unsqueeze(1).unsqueeze(0))
            .view({batch, heads_, n, n});
  }
  const auto mixed = torch::matmul(torch::softmax(attention, -1), split(kv[1]));
  return proj_(mixed.transpose(1, 2).reshape({batch, n, dim}));
}

torch::Tensor WindowAttentionImpl::relative_bias() const {
  const auto n = index_.size(0);
  return bias_table_.index({index_.view(-1).to(torch::kLong)})
      .view({n, n, heads_})
      .permute({2, 0, 1});
}

internal::PixelAttention WindowAttentionImpl::packed(const torch::nn::LayerNorm& norm) const {
  return {packed_norm(norm),
          {},
          {torch::cat({to_q_->weight, to_kv_->weight}), torch::cat({to_q_->bias, to_kv_->bias})},
          relative_bias().contiguous(),
          {proj_->weight, proj_->bias},
          heads_};
}

LeFFImpl::LeFFImpl(std::int64_t dim, std::int64_t hidden) {
  using namespace torch::nn;
  linear1_ = register_module("linear1", Sequential(Linear(dim, hidden), GELU()));
  dwconv_ = register_module(
      "dwconv",
      Sequential(Conv2d(Conv2dOptions(hidden, hidden, 3).padding(1).groups(hidden)), GELU()));
  linear2_ = register_module("linear2", Sequential(Linear(hidden, dim)));
}

torch::Tensor LeFFImpl::forward(const torch::Tensor& x) {
  const auto wide = linear1_->forward(x).permute({0, 3, 1, 2});
  return linear2_->forward(dwconv_->forward(wide).permute({0, 2, 3, 1}));
}

internal::StripLayer LeFFImpl::packed(const torch::nn::LayerNorm& norm) const {
  const auto& wide = *linear1_->ptr(0)->as<torch::nn::Linear>();
  const auto& depthwise = *dwconv_->ptr(0)->as<torch::nn::Conv2d>();
  return {{packed_norm(norm), wide.weight, wide.bias}, true, {depthwise.weight, depthwise.bias}};
}

internal::PackedLinear LeFFImpl::packed_project() const {
  const auto& narrow = *linear2_->ptr(0)->as<torch::nn::Linear>();
  return {narrow.weight, narrow.bias};
}

}  // namespace malus
