// The kernels of inference against libtorch's layers and plain sums, on odd sizes.
#include "malus/neural/internal/convolution.h"
#include "malus/neural/internal/packed.h"
#include "malus/neural/network.h"

#include <bit>
#include <limits>
#include <utility>

#include "plain_layers.h"
#include "small_networks.h"
#include "support.h"
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::MatrixProduct;
using testing::by_layers;
using testing::farthest_apart;
using testing::scattered;

// Widths in whole vectors, so that every block has its kernels.
NetworkDescription wide(const std::string& name) {
  if (name == "unet") return {name, {{"in_channels", 5}, {"out_channels", 3}, {"width", 16}}};
  if (name == "nafnet")
    return {name,
            {{"img_channel", 5},
             {"width", 16},
             {"middle_blk_num", 1},
             {"enc_blk_nums", {1, 2}},
             {"dec_blk_nums", {1, 1}}}};
  if (name == "restormer")
    return {name,
            {{"inp_channels", 5},
             {"out_channels", 5},
             {"dim", 16},
             {"num_blocks", {1, 1, 1, 1}},
             {"num_refinement_blocks", 1}}};
  if (name == "uformer") return {name, {{"in_chans", 5}, {"dd_in", 5}, {"embed_dim", 16}}};
  return {name, {{"in_channels", 5}, {"out_channels", 5}, {"dim", 16}, {"depths", {2, 1, 1, 1}}}};
}

TEST(Kernels, GiveWhatTheLayersOfEveryNetworkGive) {
  const torch::NoGradGuard no_gradients;
  for (const auto& name : network_names()) {
    const auto network = scattered(wide(name));
    for (const auto& [batch, rows, cols] : {std::tuple{1, 1, 3}, {2, 131, 70}, {1, 24, 150}}) {
      const auto x = torch::rand({batch, 5, rows, cols});
      const auto plain = by_layers(*network, x), fast = network->forward(x);
      ASSERT_EQ(fast.sizes(), plain.sizes());
      EXPECT_LT(farthest_apart(fast, plain), 2e-5 * (1 + plain.abs().max().item<double>()))
          << name << " " << rows << " x " << cols;
      EXPECT_FALSE(torch::equal(fast, plain)) << name << " took the layers twice";
    }
  }
}

// Blocks whose heads fill no vectors are the layers', what lies between them is not; a stage may be
// the only one.
TEST(Kernels, GiveWhatTheLayersGiveAroundBlocksWithoutKernels) {
  const torch::NoGradGuard no_gradients;
  NetworkDescription one_stage = wide("malus");
  one_stage.settings["depths"] = {3};
  one_stage.settings["heads"] = {1};
  for (const auto& description :
       {testing::small_network("uformer"), testing::small_network("malus"), one_stage}) {
    const auto network = scattered(description);
    const bool small = description.settings != one_stage.settings;
    const auto x = torch::rand({2, small ? 4 : 5, 37, 22});
    const auto plain = by_layers(*network, x), fast = network->forward(x);
    ASSERT_EQ(fast.sizes(), plain.sizes());
    EXPECT_LT(farthest_apart(fast, plain), 2e-5 * (1 + plain.abs().max().item<double>()))
        << description.architecture;
    EXPECT_FALSE(torch::equal(fast, plain)) << description.architecture << " took the layers twice";
  }
}

// The residual is on the picture's planes, not on those that follow them, or on none.
TEST(Kernels, GiveWhatTheLayersGiveForOtherNumbersOfPlanes) {
  const torch::NoGradGuard no_gradients;
  NetworkDescription conditioned = wide("malus"), colour = wide("uformer"), wider = colour;
  conditioned.settings["out_channels"] = 3;
  colour.settings["in_chans"] = colour.settings["dd_in"] = 3;
  wider.settings["dd_in"] = 7;
  for (const auto& [description, planes] : {std::pair{conditioned, 5}, {colour, 3}, {wider, 5}}) {
    const auto network = scattered(description);
    const auto x = torch::rand({1, planes, 40, 24});
    const auto plain = by_layers(*network, x), fast = network->forward(x);
    ASSERT_EQ(fast.sizes(), plain.sizes());
    EXPECT_LT(farthest_apart(fast, plain), 2e-5 * (1 + plain.abs().max().item<double>()))
        << description.architecture;
  }
}

