// NAFNet's kernels against libtorch's layers and plain sums: gates and norms inside products,
// gated strips, widths that are no whole number of vectors.
#include "malus/neural/internal/packed.h"
#include "malus/neural/internal/strips.h"
#include "malus/neural/network.h"

#include <tuple>

#include "plain_layers.h"
#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace malus {
namespace {

using internal::MatrixProduct;

NetworkDescription nafnet(int width) {
  return {"nafnet",
          {{"img_channel", 5},
           {"width", width},
           {"middle_blk_num", 1},
           {"enc_blk_nums", {1, 2}},
           {"dec_blk_nums", {1, 1}}}};
}

// Whole vectors and widths that are filled up to them; strips of many columns, of a row, of
// neither; pieces of the second half that end early.
TEST(GatedKernels, GiveWhatTheLayersGiveForAnyWidth) {
  const torch::NoGradGuard no_gradients;
  for (const int width : {4, 24, 40, 64}) {
    const auto network = testing::scattered(nafnet(width));
    for (const auto& [batch, rows, cols] : {std::tuple{1, 1, 3}, {2, 67, 70}, {1, 9, 431}}) {
      const auto x = torch::rand({batch, 5, rows, cols});
      const auto plain = testing::by_layers(*network, x), fast = network->forward(x);
      ASSERT_EQ(fast.sizes(), plain.sizes());
      EXPECT_LT(testing::farthest_apart(fast, plain), 2e-5 * (1 + plain.abs().max().item<double>()))
          << width << ": " << rows << " x " << cols;
      EXPECT_FALSE(torch::equal(fast, plain)) << width << " took the layers twice";
    }
  }
}

// Packed weights lie in other panels for other instruction sets.
TEST(GatedKernels, AgreeWithTheLayersOnEveryInstructionSet) {
  const torch::NoGradGuard no_gradients;
  const auto x = torch::rand({1, 5, 35, 50});
  int tried = 0;
  for (std::int64_t rest = hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
    const auto network = testing::scattered(nafnet(24));
    hwy::SetSupportedTargetsForTest(rest & -rest);
    const auto plain = testing::by_layers(*network, x), fast = network->forward(x);
    EXPECT_LT(testing::farthest_apart(fast, plain), 2e-5 * (1 + plain.abs().max().item<double>()))
        << hwy::TargetName(rest & -rest);
    ++tried;
  }
  hwy::SetSupportedTargetsForTest(0);
  EXPECT_GE(tried, 1);
}

// Strips are cut by the number of threads, the means of the attention are not.
TEST(GatedKernels, GiveTheSameForAnyNumberOfThreads) {
  const torch::NoGradGuard no_gradients;
  const int threads = at::get_num_threads();
  for (const int width : {24, 40}) {
    const auto network = testing::scattered(nafnet(width));
    const auto x = torch::rand({1, 5, 90, 130});
    at::set_num_threads(1);
    const auto one = network->forward(x);
    at::set_num_threads(3);
    const auto three = network->forward(x);
    at::set_num_threads(threads);
    EXPECT_LT(testing::farthest_apart(three, one), 1e-5 * (1 + one.abs().max().item<double>()))
        << width;
  }
}

TEST(GatedKernels, RoundedProductsStayNearFloat32) {
  if (!internal::can_round_products()) GTEST_SKIP() << "no instruction that multiplies bfloat16";
  const torch::NoGradGuard no_gradients;
  for (const int width : {24, 40}) {
    const auto network = testing::scattered(nafnet(width));
    const auto x = torch::rand({2, 5, 70, 45}), exact = network->forward(x);
    const internal::RoundedProducts rounding(true);
    const double loss = (network->forward(x) - exact).square().mean().sqrt().item<double>(),
                 deviation = exact.std().item<double>();
    EXPECT_GT(loss, 1e-5 * deviation) << width << " did not round";
    EXPECT_LT(loss, 0.01 * deviation) << width;
  }
}

// W norm(x) + b in double. The mean is forty deviations away: centred weights must not see it.
torch::Tensor plain_normed_linear(const torch::Tensor& x, const torch::Tensor& norm_weight,
                                  const torch::Tensor& norm_bias, bool bias_free,
                                  const torch::Tensor& weight, const torch::Tensor& bias) {
  const auto values = x.to(torch::kDouble), mean = values.mean(1, true),
             inverse = ((values - mean).square().mean(1, true) + 1e-6).rsqrt();
  auto normal = (bias_free ? values : values - mean) * inverse * norm_weight.to(torch::kDouble);
  if (norm_bias.defined()) normal = normal + norm_bias.to(torch::kDouble);
  const auto y = torch::matmul(normal, weight.to(torch::kDouble).t());
  return bias.defined() ? y + bias.to(torch::kDouble) : y;
}

struct NormedShape {
  std::int64_t rows, inner, filling, cols;
  bool bias_free, gated;
};

TEST(GatedKernels, NormsInsideProductsAgreeWithPlainSums) {
  torch::manual_seed(11);
  const torch::NoGradGuard no_gradients;
  for (const auto& s : {NormedShape{1, 16, 0, 16, false, false},
                        {37, 48, 8, 96, false, true},
                        {18, 32, 15, 160, false, true},
                        {50, 512, 0, 48, true, false},
                        {131, 640, 0, 64, false, true}}) {
    const auto used = s.inner - s.filling;
    const auto x = torch::randn({s.rows, used}) + (s.bias_free ? 0.0 : 40.0),
               norm_weight = 1 + torch::randn({used}), weight = torch::randn({s.cols, used}),
               bias = torch::randn({s.cols}), norm_bias = torch::randn({used});
    const auto filled = torch::constant_pad_nd(x, {0, s.filling}).contiguous();
    const internal::RowNorm norm{norm_weight.data_ptr<float>(),
                                 s.bias_free ? nullptr : norm_bias.data_ptr<float>(), 1e-6F,
                                 s.bias_free, s.filling};
    const internal::NormedLinear layer(norm, torch::constant_pad_nd(weight, {0, s.filling}), bias,
                                       s.gated);
    auto expected = plain_normed_linear(x, norm_weight, s.bias_free ? torch::Tensor() : norm_bias,
                                        s.bias_free, weight, bias);
    if (s.gated) expected = expected.chunk(2, 1)[0] * expected.chunk(2, 1)[1];
    auto y = torch::zeros(expected.sizes()), memory = torch::empty({layer.memory(s.rows, 1)});
    MatrixProduct p{.rows = s.rows, .a = filled.data_ptr<float>()};
    p.a_row = s.inner;
    p.c = y.data_ptr<float>();
    p.c_row = y.size(1);
    layer.run(p, memory.data_ptr<float>());
    // Rounding of float32 sums whose terms are 40 deviations large.
    EXPECT_LT(testing::farthest_apart(y.to(torch::kDouble), expected),
              2e-5 * (1 + expected.abs().max().item<double>()))
        << s.inner << " - " << s.filling << " -> " << s.cols;
  }
}

// Every channel's place, the last rows of a picture, means in double.
TEST(GatedKernels, GatedStripsAgreeWithTheLayers) {
  using namespace torch::nn;
  torch::manual_seed(12);
  const torch::NoGradGuard no_gradients;
  for (const auto& [rows, cols, width] : {std::tuple{1, 1, 16}, {23, 37, 48}, {6, 900, 32}}) {
    const Linear expand(width, 2 * width);
    Conv2d depthwise(Conv2dOptions(2 * width, 2 * width, 3).padding(1).groups(2 * width));
    const auto ones = torch::ones({width}), zeros = torch::zeros({width});
    const internal::StripLayer layer{
        {{ones.data_ptr<float>(), zeros.data_ptr<float>(), 1e-6F}, expand->weight, expand->bias},
        false,
        {depthwise->weight, depthwise->bias}};
    const auto x = torch::randn({2, rows, cols, width});
    auto gated = torch::empty_like(x);
    const auto means = internal::strip_gate(x, layer, gated);
    Linear plain = expand;
    const auto halves =
        depthwise(plain(torch::layer_norm(x, {width}, {}, {}, 1e-6)).permute({0, 3, 1, 2}))
            .chunk(2, 1);
    const auto expected = (halves[0] * halves[1]).permute({0, 2, 3, 1});
    EXPECT_LT(testing::farthest_apart(gated, expected), 1e-5) << rows << " x " << cols;
    EXPECT_LT(testing::farthest_apart(means, expected.mean({1, 2})), 1e-5) << rows << " x " << cols;
  }
}

}  // namespace
}  // namespace malus
