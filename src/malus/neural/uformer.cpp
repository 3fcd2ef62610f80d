#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/layers.h"
#include "malus/neural/internal/strips.h"
#include "malus/neural/internal/windows.h"
#include "malus/neural/networks.h"

#include <algorithm>
#include <utility>

namespace malus {
namespace {

using namespace torch::nn;

// One LeWin block on [batch, rows, cols, channels].
class LeWinBlockImpl : public Module {
 public:
  LeWinBlockImpl(std::int64_t dim, std::int64_t heads, std::int64_t window, std::int64_t shift,
                 bool modulated)
      : heads_(heads), window_(window), shift_(shift) {
    if (modulated) modulator_ = register_module("modulator", Embedding(window * window, dim));
    norm1_ = register_module("norm1", LayerNorm(LayerNormOptions({dim})));
    attn_ = register_module("attn", WindowAttention(dim, window, heads));
    norm2_ = register_module("norm2", LayerNorm(LayerNormOptions({dim})));
    mlp_ = register_module("mlp", LeFF(dim, 4 * dim));
  }
  torch::Tensor forward(const torch::Tensor& input) {
    const auto attended = in_windows(norm1_(input), window_, shift_,
                                     [&](torch::Tensor windows, const torch::Tensor& mask) {
                                       if (!modulator_.is_empty())
                                         windows = windows + modulator_->weight;
                                       return attn_(windows, mask);
                                     });
    const auto x = input + attended;
    return x + mlp_(norm2_(x));
  }
  void filter(torch::Tensor& x, torch::Tensor& spare) {
    if (!internal::windows_apply(x.size(3), heads_, window_)) {
      x = forward(x).contiguous();
      return;
    }
    const internal::WindowBlock& packed = packed_.of(*this, [&] {
      internal::WindowBlock made{
          attn_->packed(norm1_), {}, mlp_->packed(norm2_), mlp_->packed_project()};
      if (!modulator_.is_empty()) made.pixels.modulator = modulator_->weight.detach();
      return made;
    });
    internal::filter_in_windows(packed, window_, shift_, x, spare);
  }

 private:
  std::int64_t heads_, window_, shift_;
  internal::Cached<internal::WindowBlock> packed_;
  Embedding modulator_{nullptr};
  LayerNorm norm1_{nullptr}, norm2_{nullptr};
  WindowAttention attn_{nullptr};
  LeFF mlp_{nullptr};
};
TORCH_MODULE(LeWinBlock);

class Uformer final : public Network {
 public:
  explicit Uformer(const nlohmann::json& s) : settings_(s), window_(s.at("win_size")) {
    const std::int64_t in = s.at("in_chans"), dim = s.at("embed_dim"), size = s.at("img_size");
    input_proj_ =
        register_module("input_proj", std::make_shared<Module>())
            ->register_module(
                "proj", Sequential(Conv2d(Conv2dOptions(in, dim, 3).padding(1)), LeakyReLU()));
    for (std::int64_t i = 0; i < kStages; ++i) {
      stages_.push_back(layer("encoderlayer_" + std::to_string(i), i, dim << i, size >> i));
      // The spelling is the public implementation's.
      downs_.push_back(
          resample("dowsample_" + std::to_string(i), "conv",
                   Conv2d(Conv2dOptions(dim << i, dim << (i + 1), 4).stride(2).padding(1))));
    }
    stages_.push_back(layer("conv", kStages, dim << kStages, size >> kStages));
    std::int64_t from = dim << kStages;
    for (std::int64_t i = 0; i < kStages; ++i) {
      const auto to = dim << (kStages - 1 - i);
      ups_.push_back(resample("upsample_" + std::to_string(i), "deconv",
                              ConvTranspose2d(ConvTranspose2dOptions(from, to, 2).stride(2))));
      stages_.push_back(layer("decoderlayer_" + std::to_string(i), kStages + 1 + i, 2 * to,
                              size >> (kStages - 1 - i)));
      from = 2 * to;
    }
    output_proj_ =
        register_module("output_proj", std::make_shared<Module>())
            ->register_module(
                "proj", Sequential(Conv2d(Conv2dOptions(2 * dim, s.at("dd_in"), 3).padding(1))));
  }

  torch::Tensor forward(torch::Tensor input) override {
    const auto rows = input.size(2), cols = input.size(3);
    input = pad_to_multiple(input, window_ << kStages);
    auto y = internal::kernels_apply(input) ? with_kernels(input) : with_layers(input);
    // As in the public implementation the global residual exists for colour pictures only.
    if (y.size(1) == 3 && input.size(1) == 3) y = y + input;
    return y.slice(2, 0, rows).slice(3, 0, cols);
  }

