#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/layers.h"
#include "malus/neural/internal/strips.h"
#include "malus/neural/networks.h"

namespace malus {
namespace {

using namespace torch::nn;

// Normalisation over channels; BiasFree divides by the standard deviation without removing the mean
// from the numerator.
class ChannelNormImpl : public Module {
 public:
  ChannelNormImpl(std::int64_t dim, bool bias_free) {
    const auto body = register_module("body", std::make_shared<Module>());
    weight_ = body->register_parameter("weight", torch::ones(dim));
    if (!bias_free) bias_ = body->register_parameter("bias", torch::zeros(dim));
  }
  torch::Tensor forward(const torch::Tensor& x) {
    auto y = x.permute({0, 2, 3, 1});
    if (bias_.defined())
      y = torch::layer_norm(y, {y.size(3)}, weight_, bias_, kEpsilon);
    else
      // y / sd = (y - mean) / sd + mean / sd: the fast layer_norm and its own moments instead of
      // the slow var().
      y = bias_free(y);
    return y.permute({0, 3, 1, 2});
  }
  internal::RowNorm packed() const {
    return {weight_.data_ptr<float>(), bias_.defined() ? bias_.data_ptr<float>() : nullptr,
            static_cast<float>(kEpsilon), !bias_.defined()};
  }

 private:
  torch::Tensor bias_free(const torch::Tensor& y) {
    if (torch::GradMode::is_enabled()) {
      // native_layer_norm gives no gradient through its moments.
      const auto centred = y - y.mean(-1, true);
      return y * (centred.square().mean(-1, true) + kEpsilon).rsqrt() * weight_;
    }
    const auto [normal, mean, inverse_sd] =
        torch::native_layer_norm(y, {y.size(3)}, {}, {}, kEpsilon);
    return (normal + mean * inverse_sd) * weight_;
  }
  static constexpr double kEpsilon = 1e-5;
  torch::Tensor weight_, bias_;
};
TORCH_MODULE(ChannelNorm);

Conv2d conv(std::int64_t from, std::int64_t to, std::int64_t kernel, bool bias,
            std::int64_t groups = 1) {
  return Conv2d(Conv2dOptions(from, to, kernel).padding(kernel / 2).bias(bias).groups(groups));
}

// Multi-Dconv head transposed attention: channels attend to channels.
class TransposedAttentionImpl : public Module {
 public:
  TransposedAttentionImpl(std::int64_t dim, std::int64_t heads, bool bias) : heads_(heads) {
    temperature_ = register_parameter("temperature", torch::ones({heads, 1, 1}));
    qkv_ = register_module("qkv", conv(dim, 3 * dim, 1, bias));
    qkv_dwconv_ = register_module("qkv_dwconv", conv(3 * dim, 3 * dim, 3, bias, 3 * dim));
    project_out_ = register_module("project_out", conv(dim, dim, 1, bias));
  }
  torch::Tensor forward(const torch::Tensor& x) {
    const auto b = x.size(0), c = x.size(1), h = x.size(2), w = x.size(3);
    const auto parts = qkv_dwconv_(qkv_(x)).chunk(3, 1);
    const auto split = [&](const torch::Tensor& t) {
      return t.reshape({b, heads_, c / heads_, h * w});
    };
    const auto unit = [](const torch::Tensor& t) {
      return t / t.norm(2, -1, true).clamp_min(1e-12);
    };
    const auto q = unit(split(parts[0])), k = unit(split(parts[1])), v = split(parts[2]);
    const auto attention = torch::softmax(torch::matmul(q, k.transpose(-2, -1)) * temperature_, -1);
    return project_out_(torch::matmul(attention, v).reshape({b, c, h, w}));
  }
  internal::StripLayer packed(const ChannelNorm& norm) const {
    return {{norm->packed(), qkv_->weight, qkv_->bias},
            false,
            {qkv_dwconv_->weight, qkv_dwconv_->bias}};
  }
  // x + attention of x, [batch, rows, cols, channels]. Attention over the picture is one matrix for
  // its values, and so is the projection: their product is applied at once.
  torch::Tensor with_kernels(const internal::StripLayer& layer, const torch::Tensor& x) const {
    const auto b = x.size(0), c = x.size(3), width = c / heads_;
    const auto products = torch::zeros({internal::strip_tasks(x), heads_ * width * width});
    const auto squares = torch::zeros({internal::strip_tasks(x), 2 * c});
    const auto values = torch::empty_like(x);
    float* kept = values.data_ptr<float>();
    internal::for_each_strip(x, layer, [&](const internal::StripPiece& piece) {
      const float* q = piece.wide;
      internal::add_columns(q, 3 * c, piece.pixels, 2 * c, true,
                            squares.data_ptr<float>() + piece.task * 2 * c);
      for (std::int64_t head = 0; head < heads_; ++head) {
        internal::MatrixProduct p{.rows = width, .inner = piece.pixels, .cols = width};
        p.a = q + head * width;
        p.a_row = 1;
        p.a_inner = 3 * c;
        p.b = p.a + c;
        p.b_inner = 3 * c;
        p.c = products.data_ptr<float>() + (piece.task * heads_ + head) * width * width;
        p.c_row = width;
        p.add = true;
        internal::multiply(p);
      }
      for (std::ptrdiff_t i = 0; i < piece.pixels; ++i)
        std::copy_n(q + i * 3 * c + 2 * c, c, kept + (piece.pixel + i) * c);
    });
    const auto sum = [&](const torch::Tensor& t, torch::IntArrayRef shape) {
      return t.view({b, -1, t.size(1)}).sum(1, false, torch::kDouble).view(shape);
    };
    const auto norms = sum(squares, {b, 2, heads_, width}).sqrt().clamp_min(1e-12);
    const auto attention =
        torch::softmax(sum(products, {b, heads_, width, width}) / norms.select(1, 0).unsqueeze(3) /
                           norms.select(1, 1).unsqueeze(2) * temperature_,
                       -1)
            .to(torch::kFloat);
    auto y = x.clone();
    const auto out = project_out_->weight.view({c, heads_, width}).transpose(0, 1);
    for (std::int64_t image = 0; image < b; ++image)
      internal::add_linear({torch::matmul(out, attention[image]).transpose(0, 1).reshape({c, c}),
                            project_out_->bias},
                           values[image], y[image]);
    return y;
  }