TEST(Kernels, FollowChangedWeights) {
  const torch::NoGradGuard no_gradients;
  for (const auto& name : network_names()) {
    const auto network = scattered(wide(name));
    const auto x = torch::rand({1, 5, 32, 32});
    const auto before = network->forward(x);
    for (torch::Tensor& parameter : network->parameters()) parameter.mul_(1.1);
    EXPECT_GT(farthest_apart(network->forward(x), before), 1e-3) << name;
    EXPECT_LT(farthest_apart(network->forward(x), by_layers(*network, x)), 1e-4) << name;
  }
}

// A pass over new random values on one thread and on three.
std::pair<torch::Tensor, torch::Tensor> on_one_and_three_threads(Network& network) {
  const int threads = at::get_num_threads();
  const auto x = torch::rand({1, 5, 90, 130});
  at::set_num_threads(1);
  const auto one = network.forward(x);
  at::set_num_threads(3);
  const auto three = network.forward(x);
  at::set_num_threads(threads);
  return {one, three};
}

// To rounding: the narrow first and last layers are libtorch's, and some kernels of the BLAS below
// it sum in another order when threads share a product.
TEST(Kernels, GiveTheSameForAnyNumberOfThreads) {
  const torch::NoGradGuard no_gradients;
  for (const auto& name : network_names()) {
    const auto [one, three] = on_one_and_three_threads(*scattered(wide(name)));
    EXPECT_LT(farthest_apart(three, one), 1e-5 * (1 + one.abs().max().item<double>())) << name;
  }
}

// Sums in double over taps, with every choice that a product has.
TEST(Kernels, ProductsAgreeWithPlainSums) {
  torch::manual_seed(7);
  for (const auto& [rows, inner, cols, taps] : {std::tuple{1, 1, 1, 1},
                                                {13, 5, 19, 1},
                                                {70, 33, 48, 1},
                                                {9, 20, 100, 9},
                                                {17, 500, 51, 3}}) {
    const auto a = torch::randn({rows + taps, inner}), b = torch::randn({taps * inner, cols}),
               bias = torch::randn({cols}), start = torch::randn({rows, cols});
    std::vector<std::ptrdiff_t> offsets;
    auto expected = start.to(torch::kDouble) + bias;
    for (int t = 0; t < taps; ++t) {
      offsets.push_back(t * inner);
      expected += torch::matmul(a.slice(0, t, t + rows).to(torch::kDouble),
                                b.slice(0, t * inner, (t + 1) * inner).to(torch::kDouble));
    }
    expected = torch::leaky_relu(expected, 0.2);
    auto packed = torch::empty({taps * inner * internal::whole_lanes(cols)});
    internal::pack_columns(b.data_ptr<float>(), taps * inner, cols, cols, 1,
                           packed.data_ptr<float>());
    for (const bool plain : {false, true}) {
      if (plain && (taps > 1 || cols % internal::kLane != 0)) continue;
      auto c = start.clone();
      MatrixProduct p{.rows = rows, .inner = inner, .cols = cols, .a = a.data_ptr<float>()};
      p.a_row = inner;
      p.taps = offsets;
      p.b = plain ? b.data_ptr<float>() : packed.data_ptr<float>();
      p.b_inner = plain ? cols : 0;
      p.bias = bias.data_ptr<float>();
      p.c = c.data_ptr<float>();
      p.c_row = cols;
      p.add = true;
      p.leak = 0.2F;
      internal::multiply(p);
      EXPECT_LT(farthest_apart(c.to(torch::kDouble), expected), 2e-6 * (taps * inner + 10));
    }
  }
}

#define MALUS_NEEDS_BFLOAT16           \
  if (!internal::can_round_products()) \
  GTEST_SKIP() << "this processor has no instruction that multiplies bfloat16"

// libtorch's own rounding, to nearest even.
torch::Tensor rounded(const torch::Tensor& x) { return x.to(torch::kBFloat16).to(torch::kFloat); }

TEST(Bfloat16, RoundsToNearestEven) {
  torch::manual_seed(3);
  auto x = torch::cat({torch::randn({4000}),
                       torch::tensor({0.0F, -1.0F, 1.00390625F, 1.01171875F, 3.0e38F, -1e-30F})});
  const auto expected = rounded(x);
  for (std::int64_t i = 0; i < x.numel(); ++i)
    EXPECT_EQ(std::bit_cast<float>(std::uint32_t{internal::rounded_to_bfloat16(x[i].item<float>())}
                                   << 16),
              expected[i].item<float>());
}

