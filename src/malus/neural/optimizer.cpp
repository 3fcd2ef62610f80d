#include "malus/neural/optimizer.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace malus {

double learning_rate_at(const TrainSettings& settings, std::int64_t step) {
  if (step < settings.warm_up)
    return settings.learning_rate * static_cast<double>(step + 1) / settings.warm_up;
  const auto after = static_cast<double>(step - settings.warm_up);
  if (settings.schedule == "constant") return settings.learning_rate;
  if (settings.schedule == "step")
    return settings.learning_rate *
           std::pow(settings.step_factor, std::floor(after / settings.step_every));
  const double length = std::max(1, settings.steps - settings.warm_up);
  const double down = 0.5 * (1 + std::cos(std::numbers::pi * std::min(after / length, 1.0)));
  return settings.learning_rate * (settings.final_rate + (1 - settings.final_rate) * down);
}

Adam::Adam(std::vector<torch::Tensor> parameters, double beta1, double beta2)
    : parameters_(std::move(parameters)), beta1_(beta1), beta2_(beta2) {
  for (const torch::Tensor& parameter : parameters_) {
    first_.push_back(torch::zeros_like(parameter).detach());
    second_.push_back(torch::zeros_like(parameter).detach());
  }
}

void Adam::update(double rate, std::int64_t step) {
  constexpr double kEpsilon = 1e-8;
  const torch::NoGradGuard no_gradients;
  const auto count = static_cast<double>(step + 1);
  const double correction1 = 1 - std::pow(beta1_, count), correction2 = 1 - std::pow(beta2_, count);
  for (std::size_t i = 0; i < parameters_.size(); ++i) {
    const torch::Tensor& gradient = parameters_[i].grad();
    if (!gradient.defined()) continue;
    first_[i].mul_(beta1_).add_(gradient, 1 - beta1_);
    second_[i].mul_(beta2_).addcmul_(gradient, gradient, 1 - beta2_);
    const auto deviation = second_[i].sqrt().div_(std::sqrt(correction2)).add_(kEpsilon);
    parameters_[i].addcdiv_(first_[i], deviation, -rate / correction1);
  }
}

double clip_gradients(const std::vector<torch::Tensor>& parameters, double limit) {
  double sum = 0;
  for (const torch::Tensor& parameter : parameters)
    if (parameter.grad().defined())
      sum += parameter.grad().square().sum(torch::kFloat64).item<double>();
  const double norm = std::sqrt(sum);
  if (limit > 0 && norm > limit)
    for (const torch::Tensor& parameter : parameters)
      if (parameter.grad().defined()) parameter.grad().mul_(limit / norm);
  return norm;
}

void update_average(std::vector<torch::Tensor>& average,
                    const std::vector<torch::Tensor>& parameters, double memory,
                    std::int64_t step) {
  const torch::NoGradGuard no_gradients;
  const double early = (1.0 + static_cast<double>(step)) / (10.0 + static_cast<double>(step));
  const double keep = std::min(memory, early);
  for (std::size_t i = 0; i < average.size(); ++i)
    average[i].mul_(keep).add_(parameters[i], 1 - keep);
}

}  // namespace malus
