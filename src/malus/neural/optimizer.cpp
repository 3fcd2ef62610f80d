#include "malus/neural/internal/optimizer.h"

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
  // Lists, for a GPU takes a whole list in few launches.
  std::vector<torch::Tensor> parameters, gradients, first, second;
  for (std::size_t i = 0; i < parameters_.size(); ++i) {
    if (!parameters_[i].grad().defined()) continue;
    parameters.push_back(parameters_[i]);
    gradients.push_back(parameters_[i].grad());
    first.push_back(first_[i]);
    second.push_back(second_[i]);
  }
  if (parameters.empty()) return;
  at::_foreach_mul_(first, beta1_);
  at::_foreach_add_(first, gradients, 1 - beta1_);
  at::_foreach_mul_(second, beta2_);
  at::_foreach_addcmul_(second, gradients, gradients, 1 - beta2_);
  std::vector<torch::Tensor> deviation = at::_foreach_sqrt(second);
  at::_foreach_div_(deviation, std::sqrt(correction2));
  at::_foreach_add_(deviation, kEpsilon);
  at::_foreach_addcdiv_(parameters, first, deviation, -rate / correction1);
}

double clip_gradients(const std::vector<torch::Tensor>& parameters, double limit) {
  const torch::NoGradGuard no_gradients;
  std::vector<torch::Tensor> gradients;
  for (const torch::Tensor& parameter : parameters)
    if (parameter.grad().defined()) gradients.push_back(parameter.grad());
  if (gradients.empty()) return 0;
  const torch::Tensor norms = torch::stack(at::_foreach_norm(gradients, 2));
  const double norm = norms.to(torch::kFloat64).norm().item<double>();
  if (limit > 0 && norm > limit) at::_foreach_mul_(gradients, limit / norm);
  return norm;
}

void update_average(std::vector<torch::Tensor>& average,
                    const std::vector<torch::Tensor>& parameters, double memory,
                    std::int64_t step) {
  const torch::NoGradGuard no_gradients;
  const double early = (1.0 + static_cast<double>(step)) / (10.0 + static_cast<double>(step));
  const double keep = std::min(memory, early);
  at::_foreach_mul_(average, keep);
  at::_foreach_add_(average, parameters, 1 - keep);
}

AveragedWeights::AveragedWeights(std::vector<torch::Tensor> parameters,
                                 std::vector<torch::Tensor>& average, bool wanted)
    : parameters_(std::move(parameters)), average_(average), wanted_(wanted) {
  exchange();
}

AveragedWeights::~AveragedWeights() { exchange(); }

void AveragedWeights::exchange() {
  if (!wanted_) return;
  for (std::size_t i = 0; i < parameters_.size(); ++i) {
    const torch::Tensor held = parameters_[i].data();
    parameters_[i].set_data(average_[i]);
    average_[i] = held;
  }
}

}  // namespace malus