// Groups of rows that lie apart, windows of taps, odd inner sizes, columns that end inside a
// vector: against sums in double of operands that were rounded by libtorch, so that only the order
// of float32 sums differs.
TEST(Bfloat16, ProductsAgreeWithPlainSumsOfRoundedValues) {
  MALUS_NEEDS_BFLOAT16;
  torch::manual_seed(8);
  struct Shape {
    std::int64_t groups, rows, inner, cols, taps, gap;
  };
  for (const auto& s : {Shape{1, 1, 1, 1, 1, 0},
                        {1, 13, 5, 19, 1, 3},
                        {3, 70, 33, 48, 1, 0},
                        {2, 9, 21, 100, 9, 0},
                        {1, 17, 1001, 51, 3, 0},
                        {2, 8, 900, 64, 1, 4}}) {
    const std::int64_t pitch = s.inner + s.gap, reach = s.rows + s.taps;
    const auto a = torch::randn({s.groups, reach, pitch}),
               b = torch::randn({s.taps * s.inner, s.cols}), bias = torch::randn({s.cols}),
               start = torch::randn({s.groups, s.rows, s.cols});
    std::vector<std::ptrdiff_t> offsets;
    auto expected = start.to(torch::kDouble) + bias;
    for (std::int64_t t = 0; t < s.taps; ++t) {
      if (s.taps > 1) offsets.push_back(t * pitch);
      expected +=
          torch::matmul(rounded(a.slice(1, t, t + s.rows).slice(2, 0, s.inner)).to(torch::kDouble),
                        rounded(b.slice(0, t * s.inner, (t + 1) * s.inner)).to(torch::kDouble));
    }
    expected = torch::leaky_relu(expected, 0.2);
    std::vector<internal::Bfloat16> packed(static_cast<std::size_t>(
        s.taps * internal::whole_pairs(s.inner) * internal::whole_lanes(s.cols)));
    internal::pack_pairs(b.data_ptr<float>(), s.taps, s.inner, s.cols, s.cols, 1, packed.data());
    auto c = start.clone();
    MatrixProduct p{.rows = s.rows, .inner = s.inner, .cols = s.cols, .a = a.data_ptr<float>()};
    p.a_row = pitch;
    p.a_group = reach * pitch;
    p.c_group = s.rows * s.cols;
    p.groups = s.groups;
    p.taps = offsets;
    p.pairs = packed.data();
    p.bias = bias.data_ptr<float>();
    p.c = c.data_ptr<float>();
    p.c_row = s.cols;
    p.add = true;
    p.leak = 0.2F;
    internal::multiply(p);
    EXPECT_LT(farthest_apart(c.to(torch::kDouble), expected),
              5e-7 * static_cast<double>(s.taps * s.inner + 10))
        << s.rows << " x " << s.inner << " x " << s.cols;
  }
}

// The layers of libtorch with weights and values that it rounded itself: odd channels, every
// stride, two sources, pieces that end inside the picture.
TEST(Bfloat16, ConvolutionsAgreeWithTheLayersOfRoundedValues) {
  MALUS_NEEDS_BFLOAT16;
  using namespace torch::nn;
  torch::manual_seed(10);
  const torch::NoGradGuard no_gradients;
  const internal::RoundedProducts rounding(true);
  const auto x = torch::randn({2, 11, 22, 138});
  for (const auto& [kernel, stride] : {std::pair{1, 1}, {2, 2}, {3, 1}, {4, 2}}) {
    Conv2d layer(Conv2dOptions(11, 21, kernel).stride(stride).padding((kernel - 1) / 2));
    layer->weight.set_data(rounded(layer->weight));
    const auto y = internal::channels_first(internal::convolve(
        internal::PackedConvolution(layer, 0.2F), internal::channels_last(x.slice(1, 0, 4)),
        internal::channels_last(x.slice(1, 4))));
    EXPECT_LT(farthest_apart(y, torch::leaky_relu(layer(rounded(x)), 0.2)), 1e-5) << kernel;
  }
  ConvTranspose2d doubling(ConvTranspose2dOptions(11, 21, 2).stride(2));
  doubling->weight.set_data(rounded(doubling->weight));
  EXPECT_LT(farthest_apart(internal::channels_first(internal::double_size(
                               internal::PackedDoubling(doubling), internal::channels_last(x))),
                           doubling(rounded(x))),
            1e-5);
}

