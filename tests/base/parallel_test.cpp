#include "malus/base/parallel.h"

#include <atomic>
#include <mutex>
#include <new>
#include <set>
#include <thread>
#include <vector>

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

TEST(ParallelLoops, ALoopApartDoesAllOfItInsideOfAnother) {
  std::vector<std::atomic<int>> done(64 * 16);
  parallel_for(0, 64, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t i = begin; i < end; ++i)
      parallel_for_apart(16 * i, 16 * (i + 1), 3, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        for (std::ptrdiff_t k = first; k < last; ++k) ++done[static_cast<std::size_t>(k)];
      });
  });
  for (const std::atomic<int>& times : done) EXPECT_EQ(times, 1);
  EXPECT_THROW(
      parallel_for_apart(0, 8, 1, [](std::ptrdiff_t, std::ptrdiff_t) { throw std::bad_alloc(); }),
      std::bad_alloc);
}

}  // namespace
}  // namespace malus
