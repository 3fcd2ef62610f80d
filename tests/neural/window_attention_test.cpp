// Attention in the processor's matrix unit against plain sums in float64 of the same rounded
// queries, keys and values: what remains is the rounding of the weights.
#include "malus/neural/internal/window_attention.h"

#include "malus/neural/internal/layers.h"
#include "malus/neural/internal/matrix_unit.h"
#include "malus/neural/internal/windows.h"

#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include <gtest/gtest.h>
#include <torch/torch.h>

namespace malus {
namespace {

struct WindowShape {
  std::int64_t pixels, heads, width;
};

// Tiles that fill no step of 32 in either dimension, one and many heads, more than four tiles of
// columns.
constexpr WindowShape kWindowShapes[] = {{16, 1, 16}, {64, 2, 32},  {64, 3, 16},
                                         {48, 1, 48}, {144, 2, 32}, {32, 2, 80}};

// [pixels, 3, heads, width], whose columns have different sizes.
torch::Tensor random_qkv(const WindowShape& s) {
  return torch::randn({s.pixels, 3, s.heads, s.width}) * (torch::rand({3, s.heads, s.width}) + 0.5);
}

torch::Tensor rounded_part(const torch::Tensor& qkv, std::int64_t part) {
  return qkv.select(1, part).to(torch::kBFloat16).to(torch::kDouble).transpose(0, 1);
}

// What attend(window) gives, [heads, pixels, width]. Memory holds what is no number, and nothing
// behind it may be touched.
template <class Attend>
torch::Tensor mixed_of(const WindowShape& s, const torch::Tensor& qkv, const Attend& attend) {
  constexpr std::int64_t kGuard = 64;
  constexpr float kUntouched = 7;
  const std::int64_t values = internal::attention_memory(s.pixels, s.width);
  auto memory = torch::full({values + kGuard}, std::numeric_limits<float>::quiet_NaN());
  const auto guard = memory.slice(0, values);
  guard.fill_(kUntouched);
  auto mixed = torch::full({s.pixels, s.heads, s.width}, std::numeric_limits<float>::quiet_NaN());
  attend(internal::WindowHeads{s.pixels, s.heads, s.width, qkv.data_ptr<float>(),
                               mixed.data_ptr<float>(), memory.data_ptr<float>()});
  EXPECT_TRUE((guard == kUntouched).all().item<bool>());
  return mixed.transpose(0, 1).to(torch::kDouble);
}

// Half of a last digit of bfloat16 in every weight, and a little for float32 and the exponential.
void expect_near(const torch::Tensor& mixed, const torch::Tensor& wanted, const torch::Tensor& most,
                 const WindowShape& s) {
  constexpr double kOfWeights = 1.0 / 256 + 3e-4;
  EXPECT_LT(((mixed - wanted).abs() - kOfWeights * most).max().item<double>(), 1e-5)
      << s.pixels << " pixels, " << s.heads << " heads of " << s.width;
}

TEST(WindowAttention, OfPixelsAgreesWithPlainSums) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  torch::manual_seed(21);
  for (const WindowShape& s : kWindowShapes)
    for (const bool labelled : {false, true})
      // Scores whose exponentials leave float32's range above, and below.
      for (const auto& [bias_size, bias_mean] :
           {std::pair{0.5, 0.0}, {150.0, 0.0}, {0.5, -300.0}}) {
        const auto qkv = random_qkv(s),
                   bias = bias_size * torch::randn({s.heads, s.pixels, s.pixels}) + bias_mean,
                   labels = torch::randint(0, 3, {s.pixels}).to(torch::kFloat);
        const float scale = 1 / std::sqrt(static_cast<float>(s.width));
        const auto mixed = mixed_of(s, qkv, [&](const internal::WindowHeads& window) {
          internal::attend_pixels_in_unit(window, scale, bias.data_ptr<float>(),
                                          labelled ? labels.data_ptr<float>() : nullptr);
        });
        auto scores = torch::matmul(rounded_part(qkv, 0), rounded_part(qkv, 1).transpose(1, 2)) *
                          static_cast<double>(scale) +
                      bias.to(torch::kDouble);
        if (labelled)
          scores = torch::where(labels.unsqueeze(0) == labels.unsqueeze(1), scores, scores - 100);
        const auto weights = torch::softmax(scores, -1), values = rounded_part(qkv, 2);
        expect_near(mixed, torch::matmul(weights, values), torch::matmul(weights, values.abs()), s);
      }
}

TEST(WindowAttention, OfChannelsAgreesWithPlainSums) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  torch::manual_seed(22);
  for (const WindowShape& s : kWindowShapes)
    for (const float size : {3.0F, 300.0F}) {
      const auto qkv = random_qkv(s);
      std::vector<float> temperatures;
      for (std::int64_t head = 0; head < s.heads; ++head)
        temperatures.push_back(size + static_cast<float>(head));
      const auto mixed = mixed_of(s, qkv, [&](const internal::WindowHeads& window) {
        internal::attend_channels_in_unit(window, temperatures.data());
      });
      const auto lengths = [&](std::int64_t part) {
        return qkv.select(1, part).to(torch::kDouble).norm(2, 0);  // [heads, width]
      };
      const auto scores =
          torch::matmul(rounded_part(qkv, 0).transpose(1, 2), rounded_part(qkv, 1)) /
          (lengths(0).unsqueeze(2) * lengths(1).unsqueeze(1)) *
          torch::tensor(temperatures).to(torch::kDouble).view({-1, 1, 1});
      const auto weights = torch::softmax(scores, -1).transpose(1, 2),
                 values = rounded_part(qkv, 2);
      expect_near(mixed, torch::matmul(values, weights), torch::matmul(values.abs(), weights), s);
    }
}