// Rows of an odd length are filled up in memory that an earlier product has used.
TEST(Bfloat16, NothingIsLeftOfAnEarlierProduct) {
  MALUS_NEEDS_BFLOAT16;
  const torch::NoGradGuard no_gradients;
  const internal::RoundedProducts rounding(true);
  const internal::PackedLinear even(torch::randn({16, 32}), {}), odd(torch::randn({16, 31}), {});
  const auto not_numbers = torch::full({64, 32}, std::numeric_limits<float>::quiet_NaN());
  const auto ones = torch::ones({32, 31});
  auto y = torch::empty({64, 16});
  even.run(not_numbers.data_ptr<float>(), 64, y.data_ptr<float>(), 16);
  EXPECT_TRUE(torch::isnan(y).all().item<bool>());
  odd.run(ones.data_ptr<float>(), 32, y.data_ptr<float>(), 16);
  EXPECT_TRUE(torch::isfinite(y.slice(0, 0, 32)).all().item<bool>());
}

// Eight bits of mantissa: each product loses up to 2^-9 of its operands, and sums of many lose
// less.
TEST(Bfloat16, EveryNetworkStaysNearFloat32) {
  MALUS_NEEDS_BFLOAT16;
  const torch::NoGradGuard no_gradients;
  for (const auto& name : network_names()) {
    const auto network = scattered(wide(name));
    const auto x = torch::rand({2, 5, 70, 45});
    const auto exact = network->forward(x);
    torch::Tensor rough;
    {
      const internal::RoundedProducts rounding(true);
      rough = network->forward(x);
    }
    const double loss = (rough - exact).square().mean().sqrt().item<double>(),
                 deviation = exact.std().item<double>();
    EXPECT_GT(loss, 1e-5 * deviation) << name << " did not round";
    EXPECT_LT(loss, 0.01 * deviation) << name;
    EXPECT_TRUE(torch::equal(network->forward(x), exact)) << name << " did not come back";
  }
}

TEST(Bfloat16, GivesTheSameForAnyNumberOfThreads) {
  MALUS_NEEDS_BFLOAT16;
  const torch::NoGradGuard no_gradients;
  const internal::RoundedProducts rounding(true);
  for (const auto& name : network_names()) {
    const auto [one, three] = on_one_and_three_threads(*scattered(wide(name)));
    // A difference in float32 at a rounding's edge becomes one of bfloat16.
    EXPECT_LT((three - one).square().mean().sqrt().item<double>(), 2e-3 * one.std().item<double>())
        << name;
  }
}

TEST(Kernels, GeluIsAsExactAsDocumented) {
  auto x = torch::linspace(-12, 12, 48000);
  const auto wanted =
      0.5 * x.to(torch::kDouble) * torch::erfc(-x.to(torch::kDouble) / std::sqrt(2.0));
  const auto relative = (x.to(torch::kDouble).abs() + 1e-3);
  internal::gelu(x.data_ptr<float>(), x.numel());
  EXPECT_LT(((x.to(torch::kDouble) - wanted).abs() / relative).max().item<double>(), 4e-7);
}

