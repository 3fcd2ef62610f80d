// A group of one goes the ways of any other: rendezvous, sum, broadcast. Several workers are tested
// as processes (tests/system/test_training_processes.py), their waiting as threads here.
#include "malus/neural/workers.h"

#include "malus/base/error.h"
#include "malus/neural/internal/short_waits.h"
#include "malus/neural/trainer.h"

#include <chrono>
#include <cstdlib>
#include <future>
#include <stdexcept>
#include <string>
#include <thread>

#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>
#if defined(USE_C10D_GLOO)
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#endif

namespace malus {
namespace {

void sums_and_broadcasts(const torch::Device& device) {
  setenv("MASTER_PORT", "0", 1);  // any that is free
  const auto workers = meet_workers({.rank = 0, .size = 1}, 30, device, silent_progress());
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

constexpr const char* kWithoutC10d = "built without PyTorch's c10d";

bool has_c10d() {
  try {
    sums_and_broadcasts(torch::kCPU);
    return true;
  } catch (const InputError& error) {
    if (std::string(error.what()).find("for one worker") == std::string::npos) throw;
    return false;
  }
}

TEST(Workers, OneOnACpuMeetsItself) {
  if (!has_c10d()) GTEST_SKIP() << kWithoutC10d;
}

// A port that nobody listens on.
std::string free_port() {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(bind(listener, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size), 0);
  close(listener);
  return std::to_string(ntohs(address.sin_port));
}

// Two workers of this process, threads that meet through c10d; worker 0 comes so much later.
template <class Work>
void two_workers(double timeout_s, const Work& work, const std::string& port = free_port(),
                 std::chrono::milliseconds late = {}) {
  setenv("MASTER_PORT", port.c_str(), 1);
  setenv("GLOO_SOCKET_IFNAME", "lo", 1);
  const auto worker = [&](int rank) {
    if (rank == 0) std::this_thread::sleep_for(late);
    work(*meet_workers({.rank = rank, .size = 2}, timeout_s, torch::kCPU, silent_progress()));
  };
  auto other = std::async(std::launch::async, worker, 1);
  EXPECT_NO_THROW(worker(0));
  EXPECT_NO_THROW(other.get());
  unsetenv("MASTER_PORT");
  unsetenv("GLOO_SOCKET_IFNAME");
}

float sum_of_ranks(Workers& workers) {
  torch::Tensor values = torch::full({2}, static_cast<float>(workers.rank() + 1));
  workers.sum(values);
  return values[0].item<float>();
}

TEST(Workers, WaitForTheLeaderLongerThanForAMessage) {
  if (!has_c10d()) GTEST_SKIP() << kWithoutC10d;
  constexpr double kTimeoutS = 3;
  two_workers(kTimeoutS, [&](Workers& workers) {
    if (workers.rank() == 0)
      std::this_thread::sleep_for(std::chrono::duration<double>(kTimeoutS + 1.5));
    workers.wait_for_leader();
    EXPECT_EQ(sum_of_ranks(workers), 3);
  });
}

// A message that ends, well or badly, after a wait for it has and before that is looked at.
struct LateMessage {
  bool fails = false;
  int waits = 0;

  void wait(std::chrono::milliseconds) {
    ++waits;
    throw std::runtime_error("timed out");
  }
  void wait() const {
    if (fails) throw std::runtime_error("lost");
  }
  bool isCompleted() const { return waits == 3; }
};

TEST(ShortWaits, WhatEndsWhileTheWishToStopIsLookedAtIsNoTimeOut) {
  LateMessage message;
  int looks = 0;
  const auto finish = [&] {
    finish_in_short_waits(message, std::chrono::milliseconds(1), [&] { ++looks; });
  };
  EXPECT_NO_THROW(finish());
  EXPECT_EQ(looks, 2);
  message = {.fails = true};
  try {
    finish();
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_STREQ(error.what(), "lost");
  }
}

#if defined(USE_C10D_GLOO)
// The agent of torchrun keeps one meeting point over all attempts: the other must not take what
// worker 0 left there for what it is about to leave.
TEST(Workers, MeetAgainAtTheMeetingPointOfAnEarlierAttempt) {
  if (!has_c10d()) GTEST_SKIP() << kWithoutC10d;
  c10d::TCPStoreOptions options;
  options.port = 0;  // any that is free
  options.isServer = true;
  options.waitWorkers = false;
  const c10d::TCPStore agent("127.0.0.1", options);
  setenv("TORCHELASTIC_USE_AGENT_STORE", "True", 1);
  for (const char* attempt : {"0", "1"}) {
    SCOPED_TRACE(attempt);
    setenv("TORCHELASTIC_RESTART_COUNT", attempt, 1);
    two_workers(
        5, [](Workers& workers) { EXPECT_EQ(sum_of_ranks(workers), 3); },
        std::to_string(agent.getPort()), std::chrono::milliseconds(500));
  }
  unsetenv("TORCHELASTIC_USE_AGENT_STORE");
  unsetenv("TORCHELASTIC_RESTART_COUNT");
}
#endif

// One of two whose other does the same, and what it asks of it.
class Mirrored final : public Workers {
 public:
  explicit Mirrored(int rank) : rank_(rank) {}
  int rank() const override { return rank_; }
  int size() const override { return 2; }
  void sum(torch::Tensor& values) override {
    values.mul_(2);
    calls += 's';
  }
  void broadcast(torch::Tensor&) override { calls += 'b'; }
  void wait_for_leader() override { calls += 'w'; }
  std::string calls;

 private:
  int rank_;
};

// Worker 0 alone validates; that the others' calls are the same, in the same order, is what keeps
// them from waiting for messages meanwhile.
TEST(Workers, WaitAfterEveryValidationButTheLast) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = testing::scene_config(scene);
  config.train.steps = 5;
  config.validation_scenes = {scene.path};
  config.cases = {{12, 10}};
  config.validation.every = 2;
  config.validation.crop = 48;
  std::vector<std::string> calls;
  for (const int rank : {0, 1}) {
    Mirrored worker(rank);
    train(config, {folder / std::to_string(rank), false, false, 3}, worker, silent_progress());
    calls.push_back(worker.calls);
  }
  EXPECT_EQ(calls[0], calls[1]);
  EXPECT_TRUE(calls[0].ends_with("sswssws")) << calls[0];
}

TEST(Workers, OneOnAGpuMeetsItself) {
  if (!torch::cuda::is_available()) GTEST_SKIP() << "libtorch finds no GPU";
  sums_and_broadcasts(torch::Device(torch::kCUDA, 0));
}

}  // namespace
}  // namespace malus