// A channel of zeros has no length: its scores are 0, as in float32.
TEST(WindowAttention, TakesChannelsWithoutLength) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  const WindowShape s{64, 1, 32};
  auto qkv = torch::zeros({s.pixels, 3, s.heads, s.width});
  qkv.select(1, 2).fill_(2);
  const float temperature = 1;
  const auto mixed = mixed_of(s, qkv, [&](const internal::WindowHeads& window) {
    internal::attend_channels_in_unit(window, &temperature);
  });
  EXPECT_LT((mixed - 2).abs().max().item<double>(), 1e-2);
}

// What attention in shifted windows adds to a picture, among pixels and then channels, with weights
// that make it choose: what it must keep apart would show.
torch::Tensor added_in_windows(std::int64_t shift, bool in_unit) {
  torch::manual_seed(23);
  constexpr std::int64_t kWidth = 32, kHeads = 2, kWindow = 8;
  WindowAttention layer(kWidth, kWindow, kHeads);
  torch::nn::LayerNorm norm(torch::nn::LayerNormOptions({kWidth}));
  for (torch::Tensor& parameter : layer->parameters()) parameter.mul_(4);
  const internal::RoundedProducts rounding(in_unit);
  const internal::ChannelAttention channels{
      packed_norm(norm),
      {torch::randn({3 * kWidth, kWidth}), {}},
      {2.0F, 5.0F},
      {torch::randn({kWidth, kWidth}), torch::randn({kWidth})},
      kHeads};
  const auto x = 3 * torch::randn({2, 3 * kWindow, 2 * kWindow, kWidth});
  auto y = x.clone();
  internal::attend_in_windows(y, kWindow, shift, layer->packed(norm), &channels);
  return y - x;
}

TEST(WindowAttention, StaysNearFloat32InShiftedWindows) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  const torch::NoGradGuard no_gradients;
  for (const std::int64_t shift : {0, 4}) {
    const auto exact = added_in_windows(shift, false), rough = added_in_windows(shift, true);
    const double loss = (rough - exact).square().mean().sqrt().item<double>();
    EXPECT_LT(loss, 0.01 * exact.std().item<double>()) << "shifted by " << shift;
    EXPECT_GT(loss, 0) << "did not round";
  }
}

}  // namespace
}  // namespace malus
