// Two workers, of whom the second is played: what it would send is known.
#include "malus/neural/internal/worker_sharing.h"

#include "small_networks.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Sums with itself plus one, and broadcasts twice what it is told.
class PlayedWorkers : public Workers {
 public:
  explicit PlayedWorkers(int size) : size_(size) {}
  int rank() const override { return 1; }
  int size() const override { return size_; }
  void sum(torch::Tensor& values) override {
    ++messages;
    values.add_(values + 1);
  }
  void broadcast(torch::Tensor& values) override {
    ++messages;
    values.mul_(2);
  }
  void wait_for_leader() override {}
  int messages = 0;

 private:
  int size_;
};

std::vector<torch::Tensor> two_parameters() {
  std::vector<torch::Tensor> parameters = {torch::ones({2, 3}), torch::ones({4})};
  for (torch::Tensor& parameter : parameters) parameter.set_requires_grad(true);
  return parameters;
}

TEST(WorkerSharing, GradientsAndWhatIsToldBecomeTheMean) {
  PlayedWorkers workers(2);
  const auto parameters = two_parameters();
  parameters[0].mutable_grad() = torch::full({2, 3}, 5.0);
  const torch::Tensor told = mean_over_workers(workers, parameters, torch::tensor({1.0f, 8.0f}));
  EXPECT_TRUE(torch::equal(parameters[0].grad(), torch::full({2, 3}, 5.5)));
  EXPECT_FALSE(parameters[1].grad().defined());
  EXPECT_TRUE(torch::equal(told, torch::tensor({1.5f, 8.5f})));
  EXPECT_EQ(workers.messages, 1);
}

TEST(WorkerSharing, OneAloneSendsNothing) {
  PlayedWorkers workers(1);
  const auto parameters = two_parameters();
  parameters[0].mutable_grad() = torch::full({2, 3}, 5.0);
  const torch::Tensor told = mean_over_workers(workers, parameters, torch::tensor({1.0f}));
  EXPECT_TRUE(torch::equal(parameters[0].grad(), torch::full({2, 3}, 5.0)));
  EXPECT_EQ(told.item<float>(), 1);
  EXPECT_EQ(workers.messages, 0);
}

// Everything that worker 0 holds reaches the others, here doubled on its way.
TEST(WorkerSharing, TheOthersBeginWithTheLeadersState) {
  const auto network = make_network(testing::small_network("unet"));
  Adam adam(network->parameters(), 0.9, 0.99);
  std::vector<torch::Tensor> average;
  for (const torch::Tensor& parameter : network->parameters())
    average.push_back(torch::ones_like(parameter.detach()));
  adam.first_moments()[0].fill_(3);
  adam.second_moments()[0].fill_(4);
  const torch::Tensor weights = network->parameters()[0].detach().clone();
  TrainingState state{*network, adam, average, 21};
  state.first_loss = 0.5;
  state.refresh = {.per_step = 0.25, .from = 7, .generation = 2};
  PlayedWorkers workers(2);
  EXPECT_TRUE(take_leaders_state(workers, state, true, torch::kCPU));
  EXPECT_EQ(state.step, 42);
  EXPECT_EQ(state.first_loss, 1);
  EXPECT_EQ(state.refresh.per_step, 0.5);
  EXPECT_EQ(state.refresh.from, 14);
  EXPECT_EQ(state.refresh.generation, 4);
  EXPECT_TRUE(torch::equal(network->parameters()[0].detach(), 2 * weights));
  for (const torch::Tensor& mean : average) EXPECT_TRUE((mean == 2).all().item<bool>());
  EXPECT_TRUE((adam.first_moments()[0] == 6).all().item<bool>());
  EXPECT_TRUE((adam.second_moments()[0] == 8).all().item<bool>());
  EXPECT_FALSE(take_leaders_state(workers, state, false, torch::kCPU));
}

}  // namespace
}  // namespace malus
