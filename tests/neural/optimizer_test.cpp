// Truth: closed forms of the schedules, torch's own Adam.
#include "malus/neural/internal/optimizer.h"

#include <cmath>
#include <numbers>

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

}  // namespace
}  // namespace malus
