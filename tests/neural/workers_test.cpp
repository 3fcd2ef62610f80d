// A group of one goes the ways of any other: rendezvous, sum, broadcast. Several workers are tested
// as processes (tests/system/test_training.py).
#include "malus/neural/workers.h"

#include "malus/base/error.h"

#include <cstdlib>
#include <string>

#include <gtest/gtest.h>

namespace malus {
namespace {

void sums_and_broadcasts(const torch::Device& device) {
  setenv("MASTER_PORT", "0", 1);  // any that is free
  const auto workers = meet_workers({.rank = 0, .size = 1}, 30, device);
  unsetenv("MASTER_PORT");
  EXPECT_EQ(workers->rank(), 0);
  EXPECT_EQ(workers->size(), 1);
  const torch::Tensor values = torch::arange(5, torch::kFloat32).to(device);
  torch::Tensor sum = values.clone(), same = values.clone();
  workers->sum(sum);
  workers->broadcast(same);
  EXPECT_TRUE(torch::equal(sum, values));
  EXPECT_TRUE(torch::equal(same, values));
}

TEST(Workers, OneOnACpuMeetsItself) {
  try {
    sums_and_broadcasts(torch::kCPU);
  } catch (const InputError& error) {
    if (std::string(error.what()).find("for one worker") == std::string::npos) throw;
    GTEST_SKIP() << "built without PyTorch's c10d";
  }
}

TEST(Workers, OneOnAGpuMeetsItself) {
  if (!torch::cuda::is_available()) GTEST_SKIP() << "libtorch finds no GPU";
  sums_and_broadcasts(torch::Device(torch::kCUDA, 0));
}

}  // namespace
}  // namespace malus
