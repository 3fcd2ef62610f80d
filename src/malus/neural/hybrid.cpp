#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/layers.h"
#include "malus/neural/internal/strips.h"
#include "malus/neural/internal/windows.h"
#include "malus/neural/networks.h"

#include <utility>

namespace malus {
namespace {

using namespace torch::nn;

// W-MSTA: window-based multi-shuffled-heads transposed attention (000, 5.2). Inside each window
// channels attend to channels; a channel shuffle before the split gives every head channels of all
// groups, so heads mix colours and angles.
class ShuffledTransposedAttentionImpl : public Module {
 public:
  ShuffledTransposedAttentionImpl(std::int64_t dim, std::int64_t heads) : heads_(heads) {
    temperature_ = register_parameter("temperature", torch::ones({heads, 1, 1}));
    qkv_ = register_module("qkv", Linear(LinearOptions(dim, 3 * dim).bias(false)));
    proj_ = register_module("proj", Linear(dim, dim));
  }
  // x: [windows, pixels, dim]
  torch::Tensor forward(const torch::Tensor& x) {
    const auto windows = x.size(0), pixels = x.size(1), dim = x.size(2);
    // Channel c goes to head c % heads: the split after a shuffle, without moving memory first.
    const auto heads = [&](const torch::Tensor& t) {
      return t.view({windows, pixels, dim / heads_, heads_}).permute({0, 3, 2, 1});
    };
    const auto unit = [](const torch::Tensor& t) {
      return t / t.norm(2, -1, true).clamp_min(1e-6);
    };
    const auto parts = qkv_(x).chunk(3, -1);
    const auto q = unit(heads(parts[0])), k = unit(heads(parts[1])), v = heads(parts[2]);
    const auto attention = torch::softmax(torch::matmul(q, k.transpose(-2, -1)) * temperature_, -1);
    const auto mixed =
        torch::matmul(attention, v).permute({0, 3, 2, 1}).reshape({windows, pixels, dim});
    return proj_(mixed);
  }
  // The same for the kernels, with the norm before it: the shuffle is in the order of the weights.
  internal::ChannelAttention packed(const LayerNorm& norm) const {
    const auto dim = proj_->weight.size(0);
    const auto order = torch::arange(dim).view({dim / heads_, heads_}).t().reshape(-1);
    const auto temperature = temperature_.detach().reshape(-1).contiguous();
    return {packed_norm(norm),
            {qkv_->weight.view({3, dim, dim}).index_select(1, order).reshape({3 * dim, dim}), {}},
            {temperature.data_ptr<float>(), temperature.data_ptr<float>() + heads_},
            {proj_->weight.index_select(1, order), proj_->bias},
            heads_};
  }

 private:
  std::int64_t heads_;
  torch::Tensor temperature_;
  Linear qkv_{nullptr}, proj_{nullptr};
};
TORCH_MODULE(ShuffledTransposedAttention);

// SW-MA, then W-MSTA, then the locally enhanced MLP, each with its norm and residual; on [batch,
// rows, cols, channels].
class HybridBlockImpl : public Module {
 public:
  HybridBlockImpl(std::int64_t dim, std::int64_t heads, std::int64_t window, std::int64_t shift)
      : heads_(heads), window_(window), shift_(shift) {
    norm1_ = register_module("norm1", LayerNorm(LayerNormOptions({dim})));
    sw_ma_ = register_module("sw_ma", WindowAttention(dim, window, heads));
    norm2_ = register_module("norm2", LayerNorm(LayerNormOptions({dim})));
    w_msta_ = register_module("w_msta", ShuffledTransposedAttention(dim, heads));
    norm3_ = register_module("norm3", LayerNorm(LayerNormOptions({dim})));
    mlp_ = register_module("mlp", LeFF(dim, 2 * dim));
  }
  torch::Tensor forward(torch::Tensor x) {
    x = in_windows(std::move(x), window_, shift_,
                   [&](torch::Tensor windows, const torch::Tensor& mask) {
                     windows = windows + sw_ma_(norm1_(windows), mask);
                     return windows + w_msta_(norm2_(windows));
                   });
    return x + mlp_(norm3_(x));
  }
  void filter(torch::Tensor& x, torch::Tensor& spare) {
    if (!internal::windows_apply(x.size(3), heads_, window_)) {
      x = forward(x).contiguous();
      return;
    }
    const internal::WindowBlock& packed = packed_.of(*this, [&] {
      return internal::WindowBlock{sw_ma_->packed(norm1_), w_msta_->packed(norm2_),
                                   mlp_->packed(norm3_), mlp_->packed_project()};
    });
    internal::filter_in_windows(packed, window_, shift_, x, spare);
  }