// Columns in and beside whole blocks of vectors, pixels in and beside whole groups.
TEST(Kernels, ColumnsAndDepthwiseRowsAgreeWithPlainSums) {
  torch::manual_seed(6);
  for (const auto& [rows, channels] : {std::pair{1, 16}, {3, 80}, {11, 144}, {29, 256}}) {
    const auto x = torch::randn({rows, channels + 5}), factors = torch::randn({channels});
    const auto used = x.slice(1, 0, channels);
    auto sums = factors.clone(), squares = factors.clone(), y = torch::zeros({rows, channels + 2});
    const float* from = x.data_ptr<float>();
    internal::add_columns(from, channels + 5, rows, channels, false, sums.data_ptr<float>());
    internal::add_columns(from, channels + 5, rows, channels, true, squares.data_ptr<float>());
    internal::scale_columns(from, channels + 5, rows, channels, factors.data_ptr<float>(),
                            y.data_ptr<float>(), channels + 2);
    EXPECT_LT(farthest_apart(sums, factors + used.sum(0)), 1e-5) << channels;
    EXPECT_LT(farthest_apart(squares, factors + used.square().sum(0)), 1e-4) << channels;
    EXPECT_EQ(farthest_apart(y.slice(1, 0, channels), used * factors), 0) << channels;
    EXPECT_EQ(y.slice(1, channels).abs().max().item<float>(), 0) << channels;

    const auto three = torch::randn({3, rows + 2, channels}), weight = torch::randn({9, channels});
    auto row = torch::zeros({rows + 1, channels});
    const float* const at[3] = {three[0].data_ptr<float>(), three[1].data_ptr<float>(),
                                three[2].data_ptr<float>()};
    for (const bool biased : {false, true}) {
      auto expected =
          biased ? factors.expand({rows, channels}).clone() : torch::zeros({rows, channels});
      for (int i = 0; i < 9; ++i)
        expected += three[i / 3].slice(0, i % 3, i % 3 + rows) * weight[i];
      internal::depthwise_row(at, weight.data_ptr<float>(),
                              biased ? factors.data_ptr<float>() : nullptr, rows, channels,
                              row.data_ptr<float>());
      EXPECT_LT(farthest_apart(row.slice(0, 0, rows), expected), 2e-5) << rows << " x " << channels;
      EXPECT_EQ(row[rows].abs().max().item<float>(), 0) << rows << " x " << channels;
    }
  }
}

TEST(Kernels, ConvolutionsAgreeWithTheLayers) {
  using namespace torch::nn;
  torch::manual_seed(9);
  const torch::NoGradGuard no_gradients;
  for (const auto& [kernel, stride] : {std::pair{1, 1}, {2, 2}, {3, 1}, {4, 2}}) {
    Conv2d layer(Conv2dOptions(11, 21, kernel).stride(stride).padding((kernel - 1) / 2));
    const auto x = torch::randn({2, 11, 22, 138});
    const auto first = internal::channels_last(x.slice(1, 0, 4)),
               more = internal::channels_last(x.slice(1, 4));
    const auto y = internal::channels_first(
        internal::convolve(internal::PackedConvolution(layer), first, more));
    const auto expected = layer(x);
    ASSERT_EQ(y.sizes(), expected.sizes());
    EXPECT_LT(farthest_apart(y, expected), 1e-5) << kernel;
  }
  // Widths that Winograd's algorithm takes: tiles that end inside the picture, two sources.
  for (const auto& [rows, cols] : {std::pair{1, 1}, {6, 131}, {65, 4}, {34, 50}}) {
    Conv2d layer(Conv2dOptions(48, 32, 3).padding(1));
    const internal::PackedConvolution packed(layer, 0.2F);
    ASSERT_TRUE(packed.winograd.defined());
    const auto x = torch::randn({2, 48, rows, cols});
    const auto y = internal::channels_first(
        internal::convolve(packed, internal::channels_last(x.slice(1, 0, 16)),
                           internal::channels_last(x.slice(1, 16))));
    EXPECT_LT(farthest_apart(y, torch::leaky_relu(layer(x), 0.2)), 2e-5) << rows << " x " << cols;
  }
  ConvTranspose2d doubling(ConvTranspose2dOptions(11, 21, 2).stride(2));
  const auto x = torch::randn({2, 11, 7, 9});
  EXPECT_LT(farthest_apart(internal::channels_first(internal::double_size(
                               internal::PackedDoubling(doubling), internal::channels_last(x))),
                           doubling(x)),
            1e-5);
  // A 1x1 convolution before a pixel shuffle, added to what is there.
  Conv2d shuffled(Conv2dOptions(11, 4 * 21, 1).bias(false));
  const auto onto = torch::randn({2, 21, 14, 18}), lifted = internal::channels_last(onto).clone();
  internal::double_size(internal::PackedDoubling(shuffled), internal::channels_last(x), lifted);
  EXPECT_LT(
      farthest_apart(internal::channels_first(lifted), onto + torch::pixel_shuffle(shuffled(x), 2)),
      1e-5);
}

}  // namespace
}  // namespace malus
