#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/strips.h"
#include "malus/neural/internal/tasks.h"
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
    // Under autocast on a CPU x is bfloat16, the weights are not, and layer_norm takes one type.
    const auto y = x.permute({0, 2, 3, 1}).to(weight_.scalar_type());
    return torch::layer_norm(y, {x.size(1)}, weight_, bias_, 1e-6).permute({0, 3, 1, 2});
  }
  internal::RowNorm packed() const {
    return {weight_.data_ptr<float>(), bias_.data_ptr<float>(), 1e-6F};
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

  // The same on [batch, rows, cols, channels], contiguous, in place.
  void with_kernels(const torch::Tensor& x) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    const auto b = x.size(0), c = x.size(3), pixels = x.size(1) * x.size(2);
    const auto gated = torch::empty_like(x), sums = torch::zeros({internal::strip_tasks(x), c});
    internal::for_each_strip(x, layers.wide, [&](const internal::StripPiece& piece) {
      float* to = gated.data_ptr<float>() + piece.pixel * c;
      internal::gate_halves(piece.wide, piece.pixels, c, false, to);
      internal::add_columns(to, c, piece.pixels, c, false, sums.data_ptr<float>() + piece.task * c);
    });
    const auto mean = sums.view({b, -1, c}).sum(1, false, torch::kDouble) / pixels;
    const auto means = mean.to(torch::kFloat).contiguous(), factors = torch::empty({b, c});
    layers.sca.run(means.data_ptr<float>(), b, factors.data_ptr<float>(), c);
    second_half(layers, x, gated, factors);
  }

 private:
  struct Packed {
    internal::StripLayer wide;
    internal::RowNorm norm;
    internal::PackedLinear sca, conv3, conv4, conv5;  ///< the third and fifth with beta and gamma
  };
  Packed packed() const {
    const auto scaled = [](const Conv2d& layer, const torch::Tensor& scale) {
      return internal::PackedLinear(layer->weight * scale.view({-1, 1, 1, 1}),
                                    layer->bias * scale.view(-1));
    };
    const auto exact = [](const Conv2dImpl& layer) {  // few values that scale all others
      const internal::RoundedProducts float32(false);
      return internal::PackedLinear(layer.weight, layer.bias);
    };
    return {
        {norm1_->packed(), {conv1_->weight, conv1_->bias}, false, {conv2_->weight, conv2_->bias}},
        norm2_->packed(),
        exact(*sca_->ptr(1)->as<Conv2d>()),
        scaled(conv3_, beta_),
        {conv4_->weight, conv4_->bias},
        scaled(conv5_, gamma_)};
  }
  // Everything after the pooled attention, a few pixels at a time.
  static void second_half(const Packed& layers, const torch::Tensor& x, const torch::Tensor& gated,
                          const torch::Tensor& factors) {
    // In whole tiles of products: 6 rows, or 12.
    constexpr std::ptrdiff_t kPixels = 132;
    const std::ptrdiff_t c = x.size(3), image_pixels = x.size(1) * x.size(2),
                         pieces = (image_pixels + kPixels - 1) / kPixels;
    internal::for_each_task(x.size(0) * pieces, [&](std::ptrdiff_t task) {
      const std::ptrdiff_t image = task / pieces, first = task % pieces * kPixels,
                           count = std::min(kPixels, image_pixels - first),
                           pixel = image * image_pixels + first;
      internal::Scratch scratch(3 * kPixels * c);
      float *narrow = scratch.take(kPixels * c), *wide = scratch.take(2 * kPixels * c),
            *out = x.data_ptr<float>() + pixel * c;
      internal::scale_columns(gated.data_ptr<float>() + pixel * c, c, count, c,
                              factors.data_ptr<float>() + image * c, narrow, c);
      layers.conv3.run(narrow, count, out, c, true);
      internal::normalize_rows(layers.norm, out, c, count, c, narrow);
      layers.conv4.run(narrow, count, wide, 2 * c);
      internal::gate_halves(wide, count, c, false, narrow);
      layers.conv5.run(narrow, count, out, c, true);
    });
  }

  internal::Cached<Packed> packed_;
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
    const bool whole_vectors = intro_->weight.size(0) % internal::kLane == 0;
    const auto y =
        internal::kernels_apply(input) && whole_vectors ? with_kernels(input) : with_layers(input);
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
  };
  Packed packed() const {
    Packed made{internal::PackedConvolution(intro_), internal::PackedConvolution(ending_), {}, {}};
    for (const auto& layer : *downs_) made.downs.emplace_back(convolution(layer));
    for (const auto& layer : *ups_)
      made.ups.emplace_back(convolution(layer->as<Sequential>()->ptr(0)));
    return made;
  }
  static Conv2d convolution(const std::shared_ptr<Module>& layer) {
    return Conv2d(std::dynamic_pointer_cast<Conv2dImpl>(layer));
  }
  static void filter(const std::shared_ptr<Module>& blocks, const torch::Tensor& x) {
    for (const auto& block : *blocks->as<Sequential>()) block.get<NAFBlock>()->with_kernels(x);
  }
  torch::Tensor with_kernels(const torch::Tensor& planes) {
    const Packed& layers = packed_.of(*this, [&] { return packed(); });
    const auto input = internal::channels_last(planes);
    auto x = convolve(layers.intro, input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_->size(); ++i) {
      filter(encoders_->ptr(i), x);
      skips.push_back(x);
      x = convolve(layers.downs[i], x);
    }
    filter(middle_.ptr(), x);
    for (std::size_t i = 0; i < decoders_->size(); ++i) {
      x = double_size(layers.ups[i], x, skips[skips.size() - 1 - i]);
      filter(decoders_->ptr(i), x);
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
