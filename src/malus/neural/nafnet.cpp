#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/gated_block.h"
#include "malus/neural/internal/layers.h"
#include "malus/neural/networks.h"

namespace malus {
namespace {

using namespace torch::nn;

Conv2d conv1x1(std::int64_t from, std::int64_t to, bool bias = true) {
  return Conv2d(Conv2dOptions(from, to, 1).bias(bias));
}

// For the kernels: every one of `parts` equal parts along a dimension is filled up to whole vectors
// by zeros, which stay zeros through all layers.
torch::Tensor whole_vectors(const torch::Tensor& t, std::int64_t dimension,
                            std::int64_t parts = 1) {
  if (!t.defined()) return t;
  const auto length = t.size(dimension) / parts, whole = internal::whole_lanes(length);
  if (whole == length) return t;
  auto shape = t.sizes().vec();
  shape[static_cast<std::size_t>(dimension)] = whole - length;
  std::vector<torch::Tensor> pieces;
  for (const auto& part : t.chunk(parts, dimension)) {
    pieces.push_back(part);
    pieces.push_back(torch::zeros(shape));
  }
  return torch::cat(pieces, dimension);
}
// A convolution whose channels are filled up, those of the result only where said.
Conv2d whole_vectors(const Conv2d& layer, std::int64_t in, std::int64_t out) {
  const auto weight = layer->weight;
  if (weight.size(0) == out && weight.size(1) == in) return layer;
  const auto& options = layer->options;
  Conv2d filled(Conv2dOptions(in, out, options.kernel_size())
                    .stride(options.stride())
                    .padding(options.padding())
                    .bias(options.bias()));
  filled->weight.zero_();
  filled->weight.slice(0, 0, weight.size(0)).slice(1, 0, weight.size(1)).copy_(weight);
  if (!layer->bias.defined()) return filled;
  filled->bias.zero_();
  filled->bias.slice(0, 0, weight.size(0)).copy_(layer->bias);
  return filled;
}

// Normalisation over the channels of every pixel (LayerNorm2d), eps 1e-6.
class PixelNormImpl : public Module {
 public:
  explicit PixelNormImpl(std::int64_t channels) {
    weight_ = register_parameter("weight", torch::ones(channels));
    bias_ = register_parameter("bias", torch::zeros(channels));
  }
  torch::Tensor forward(const torch::Tensor& x) {
    // Under autocast on a CPU x is bfloat16, the weights are not, and layer_norm takes one type.
    const auto y = x.permute({0, 2, 3, 1}).to(weight_.scalar_type());
    return torch::layer_norm(y, {x.size(1)}, weight_, bias_, 1e-6).permute({0, 3, 1, 2});
  }
  internal::RowNorm packed() const {
    const auto channels = weight_.size(0);
    return {weight_.data_ptr<float>(), bias_.data_ptr<float>(), 1e-6F, false,
            internal::whole_lanes(channels) - channels};
  }

 private:
  torch::Tensor weight_, bias_;
};
TORCH_MODULE(PixelNorm);

torch::Tensor simple_gate(const torch::Tensor& x) {
  const auto halves = x.chunk(2, 1);
  return halves[0] * halves[1];
}

class NAFBlockImpl : public Module {
 public:
  explicit NAFBlockImpl(std::int64_t c) {
    conv1_ = register_module("conv1", conv1x1(c, 2 * c));
    conv2_ =
        register_module("conv2", Conv2d(Conv2dOptions(2 * c, 2 * c, 3).padding(1).groups(2 * c)));
    conv3_ = register_module("conv3", conv1x1(c, c));
    sca_ = register_module("sca", Sequential(AdaptiveAvgPool2d(1), conv1x1(c, c)));
    conv4_ = register_module("conv4", conv1x1(c, 2 * c));
    conv5_ = register_module("conv5", conv1x1(c, c));
    norm1_ = register_module("norm1", PixelNorm(c));
    norm2_ = register_module("norm2", PixelNorm(c));
    beta_ = register_parameter("beta", torch::zeros({1, c, 1, 1}));
    gamma_ = register_parameter("gamma", torch::zeros({1, c, 1, 1}));
  }
  torch::Tensor forward(const torch::Tensor& input) {
    auto x = simple_gate(conv2_(conv1_(norm1_(input))));
    x = x * sca_->forward(x);
    const auto y = input + conv3_(x) * beta_;
    return y + conv5_(simple_gate(conv4_(norm2_(y)))) * gamma_;
  }

