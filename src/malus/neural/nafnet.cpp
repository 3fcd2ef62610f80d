#include "malus/neural/layers.h"
#include "malus/neural/networks.h"

namespace malus {
namespace {

using namespace torch::nn;

Conv2d conv1x1(std::int64_t from, std::int64_t to, bool bias = true) {
  return Conv2d(Conv2dOptions(from, to, 1).bias(bias));
}

// Normalisation over the channels of every pixel (LayerNorm2d), eps 1e-6.
class PixelNormImpl : public Module {
 public:
  explicit PixelNormImpl(std::int64_t channels) {
    weight_ = register_parameter("weight", torch::ones(channels));
    bias_ = register_parameter("bias", torch::zeros(channels));
  }
  torch::Tensor forward(const torch::Tensor& x) {
    return torch::layer_norm(x.permute({0, 2, 3, 1}), {x.size(1)}, weight_, bias_, 1e-6)
        .permute({0, 3, 1, 2});
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
    auto x = intro_(input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_->size(); ++i) {
      x = encoders_[i]->as<Sequential>()->forward(x);
      skips.push_back(x);
      x = downs_[i]->as<Conv2d>()->forward(x);
    }
    x = middle_->forward(x);
    for (std::size_t i = 0; i < decoders_->size(); ++i) {
      x = ups_[i]->as<Sequential>()->forward(x) + skips[skips.size() - 1 - i];
      x = decoders_[i]->as<Sequential>()->forward(x);
    }
    return (ending_(x) + input).slice(2, 0, rows).slice(3, 0, cols);
  }

 private:
  Conv2d intro_{nullptr}, ending_{nullptr};
  ModuleList encoders_{nullptr}, decoders_{nullptr}, ups_{nullptr}, downs_{nullptr};
  Sequential middle_{nullptr};
};

}  // namespace

std::shared_ptr<Network> make_nafnet(const nlohmann::json& settings) {
  return std::make_shared<NAFNet>(settings);
}

}  // namespace malus