 private:
  std::int64_t heads_;
  torch::Tensor temperature_;
  Conv2d qkv_{nullptr}, qkv_dwconv_{nullptr}, project_out_{nullptr};
};
TORCH_MODULE(TransposedAttention);

// Gated-Dconv feed-forward.
class GatedFeedForwardImpl : public Module {
 public:
  GatedFeedForwardImpl(std::int64_t dim, double expansion, bool bias) {
    const auto hidden = static_cast<std::int64_t>(static_cast<double>(dim) * expansion);
    project_in_ = register_module("project_in", conv(dim, 2 * hidden, 1, bias));
    dwconv_ = register_module("dwconv", conv(2 * hidden, 2 * hidden, 3, bias, 2 * hidden));
    project_out_ = register_module("project_out", conv(hidden, dim, 1, bias));
  }
  torch::Tensor forward(const torch::Tensor& x) {
    const auto halves = dwconv_(project_in_(x)).chunk(2, 1);
    return project_out_(torch::gelu(halves[0]) * halves[1]);
  }
  // For the kernels each half is filled up to whole vectors by channels of zeros.
  internal::StripLayer packed(const ChannelNorm& norm) const {
    return {{norm->packed(), filled(project_in_->weight, 2), filled(project_in_->bias, 2)},
            false,
            {filled(dwconv_->weight, 2), filled(dwconv_->bias, 2)}};
  }
  internal::PackedLinear packed_project() const {
    const auto weight = project_out_->weight.flatten(1);
    return {filled(weight.t(), 1).t(), project_out_->bias};
  }

 private:
  // Every part of the first dimension becomes as long as whole vectors are.
  static torch::Tensor filled(const torch::Tensor& t, std::int64_t parts) {
    if (!t.defined()) return t;
    const auto length = t.size(0) / parts;
    auto shape = t.sizes().vec();
    shape[0] = internal::whole_lanes(length) - length;
    std::vector<torch::Tensor> pieces;
    for (const auto& part : t.chunk(parts, 0)) {
      pieces.push_back(part);
      pieces.push_back(torch::zeros(shape));
    }
    return torch::cat(pieces);
  }
  Conv2d project_in_{nullptr}, dwconv_{nullptr}, project_out_{nullptr};
};
TORCH_MODULE(GatedFeedForward);

class BlockImpl : public Module {
 public:
  BlockImpl(std::int64_t dim, std::int64_t heads, double expansion, bool bias, bool bias_free)
      : whole_vectors_(dim / heads % internal::kLane == 0) {
    norm1_ = register_module("norm1", ChannelNorm(dim, bias_free));
    attn_ = register_module("attn", TransposedAttention(dim, heads, bias));
    norm2_ = register_module("norm2", ChannelNorm(dim, bias_free));
    ffn_ = register_module("ffn", GatedFeedForward(dim, expansion, bias));
  }
  torch::Tensor forward(torch::Tensor x) {
    if (internal::kernels_apply(x) && whole_vectors_) return with_kernels(x);
    x = x + attn_(norm1_(x));
    return x + ffn_(norm2_(x));
  }