  internal::GatedBlock packed() const {
    const auto square = [](const torch::Tensor& t) {
      return whole_vectors(whole_vectors(t.flatten(1), 0), 1);
    };
    const auto scaled = [&](const Conv2d& layer, const torch::Tensor& scale) {
      return internal::PackedLinear(square(layer->weight * scale.view({-1, 1, 1, 1})),
                                    whole_vectors(layer->bias * scale.view(-1), 0));
    };
    const auto widening = [&](const PixelNorm& norm, const Conv2d& layer, bool gated) {
      return internal::NormedLinear(norm->packed(),
                                    whole_vectors(whole_vectors(layer->weight.flatten(1), 0, 2), 1),
                                    whole_vectors(layer->bias, 0, 2), gated);
    };
    const auto exact = [&](const Conv2dImpl& layer) {
      const internal::RoundedProducts float32(false);
      return internal::PackedLinear(square(layer.weight), whole_vectors(layer.bias, 0));
    };
    return {{widening(norm1_, conv1_, false),
             false,
             {whole_vectors(conv2_->weight, 0, 2), whole_vectors(conv2_->bias, 0, 2)}},
            exact(*sca_->ptr(1)->as<Conv2d>()),
            scaled(conv3_, beta_),
            widening(norm2_, conv4_, true),
            scaled(conv5_, gamma_)};
  }

 private:
  Conv2d conv1_{nullptr}, conv2_{nullptr}, conv3_{nullptr}, conv4_{nullptr}, conv5_{nullptr};
  Sequential sca_{nullptr};
  PixelNorm norm1_{nullptr}, norm2_{nullptr};
  torch::Tensor beta_, gamma_;
};
TORCH_MODULE(NAFBlock);

Sequential blocks_of(std::int64_t channels, std::int64_t count) {
  Sequential blocks;
  for (std::int64_t i = 0; i < count; ++i) blocks->push_back(NAFBlock(channels));
  return blocks;
}

class NAFNet final : public Network {
 public:
  explicit NAFNet(const nlohmann::json& s) {
    const std::int64_t channels = s.at("img_channel"), width = s.at("width");
    intro_ = register_module("intro", Conv2d(Conv2dOptions(channels, width, 3).padding(1)));
    ending_ = register_module("ending", Conv2d(Conv2dOptions(width, channels, 3).padding(1)));
    encoders_ = register_module("encoders", ModuleList());
    decoders_ = register_module("decoders", ModuleList());
    ups_ = register_module("ups", ModuleList());
    downs_ = register_module("downs", ModuleList());
    std::int64_t c = width;
    for (const std::int64_t count : s.at("enc_blk_nums").get<std::vector<std::int64_t>>()) {
      encoders_->push_back(blocks_of(c, count));
      downs_->push_back(Conv2d(Conv2dOptions(c, 2 * c, 2).stride(2)));
      c *= 2;
    }
    middle_ = register_module("middle_blks", blocks_of(c, s.at("middle_blk_num")));
    for (const std::int64_t count : s.at("dec_blk_nums").get<std::vector<std::int64_t>>()) {
      ups_->push_back(Sequential(conv1x1(c, 2 * c, false), PixelShuffle(2)));
      c /= 2;
      decoders_->push_back(blocks_of(c, count));
    }
  }

  torch::Tensor forward(torch::Tensor input) override {
    const auto rows = input.size(2), cols = input.size(3);
    input = zero_pad_to_multiple(input, std::int64_t{1} << encoders_->size());
    const auto y = internal::kernels_apply(input) ? with_kernels(input) : with_layers(input);
    return y.slice(2, 0, rows).slice(3, 0, cols);
  }

