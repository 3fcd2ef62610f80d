#include "malus/base/parallel.h"

#include <mutex>
#include <set>
#include <thread>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(SerialLoops, StayOnTheirThreadAndMissNothing) {
  const SerialLoops alone;
  std::set<std::thread::id> threads;
  std::mutex mutex;
  std::ptrdiff_t done = 0;
  parallel_for(3, 1003, 10, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    const std::lock_guard lock(mutex);
    threads.insert(std::this_thread::get_id());
    done += end - begin;
  });
  EXPECT_EQ(done, 1000);
  EXPECT_EQ(threads, std::set{std::this_thread::get_id()});
}

// The pieces of a reduction are the same, so its sum is too, to the last bit.
TEST(SerialLoops, GiveTheSameSums) {
  const auto sum = [] {
    return parallel_reduce(
        0, 100000, 64, 0.0,
        [](std::ptrdiff_t begin, std::ptrdiff_t end) {
          double part = 0;
          for (std::ptrdiff_t i = begin; i < end; ++i) part += 1.0 / static_cast<double>(i + 1);
          return part;
        },
        [](double a, double b) { return a + b; });
  };
  const double shared = sum();
  {
    const SerialLoops outer;
    { const SerialLoops inner; }
    EXPECT_EQ(sum(), shared);
  }
  EXPECT_EQ(sum(), shared);
}

TEST(ParallelLoops, AGrainIsAtLeastOne) {
  const auto sum_in_pieces_of = [](std::ptrdiff_t grain) {
    return parallel_reduce(
        0, 10, grain, 0, [](std::ptrdiff_t, std::ptrdiff_t) { return 1; },
        [](int a, int b) { return a + b; });
  };
  EXPECT_EQ(sum_in_pieces_of(4), 3);
  EXPECT_THROW(sum_in_pieces_of(0), ContractViolation);
  EXPECT_THROW(sum_in_pieces_of(-4), ContractViolation);
}

}  // namespace
}  // namespace malus