 private:
  struct Packed {
    internal::StripLayer attention, wide;
    internal::PackedLinear project;
  };
  torch::Tensor with_kernels(const torch::Tensor& x) {
    const Packed& packed = packed_.of(*this, [&] {
      return Packed{attn_->packed(norm1_), ffn_->packed(norm2_), ffn_->packed_project()};
    });
    const auto attended = attn_->with_kernels(packed.attention, internal::channels_last(x));
    return internal::channels_first(internal::strip_feed_forward(
        attended, packed.wide, internal::StripActivation::kGateWithGelu, packed.project));
  }

  bool whole_vectors_;
  internal::Cached<Packed> packed_;
  ChannelNorm norm1_{nullptr}, norm2_{nullptr};
  TransposedAttention attn_{nullptr};
  GatedFeedForward ffn_{nullptr};
};
TORCH_MODULE(Block);

class Restormer final : public Network {
 public:
  explicit Restormer(const nlohmann::json& s) : settings_(s) {
    const std::int64_t in = s.at("inp_channels"), out = s.at("out_channels"), dim = s.at("dim");
    const bool bias = s.at("bias");
    const auto patch = register_module("patch_embed", std::make_shared<Module>());
    patch_embed_ = patch->register_module("proj", conv(in, dim, 3, bias));
    for (std::int64_t i = 0; i < kLevels; ++i) {
      const auto number = std::to_string(i + 1);
      encoders_.push_back(register_module(i + 1 < kLevels ? "encoder_level" + number : "latent",
                                          blocks(dim << i, i)));
      if (i + 1 == kLevels) break;
      downs_.push_back(resample("down" + number + "_" + std::to_string(i + 2),
                                conv(dim << i, (dim << i) / 2, 3, false), PixelUnshuffle(2)));
    }
    for (std::int64_t i = kLevels - 2; i >= 0; --i) {
      const auto number = std::to_string(i + 1);
      ups_.push_back(resample("up" + std::to_string(i + 2) + "_" + number,
                              conv(dim << (i + 1), dim << (i + 2), 3, false), PixelShuffle(2)));
      // The first level keeps the doubled width: no reduction there.
      if (i > 0)
        reduces_.push_back(
            register_module("reduce_chan_level" + number, conv(dim << (i + 1), dim << i, 1, bias)));
      decoders_.push_back(
          register_module("decoder_level" + number, blocks(i > 0 ? dim << i : 2 * dim, i)));
    }
    refinement_ = register_module("refinement", blocks(2 * dim, 0, s.at("num_refinement_blocks")));
    output_ = register_module("output", conv(2 * dim, out, 3, bias));
  }

  torch::Tensor forward(torch::Tensor input) override {
    const auto rows = input.size(2), cols = input.size(3);
    input = pad_to_multiple(input, 1 << (kLevels - 1));
    if (internal::kernels_apply(input)) input = input.contiguous(torch::MemoryFormat::ChannelsLast);
    auto x = patch_embed_(input);
    std::vector<torch::Tensor> skips;
    for (std::size_t i = 0; i < encoders_.size(); ++i) {
      if (i > 0) x = downs_[i - 1]->forward(x);
      x = encoders_[i]->forward(x);
      skips.push_back(x);
    }
    for (std::size_t i = 0; i < decoders_.size(); ++i) {
      x = torch::cat({ups_[i]->forward(x), skips[skips.size() - 2 - i]}, 1);
      if (i < reduces_.size()) x = reduces_[i](x);
      x = decoders_[i]->forward(x);
    }
    x = output_(through(refinement_, x));
    if (x.size(1) == input.size(1)) x = x + input;
    return x.slice(2, 0, rows).slice(3, 0, cols);
  }

 private:
  static constexpr std::int64_t kLevels = 4;

  Sequential blocks(std::int64_t dim, std::int64_t level, std::int64_t count = -1) {
    const auto at = static_cast<std::size_t>(level);
    if (count < 0) count = settings_.at("num_blocks").at(at);
    Sequential list;
    for (std::int64_t i = 0; i < count; ++i)
      list->push_back(Block(dim, settings_.at("heads").at(at), settings_.at("ffn_expansion_factor"),
                            settings_.at("bias"), settings_.at("LayerNorm_type") == "BiasFree"));
    return list;
  }
  template <class Shuffle>
  Sequential resample(const std::string& name, Conv2d convolution, Shuffle shuffle) {
    const auto holder = register_module(name, std::make_shared<Module>());
    return holder->register_module("body", Sequential(convolution, shuffle));
  }

  nlohmann::json settings_;
  Conv2d patch_embed_{nullptr}, output_{nullptr};
  std::vector<Sequential> encoders_, decoders_, downs_, ups_;
  std::vector<Conv2d> reduces_;
  Sequential refinement_{nullptr};
};

}  // namespace

std::shared_ptr<Network> make_restormer(const nlohmann::json& settings) {
  return std::make_shared<Restormer>(settings);
}

}  // namespace malus
