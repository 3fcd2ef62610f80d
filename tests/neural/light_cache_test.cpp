// What is read, how often, and who waits; no pictures.
#include "malus/neural/internal/light_cache.h"

#include "malus/base/error.h"

#include <atomic>
#include <chrono>
#include <future>
#include <latch>
#include <thread>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kOneMib = 1;
constexpr int kSide = 512;  // a plane of 1 MiB

LightCache::Light light_of(float value) {
  LightCache::Light light(1);
  light[0].s0 = Image(kSide, kSide, value);
  return light;
}

// Four threads want the same light while it is read for as long as they need to ask for it: one
// reads it, and all have the same memory.
TEST(LightCache, IsReadByOneWhileTheOthersWait) {
  LightCache cache(kOneMib);
  constexpr int kThreads = 4;
  std::atomic<int> reads = 0;
  std::latch all_here(kThreads);
  const auto want = [&] {
    all_here.count_down();
    return cache.light("a", [&] {
      ++reads;
      all_here.wait();
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      return light_of(7);
    });
  };
  std::vector<std::future<std::shared_ptr<const LightCache::Light>>> found;
  for (int i = 0; i < kThreads; ++i) found.push_back(std::async(std::launch::async, want));
  const auto first = found[0].get();
  EXPECT_EQ((*first)[0].s0(0, 0), 7);
  for (int i = 1; i < kThreads; ++i) EXPECT_EQ(found[static_cast<std::size_t>(i)].get(), first);
  EXPECT_EQ(reads, 1);
}

// Each of two reads ends only when the other has begun.
TEST(LightCache, ReadsDifferentLightAtTheSameTime) {
  LightCache cache(kOneMib);
  std::latch both(2);
  const auto want = [&](const char* name) {
    return cache.light(name, [&] {
      both.arrive_and_wait();
      return light_of(1);
    });
  };
  auto one = std::async(std::launch::async, want, "a"),
       two = std::async(std::launch::async, want, "b");
  EXPECT_NE(one.get(), two.get());
}

TEST(LightCache, WhoeverWaitsGetsTheFailureAndTheNextReadsAgain) {
  LightCache cache(kOneMib);
  std::latch reads(1);
  std::atomic<int> failures = 0;
  const auto fail = [&]() -> LightCache::Light {
    reads.count_down();
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
    throw InputError("a", "is no picture", "give another");
  };
  const auto want = [&] {
    try {
      cache.light("a", fail);
    } catch (const InputError&) {
      ++failures;
    }
  };
  std::thread reader(want);
  reads.wait();
  std::thread waiter([&] {
    try {
      cache.light("a", [] { return light_of(1); });
    } catch (const InputError& error) {
      failures += error.problem() == "is no picture" ? 1 : 0;
    }
  });
  reader.join();
  waiter.join();
  EXPECT_EQ(failures, 2);
  EXPECT_EQ((*cache.light("a", [] { return light_of(3); }))[0].s0(1, 1), 3);
}

// Two planes of 1 MiB fit; the first to come is the first to go, and the last one stays even where
// there is no room at all.
TEST(LightCache, KeepsAsMuchAsItMay) {
  for (const double room_mib : {2.0, 0.5}) {
    LightCache cache(room_mib);
    int reads = 0;
    const auto want = [&](const char* name) {
      cache.light(name, [&] {
        ++reads;
        return light_of(1);
      });
    };
    want("a");
    want("b");
    want("b");
    EXPECT_EQ(reads, 2);
    want("a");
    EXPECT_EQ(reads, room_mib > 1 ? 2 : 3);
    want("c");
    reads = 0;
    want("c");
    EXPECT_EQ(reads, 0);
    want("b");
    EXPECT_EQ(reads, room_mib > 1 ? 0 : 1);
    want("a");
    EXPECT_EQ(reads, room_mib > 1 ? 1 : 2);
  }
}

}  // namespace
}  // namespace malus