 private:
  std::int64_t heads_, window_, shift_;
  internal::Cached<internal::WindowBlock> packed_;
  LayerNorm norm1_{nullptr}, norm2_{nullptr}, norm3_{nullptr};
  WindowAttention sw_ma_{nullptr};
  ShuffledTransposedAttention w_msta_{nullptr};
  LeFF mlp_{nullptr};
};
TORCH_MODULE(HybridBlock);

class Hybrid final : public Network {
 public:
  explicit Hybrid(const nlohmann::json& s) : settings_(s), window_(s.at("window")) {
    const std::int64_t in = s.at("in_channels"), out = s.at("out_channels"), dim = s.at("dim");
    const auto stages = static_cast<std::int64_t>(s.at("depths").size());
    embed_ = register_module("embed", Conv2d(Conv2dOptions(in, dim, 3).padding(1)));
    for (std::int64_t i = 0; i < stages; ++i) {
      encoders_.push_back(register_module("encoder_" + std::to_string(i + 1), blocks(dim << i, i)));
      if (i + 1 < stages)
        downs_.push_back(
            register_module("down_" + std::to_string(i + 1),
                            Conv2d(Conv2dOptions(dim << i, dim << (i + 1), 2).stride(2))));
    }
    for (std::int64_t i = stages - 2; i >= 0; --i) {
      const auto number = std::to_string(i + 1);
      ups_.push_back(register_module(
          "up_" + number,
          ConvTranspose2d(ConvTranspose2dOptions(dim << (i + 1), dim << i, 2).stride(2))));
      merges_.push_back(register_module("merge_" + number, Linear(dim << (i + 1), dim << i)));
      decoders_.push_back(register_module("decoder_" + number, blocks(dim << i, i)));
    }
    output_ = register_module("output", Conv2d(Conv2dOptions(dim, out, 3).padding(1)));
  }

  torch::Tensor forward(torch::Tensor input) override {
    const auto rows = input.size(2), cols = input.size(3);
    input = pad_to_multiple(input, window_ << (encoders_.size() - 1));
    const auto y = internal::kernels_apply(input) ? with_kernels(input) : with_layers(input);
    return y.slice(2, 0, rows).slice(3, 0, cols);
  }

 private:
  // Conditioning planes may follow the picture: the residual is on the picture's channels.
  torch::Tensor with_layers(const torch::Tensor& input) {
    auto x = embed_(input).permute({0, 2, 3, 1});
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_.size(); ++i) {
      if (i > 0) x = downs_[i - 1](x.permute({0, 3, 1, 2})).permute({0, 2, 3, 1});
      x = encoders_[i]->forward(x);
      skips.push_back(x);
    }
    for (std::size_t i = 0; i < decoders_.size(); ++i) {
      const auto up = ups_[i](x.permute({0, 3, 1, 2})).permute({0, 2, 3, 1});
      x = decoders_[i]->forward(merges_[i](torch::cat({up, skips[skips.size() - 2 - i]}, 3)));
    }
    x = output_(x.permute({0, 3, 1, 2}));
    return x + input.slice(1, 0, x.size(1));
  }

  // The same in the kernels' order of memory; skips are joined where they are read.
  struct Packed {
    internal::PackedConvolution embed, output;
    std::vector<internal::PackedConvolution> downs, merges;
    std::vector<internal::PackedDoubling> ups;
  };
  // What takes the picture in and gives it out keeps all digits: there rounding costs most and
  // brings no time.
  static internal::PackedConvolution exact(const Conv2d& layer) {
    const internal::RoundedProducts float32(false);
    return internal::PackedConvolution(layer);
  }
  Packed packed() const {
    Packed made{exact(embed_), exact(output_), {}, {}, {}};
    for (const Conv2d& layer : downs_) made.downs.emplace_back(layer);
    for (const ConvTranspose2d& layer : ups_) made.ups.emplace_back(layer);
    for (const Linear& layer : merges_)
      made.merges.emplace_back().taps = {layer->weight, layer->bias};
    return made;
  }
  torch::Tensor with_kernels(const torch::Tensor& planes) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    const auto input = internal::channels_last(planes);
    auto x = convolve(layers.embed, input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_.size(); ++i) {
      if (i > 0) x = convolve(layers.downs[i - 1], x);
      x = filtered<HybridBlock>(encoders_[i], x);
      skips.push_back(x);
    }
    skips.pop_back();
    for (std::size_t i = 0; i < decoders_.size(); ++i) {
      x = convolve(layers.merges[i], double_size(layers.ups[i], x), skips.back());
      skips.pop_back();
      x = filtered<HybridBlock>(decoders_[i], x);
    }
    x = convolve(layers.output, x);
    return internal::channels_first(x.add_(input.slice(3, 0, x.size(3))));
  }

  Sequential blocks(std::int64_t dim, std::int64_t stage) {
    const auto at = static_cast<std::size_t>(stage);
    const std::int64_t count = settings_.at("depths").at(at);
    Sequential list;
    for (std::int64_t i = 0; i < count; ++i)
      list->push_back(
          HybridBlock(dim, settings_.at("heads").at(at), window_, i % 2 == 1 ? window_ / 2 : 0));
    return list;
  }

  nlohmann::json settings_;
  std::int64_t window_;
  internal::Cached<Packed> packed_;
  Conv2d embed_{nullptr}, output_{nullptr};
  std::vector<Sequential> encoders_, decoders_;
  std::vector<Conv2d> downs_;
  std::vector<ConvTranspose2d> ups_;
  std::vector<Linear> merges_;
};

}  // namespace

std::shared_ptr<Network> make_hybrid(const nlohmann::json& settings) {
  return std::make_shared<Hybrid>(settings);
}

}  // namespace malus