 private:
  static Sequential blocks_in(const ModuleList& stages, std::size_t stage) {
    return Sequential(std::dynamic_pointer_cast<SequentialImpl>(stages->ptr(stage)));
  }
  torch::Tensor with_layers(const torch::Tensor& input) {
    auto x = intro_(input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_->size(); ++i) {
      x = through(blocks_in(encoders_, i), x);
      skips.push_back(x);
      x = downs_[i]->as<Conv2d>()->forward(x);
    }
    x = middle_->forward(x);
    for (std::size_t i = 0; i < decoders_->size(); ++i) {
      x = ups_[i]->as<Sequential>()->forward(x) + skips[skips.size() - 1 - i];
      x = through(blocks_in(decoders_, i), x);
    }
    return ending_(x) + input;
  }

  // The same in the kernels' order of memory; what is lifted is added to the skips in place.
  struct Packed {
    internal::PackedConvolution intro, ending;
    std::vector<internal::PackedConvolution> downs;
    std::vector<internal::PackedDoubling> ups;
    std::vector<std::vector<internal::GatedBlock>> encoders, decoders;
    std::vector<internal::GatedBlock> middle;
  };
  Packed packed() const {
    const auto whole = [](std::int64_t channels) { return internal::whole_lanes(channels); };
    const std::int64_t planes = intro_->weight.size(1), width = whole(intro_->weight.size(0));
    Packed made;
    made.intro = internal::PackedConvolution(whole_vectors(intro_, planes, width));
    made.ending = internal::PackedConvolution(whole_vectors(ending_, width, planes));
    for (const auto& layer : *downs_) {
      const auto down = convolution(layer);
      made.downs.emplace_back(
          whole_vectors(down, whole(down->weight.size(1)), whole(down->weight.size(0))));
    }
    for (const auto& layer : *ups_) {
      const auto up = convolution(layer->as<Sequential>()->ptr(0));
      made.ups.emplace_back(
          whole_vectors(up, whole(up->weight.size(1)), 4 * whole(up->weight.size(0) / 4)));
    }
    for (const auto& stage : *encoders_) made.encoders.push_back(packed_blocks(*stage));
    for (const auto& stage : *decoders_) made.decoders.push_back(packed_blocks(*stage));
    made.middle = packed_blocks(*middle_);
    return made;
  }
  static std::vector<internal::GatedBlock> packed_blocks(const Module& stage) {
    std::vector<internal::GatedBlock> blocks;
    for (const auto& block : stage.children()) blocks.push_back(block->as<NAFBlock>()->packed());
    return blocks;
  }
  static Conv2d convolution(const std::shared_ptr<Module>& layer) {
    return Conv2d(std::dynamic_pointer_cast<Conv2dImpl>(layer));
  }
  torch::Tensor with_kernels(const torch::Tensor& planes) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    const auto input = internal::channels_last(planes);
    auto x = convolve(layers.intro, input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_->size(); ++i) {
      for (const auto& block : layers.encoders[i]) block.filter(x);
      skips.push_back(x);
      x = convolve(layers.downs[i], x);
    }
    for (const auto& block : layers.middle) block.filter(x);
    for (std::size_t i = 0; i < decoders_->size(); ++i) {
      x = double_size(layers.ups[i], x, skips[skips.size() - 1 - i]);
      for (const auto& block : layers.decoders[i]) block.filter(x);
    }
    return internal::channels_first(convolve(layers.ending, x).add_(input));
  }

  internal::Cached<Packed> packed_;
  Conv2d intro_{nullptr}, ending_{nullptr};
  ModuleList encoders_{nullptr}, decoders_{nullptr}, ups_{nullptr}, downs_{nullptr};
  Sequential middle_{nullptr};
};

}  // namespace

std::shared_ptr<Network> make_nafnet(const nlohmann::json& settings) {
  return std::make_shared<NAFNet>(settings);
}

}  // namespace malus
