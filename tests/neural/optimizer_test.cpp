// Truth: closed forms of the schedules and of the moving average, torch's own Adam.
#include "malus/neural/internal/optimizer.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(Schedule, WarmsUpLinearlyThenFallsAsACosineOrInSteps) {
  TrainSettings settings;
  settings.learning_rate = 1e-3;
  settings.warm_up = 10;
  settings.steps = 110;
  settings.final_rate = 0.1;
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 0), 1e-4);
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 9), 1e-3);
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 10), 1e-3);
  EXPECT_NEAR(learning_rate_at(settings, 60), 0.55e-3, 1e-12);  // halfway between 1 and 0.1
  EXPECT_NEAR(learning_rate_at(settings, 110), 1e-4, 1e-12);
  settings.schedule = "step";
  settings.step_every = 20;
  settings.step_factor = 0.5;
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 29), 1e-3);
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 30), 0.5e-3);
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 70), 0.125e-3);
  settings.schedule = "constant";
  EXPECT_DOUBLE_EQ(learning_rate_at(settings, 109), 1e-3);
}

TEST(AdamUpdate, AgreesWithTorchsOwn) {
  torch::manual_seed(3);
  auto ours = torch::randn({5, 7}).requires_grad_();
  auto theirs = ours.detach().clone().requires_grad_();
  const auto target = torch::randn({5, 7});
  Adam adam({ours}, 0.9, 0.99);
  torch::optim::Adam reference({theirs}, torch::optim::AdamOptions(0.05).betas({0.9, 0.99}));
  for (int step = 0; step < 20; ++step) {
    for (auto* x : {&ours, &theirs}) {
      x->mutable_grad().reset();
      ((*x - target).pow(4)).sum().backward();
    }
    adam.update(0.05, step);
    reference.step();
  }
  EXPECT_LT((ours - theirs).abs().max().item<double>(), 1e-5);
}

TEST(ClipGradients, KeepsTheDirectionAndLimitsTheNorm) {
  auto a = torch::zeros({2}).requires_grad_(), b = torch::zeros({1}).requires_grad_();
  const auto set = [&] {
    a.mutable_grad() = torch::tensor({3.0f, 0.0f});
    b.mutable_grad() = torch::tensor({4.0f});
  };
  set();
  EXPECT_NEAR(clip_gradients({a, b}, 0), 5, 1e-6);
  EXPECT_FLOAT_EQ(b.grad().item<float>(), 4);
  EXPECT_NEAR(clip_gradients({a, b}, 1), 5, 1e-6);
  EXPECT_NEAR(a.grad()[0].item<float>(), 0.6, 1e-6);
  EXPECT_NEAR(b.grad().item<float>(), 0.8, 1e-6);
}

// From an average of 2 and parameters of 5, 5 - 3 * memory is left; with (1 + step) / (10 + step)
// for the memory where that is less.
TEST(MovingAverage, RemembersLittleEarlyAndTheStatedShareLater) {
  struct Case {
    double memory;
    std::int64_t step;
    double kept;
  };
  for (const Case& one :
       {Case{0.999, 0, 1.0 / 10}, Case{0.999, 1, 2.0 / 11}, Case{0.999, 1000, 1001.0 / 1010},
        Case{0.999, 8989, 8990.0 / 8999}, Case{0.999, 8991, 0.999}, Case{0.999, 1000000, 0.999},
        Case{0.9, 0, 0.1}, Case{0.9, 1000, 0.9}}) {
    std::vector<torch::Tensor> average{torch::full({2, 3}, 2.0, torch::kDouble),
                                       torch::full({1}, -4.0, torch::kDouble)};
    const std::vector<torch::Tensor> parameters{torch::full({2, 3}, 5.0, torch::kDouble),
                                                torch::full({1}, 8.0, torch::kDouble)};
    update_average(average, parameters, one.memory, one.step);
    EXPECT_LT((average[0] - (5 - 3 * one.kept)).abs().max().item<double>(), 1e-12)
        << one.memory << ' ' << one.step;
    EXPECT_NEAR(average[1].item<double>(), 8 - 12 * one.kept, 1e-12)
        << one.memory << ' ' << one.step;
    EXPECT_EQ(parameters[0].min().item<double>(), 5);
  }
}

// A training's weights are of one size, and so is their average, after however many steps.
TEST(MovingAverage, OfWeightsThatStayStays) {
  const std::vector<torch::Tensor> parameters{torch::full({3}, 0.7)};
  std::vector<torch::Tensor> average{torch::full({3}, 0.7)};
  for (int step = 0; step < 2000; ++step) update_average(average, parameters, 0.999, step);
  EXPECT_LT((average[0] - parameters[0]).abs().max().item<double>(), 1e-4);
}

TEST(AveragedWeights, AreInForceUntilTheEndOfTheirScope) {
  auto network = torch::full({2}, 3.0f).requires_grad_();
  std::vector<torch::Tensor> average{torch::full({2}, 1.0f)};
  const auto all_are = [](const torch::Tensor& values, float wanted) {
    return torch::equal(values.detach(), torch::full({2}, wanted));
  };
  {
    const AveragedWeights in_force({network}, average, false);
    EXPECT_TRUE(all_are(network, 3));
  }
  {
    const AveragedWeights in_force({network}, average, true);
    EXPECT_TRUE(all_are(network, 1));
  }
  EXPECT_TRUE(all_are(network, 3));
  EXPECT_TRUE(all_are(average[0], 1));
  EXPECT_TRUE(network.requires_grad());
  // Each goes its own way again.
  update_average(average, {network}, 0.5, 1000);
  EXPECT_TRUE(all_are(network, 3));
  EXPECT_TRUE(all_are(average[0], 2));
}

}  // namespace
}  // namespace malus