 private:
  static constexpr std::int64_t kStages = 4;

  torch::Tensor with_layers(const torch::Tensor& input) {
    auto x = input_proj_->forward(input).permute({0, 2, 3, 1});
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < kStages; ++i) {
      x = stages_[i]->forward(x);
      skips.push_back(x);
      x = resampled(downs_[i], x);
    }
    x = stages_[kStages]->forward(x);
    for (std::size_t i = 0; i < kStages; ++i) {
      x = torch::cat({resampled(ups_[i], x), skips[kStages - 1 - i]}, 3);
      x = stages_[kStages + 1 + i]->forward(x);
    }
    return output_proj_->forward(x.permute({0, 3, 1, 2}));
  }

  // The same in the kernels' order of memory. What carries the whole picture from stage to stage
  // keeps all digits: to round it too would save a seventh of bfloat16's time and add a fifth to
  // what it changes.
  struct Packed {
    internal::PackedConvolution first, last;
    std::vector<internal::PackedConvolution> downs;
    std::vector<internal::PackedDoubling> ups;
  };
  template <class Layer, class Impl>
  static Layer layer_of(const Sequential& sequential) {
    return Layer(std::dynamic_pointer_cast<Impl>(sequential->ptr(0)));
  }
  Packed packed() const {
    const internal::RoundedProducts float32(false);
    const auto leak = input_proj_->ptr(1)->as<LeakyReLU>()->options.negative_slope();
    Packed made{internal::PackedConvolution(layer_of<Conv2d, Conv2dImpl>(input_proj_),
                                            static_cast<float>(leak)),
                internal::PackedConvolution(layer_of<Conv2d, Conv2dImpl>(output_proj_)),
                {},
                {}};
    for (const auto& layer : downs_) made.downs.emplace_back(layer_of<Conv2d, Conv2dImpl>(layer));
    for (const auto& layer : ups_)
      made.ups.emplace_back(layer_of<ConvTranspose2d, ConvTranspose2dImpl>(layer));
    return made;
  }
  torch::Tensor with_kernels(const torch::Tensor& input) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    auto x = convolve(layers.first, internal::channels_last(input));
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < kStages; ++i) {
      x = filtered<LeWinBlock>(stages_[i], x);
      skips.push_back(x);
      x = convolve(layers.downs[i], x);
    }
    x = filtered<LeWinBlock>(stages_[kStages], x);
    for (std::size_t i = 0; i < kStages; ++i) {
      x = torch::cat({double_size(layers.ups[i], x), skips.back()}, 3);
      skips.pop_back();
      x = filtered<LeWinBlock>(stages_[kStages + 1 + i], x);
    }
    return internal::channels_first(convolve(layers.last, x));
  }

  // size is the resolution that the network was built for: a stage no larger than a window is not
  // shifted.
  Sequential layer(const std::string& name, std::int64_t stage, std::int64_t dim,
                   std::int64_t size) {
    const auto at = static_cast<std::size_t>(stage);
    const std::int64_t count = settings_.at("depths").at(at);
    const bool modulated = stage > kStages && settings_.at("modulator").get<bool>();
    Sequential blocks;
    for (std::int64_t i = 0; i < count; ++i) {
      const std::int64_t shift = i % 2 == 1 && size > window_ ? window_ / 2 : 0;
      blocks->push_back(
          LeWinBlock(dim, settings_.at("num_heads").at(at), window_, shift, modulated));
    }
    return register_module(name, std::make_shared<Module>())->register_module("blocks", blocks);
  }
  template <class Layer>
  Sequential resample(const std::string& name, const std::string& part, Layer convolution) {
    return register_module(name, std::make_shared<Module>())
        ->register_module(part, Sequential(convolution));
  }
  static torch::Tensor resampled(Sequential& layer, const torch::Tensor& x) {
    return layer->forward(x.permute({0, 3, 1, 2})).permute({0, 2, 3, 1});
  }

  nlohmann::json settings_;
  std::int64_t window_;
  internal::Cached<Packed> packed_;
  Sequential input_proj_{nullptr}, output_proj_{nullptr};
  std::vector<Sequential> stages_, downs_, ups_;
};

}  // namespace

std::shared_ptr<Network> make_uformer(const nlohmann::json& settings) {
  return std::make_shared<Uformer>(settings);
}

}  // namespace malus
