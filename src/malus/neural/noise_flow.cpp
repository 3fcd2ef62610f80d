#include "malus/neural/noise_flow.h"

#include "malus/base/error.h"

#include <cmath>
#include <numbers>

namespace malus {
namespace {

using namespace torch::nn;

// Scales stay within exp(+-2), so that a step can always be undone in float32.
constexpr double kMostLogScale = 2.0;

torch::Tensor per_channel(const torch::Tensor& t) { return t.view({1, -1, 1, 1}); }
torch::Tensor per_picture(const torch::Tensor& t) { return t.view({-1, 1, 1, 1}); }

}  // namespace

FlowStepImpl::FlowStepImpl(std::int64_t channels, std::int64_t width) {
  // A random rotation: every plane reaches both halves.
  const auto rotation = std::get<0>(torch::linalg_qr(torch::randn({channels, channels})));
  mixing_ = register_parameter("mixing", rotation.contiguous());
  Conv2d last(Conv2dOptions(width, channels, 3).padding(1));
  torch::nn::init::zeros_(last->weight);
  torch::nn::init::zeros_(last->bias);
  net_ = register_module(
      "net", Sequential(Conv2d(Conv2dOptions(channels / 2 + channels + 1, width, 3).padding(1)),
                        ReLU(), Conv2d(Conv2dOptions(width, width, 1)), ReLU(), last));
}

std::pair<torch::Tensor, torch::Tensor> FlowStepImpl::coupling(const torch::Tensor& first,
                                                               const torch::Tensor& clean,
                                                               const torch::Tensor& gain) {
  const auto level = per_picture(gain).expand({first.size(0), 1, first.size(2), first.size(3)});
  const auto parts = net_->forward(torch::cat({first, clean, level}, 1)).chunk(2, 1);
  return {kMostLogScale * torch::tanh(parts[0] / kMostLogScale), parts[1]};
}

torch::Tensor FlowStepImpl::forward(const torch::Tensor& x, const torch::Tensor& clean,
                                    const torch::Tensor& gain, torch::Tensor& log_det) {
  const auto mixed = torch::conv2d(x, mixing_.unsqueeze(-1).unsqueeze(-1));
  const auto halves = mixed.chunk(2, 1);
  const auto [log_scale, shift] = coupling(halves[0], clean, gain);
  const auto pixels = static_cast<double>(x.size(2) * x.size(3));
  log_det =
      log_det + log_scale.sum({1, 2, 3}) + std::get<1>(torch::linalg_slogdet(mixing_)) * pixels;
  return torch::cat({halves[0], halves[1] * torch::exp(log_scale) + shift}, 1);
}

torch::Tensor FlowStepImpl::inverse(const torch::Tensor& z, const torch::Tensor& clean,
                                    const torch::Tensor& gain) {
  const auto halves = z.chunk(2, 1);
  const auto [log_scale, shift] = coupling(halves[0], clean, gain);
  const auto mixed = torch::cat({halves[0], (halves[1] - shift) * torch::exp(-log_scale)}, 1);
  const auto back = torch::linalg_inv(mixing_.to(torch::kDouble)).to(mixing_.scalar_type());
  return torch::conv2d(mixed, back.unsqueeze(-1).unsqueeze(-1));
}

bool FlowStepImpl::can_be_undone() const {
  const auto [back, failed] = torch::linalg_inv_ex(mixing_.to(torch::kDouble));
  return failed.item().toInt() == 0 &&
         back.to(mixing_.scalar_type()).isfinite().all().item().toBool();
}

NoiseFlow::NoiseFlow(std::int64_t channels, std::int64_t steps, std::int64_t width)
    : channels_(channels) {
  const auto values = [&](const char* name) {
    return register_parameter(name, torch::zeros(channels));
  };
  slope_ = values("slope");
  slope_gain_ = values("slope_gain");
  offset_ = values("offset");
  offset_gain_ = values("offset_gain");
  gain_ = values("gain");
  gain_slope_ = values("gain_slope");
  if (channels % 2 != 0) return;
  for (std::int64_t i = 0; i < steps; ++i) {
    auto& list = i < steps / 2 ? before_ : after_;
    list.push_back(register_module("step_" + std::to_string(i), FlowStep(channels, width)));
  }
}

void NoiseFlow::start_at(double slope, double offset) {
  const torch::NoGradGuard no_gradients;
  slope_.fill_(std::log(std::max(slope, 1e-12)));
  offset_.fill_(std::log(std::max(offset, 1e-12)));
}

torch::Tensor NoiseFlow::log_deviation(const torch::Tensor& clean,
                                       const torch::Tensor& gain) const {
  const auto g = per_picture(gain);
  const auto slope = torch::exp(per_channel(slope_) + per_channel(slope_gain_) * g);
  const auto offset = torch::exp(per_channel(offset_) + per_channel(offset_gain_) * g);
  return 0.5 * torch::log(slope * clean.clamp_min(0) + offset);
}

torch::Tensor NoiseFlow::log_gain(const torch::Tensor& gain) const {
  return per_channel(gain_) + per_channel(gain_slope_) * per_picture(gain);
}

NoiseFlow::Normals NoiseFlow::forward(const torch::Tensor& noise, const torch::Tensor& clean,
                                      const torch::Tensor& gain) {
  MALUS_REQUIRE(noise.sizes() == clean.sizes() && noise.size(1) == channels_);
  const auto deviation = log_deviation(clean, gain);
  auto x = noise * torch::exp(-deviation);
  auto log_det = -deviation.sum({1, 2, 3});
  for (FlowStep& step : before_) x = step->forward(x, clean, gain, log_det);
  const auto scale = log_gain(gain);
  x = x * torch::exp(-scale);
  log_det = log_det - scale.sum({1, 2, 3}) * static_cast<double>(x.size(2) * x.size(3));
  for (FlowStep& step : after_) x = step->forward(x, clean, gain, log_det);
  return {x, log_det};
}

torch::Tensor NoiseFlow::inverse(torch::Tensor z, const torch::Tensor& clean,
                                 const torch::Tensor& gain) {
  for (std::size_t i = after_.size(); i-- > 0;) z = after_[i]->inverse(z, clean, gain);
  z = z * torch::exp(log_gain(gain));
  for (std::size_t i = before_.size(); i-- > 0;) z = before_[i]->inverse(z, clean, gain);
  return z * torch::exp(log_deviation(clean, gain));
}

bool NoiseFlow::draws_numbers(double gain) {
  for (const auto* steps : {&before_, &after_})
    for (const FlowStep& step : *steps)
      if (!step->can_be_undone()) return false;
  constexpr float kFar = 4;  // deviations of a normal draw
  const auto four = [&](std::vector<float> values) {
    return torch::tensor(values).view({4, 1, 1, 1}).expand({4, channels_, 3, 3});
  };
  const auto normals = four({-kFar, kFar, -kFar, kFar}), clean = four({0, 0, 1, 1}),
             gains = torch::full({4}, gain, torch::kFloat);
  return log_deviation(clean, gains).isfinite().all().item().toBool() &&
         inverse(normals, clean, gains).isfinite().all().item().toBool();
}

torch::Tensor NoiseFlow::log_likelihood(const torch::Tensor& noise, const torch::Tensor& clean,
                                        const torch::Tensor& gain) {
  const Normals normals = forward(noise, clean, gain);
  const auto values = static_cast<double>(noise.numel() / noise.size(0));
  return -0.5 * normals.z.square().sum({1, 2, 3}) - 0.5 * values * std::log(2 * std::numbers::pi) +
         normals.log_det;
}

}  // namespace malus
