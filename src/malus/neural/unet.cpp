#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/layers.h"
#include "malus/neural/networks.h"

namespace malus {
namespace {

using torch::nn::Conv2d;
using torch::nn::Conv2dOptions;
using torch::nn::ConvTranspose2d;
using torch::nn::ConvTranspose2dOptions;

constexpr float kLeak = 0.2F;

torch::Tensor activated(const torch::Tensor& x) { return torch::leaky_relu(x, kLeak); }

class UNet final : public Network {
 public:
  explicit UNet(const nlohmann::json& s) : upscale_(s.at("upscale")) {
    const std::int64_t in = s.at("in_channels"), out = s.at("out_channels"), width = s.at("width");
    const std::int64_t levels = s.at("levels");
    multiple_ = std::int64_t{1} << (levels - 1);
    std::int64_t from = in;
    for (std::int64_t level = 1; level <= levels; ++level) {
      const std::int64_t to = width << (level - 1);
      down_.push_back(make_pair("conv" + std::to_string(level), from, to));
      from = to;
    }
    for (std::int64_t level = levels + 1; level < 2 * levels; ++level) {
      const std::int64_t to = from / 2;
      up_.push_back(
          register_module("upv" + std::to_string(level),
                          ConvTranspose2d(ConvTranspose2dOptions(from, to, 2).stride(2))));
      merge_.push_back(make_pair("conv" + std::to_string(level), from, to));
      from = to;
    }
    last_ = register_module("conv" + std::to_string(2 * levels) + "_1",
                            Conv2d(Conv2dOptions(from, out * upscale_ * upscale_, 1)));
  }

  torch::Tensor forward(torch::Tensor x) override {
    const auto rows = x.size(2), cols = x.size(3);
    x = pad_to_multiple(x, multiple_);
    if (internal::kernels_apply(x))
      x = with_kernels(x);
    else
      // On a CPU the gradients' layers are slower in that order.
      x = with_layers(torch::GradMode::is_enabled() && !x.is_cuda()
                          ? x
                          : x.contiguous(torch::MemoryFormat::ChannelsLast));
    if (upscale_ > 1) x = torch::pixel_shuffle(x, upscale_);
    return x.slice(2, 0, rows * upscale_).slice(3, 0, cols * upscale_);
  }

 private:
  torch::Tensor with_layers(torch::Tensor x) {
    std::vector<torch::Tensor> skips;
    for (std::size_t level = 0; level < down_.size(); ++level) {
      if (level > 0) x = torch::max_pool2d(x, 2);
      x = down_[level].run(x);
      skips.push_back(x);
    }
    for (std::size_t i = 0; i < up_.size(); ++i)
      x = merge_[i].run(torch::cat({up_[i](x), skips[skips.size() - 2 - i]}, 1));
    return last_(x);
  }

  // The same in the kernels' order of memory; skips are joined where they are read.
  struct Packed {
    std::vector<std::array<internal::PackedConvolution, 2>> down, merge;
    std::vector<internal::PackedDoubling> up;
    internal::PackedConvolution last;
  };
  Packed packed() const {
    const auto pair = [](const Pair& layers) {
      return std::array{internal::PackedConvolution(layers.first, kLeak),
                        internal::PackedConvolution(layers.second, kLeak)};
    };
    Packed made;
    for (const Pair& layers : down_) made.down.push_back(pair(layers));
    for (const Pair& layers : merge_) made.merge.push_back(pair(layers));
    for (const auto& layer : up_) made.up.emplace_back(layer);
    made.last = internal::PackedConvolution(last_);
    return made;
  }
  torch::Tensor with_kernels(const torch::Tensor& input) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    auto x = internal::channels_last(input);
    std::vector<torch::Tensor> skips;
    for (std::size_t level = 0; level < down_.size(); ++level) {
      if (level > 0) x = internal::channels_last(torch::max_pool2d(internal::channels_first(x), 2));
      x = convolve(layers.down[level][1], convolve(layers.down[level][0], x));
      skips.push_back(x);
    }
    skips.pop_back();
    for (std::size_t i = 0; i < up_.size(); ++i) {
      x = convolve(layers.merge[i][1],
                   convolve(layers.merge[i][0], double_size(layers.up[i], x), skips.back()));
      skips.pop_back();
    }
    return internal::channels_first(convolve(layers.last, x)).contiguous();
  }

  struct Pair {
    Conv2d first{nullptr}, second{nullptr};
    torch::Tensor run(const torch::Tensor& x) { return activated(second(activated(first(x)))); }
  };
  Pair make_pair(const std::string& name, std::int64_t from, std::int64_t to) {
    return {register_module(name + "_1", Conv2d(Conv2dOptions(from, to, 3).padding(1))),
            register_module(name + "_2", Conv2d(Conv2dOptions(to, to, 3).padding(1)))};
  }
  internal::Cached<Packed> packed_;
  std::int64_t multiple_ = 1, upscale_;
  std::vector<Pair> down_, merge_;
  std::vector<ConvTranspose2d> up_;
  Conv2d last_{nullptr};
};

}  // namespace

std::shared_ptr<Network> make_unet(const nlohmann::json& settings) {
  return std::make_shared<UNet>(settings);
}

}  // namespace malus
