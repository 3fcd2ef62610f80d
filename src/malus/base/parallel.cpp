#include "malus/base/parallel.h"

#include "malus/base/error.h"
#include "malus/base/fork.h"

#include <atomic>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

// The thread sanitizer cannot see into the oneTBB library. So under it this file is compiled
// without (CMakeLists.txt), and it is told what a fork and a join order.
#if defined(MALUS_THREAD_SANITIZER)
#include <sanitizer/tsan_interface.h>
#else
namespace {
void __tsan_release(void*) {}  // NOLINT: the sanitizer's names
void __tsan_acquire(void*) {}  // NOLINT
}  // namespace
#endif

namespace malus {
namespace {

struct ThreadLimit {
  std::mutex mutex;
  std::unique_ptr<tbb::global_control> control;
};

ThreadLimit& thread_limit() {
  static ThreadLimit limit;
  return limit;
}

std::atomic<bool> alone = false;
thread_local bool serial = false;

}  // namespace

void work_alone(bool wanted) { alone = wanted; }
bool works_alone() { return alone; }

SerialLoops::SerialLoops() : before_(std::exchange(serial, true)) {}
SerialLoops::~SerialLoops() { serial = before_; }

int set_thread_count(int threads) {
  MALUS_REQUIRE(threads >= 0);
  if (alone && threads == 1) return 1;
  alone = false;
  auto& limit = thread_limit();
  const std::lock_guard lock(limit.mutex);
  limit.control.reset();
  if (threads > 0)
    limit.control = std::make_unique<tbb::global_control>(
        tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
  return thread_count();
}

int thread_count() {
  if (alone) return 1;
  return static_cast<int>(
      tbb::global_control::active_value(tbb::global_control::max_allowed_parallelism));
}

void parallel_for(std::ptrdiff_t begin, std::ptrdiff_t end, std::ptrdiff_t grain,
                  const std::function<void(std::ptrdiff_t, std::ptrdiff_t)>& body) {
  MALUS_REQUIRE(grain > 0);
  if (end <= begin) return;
  if (alone || serial) return body(begin, end);
  const std::ptrdiff_t pieces = (end - begin + grain - 1) / grain;
  char fork = 0, join = 0;
  __tsan_release(&fork);
  tbb::parallel_for(tbb::blocked_range<std::ptrdiff_t>(0, pieces), [&](const auto& range) {
    __tsan_acquire(&fork);
    const std::ptrdiff_t last = begin + range.end() * grain;
    body(begin + range.begin() * grain, last < end ? last : end);
    __tsan_release(&join);
  });
  __tsan_acquire(&join);
}

void parallel_for_apart(std::ptrdiff_t begin, std::ptrdiff_t end, std::ptrdiff_t grain,
                        const std::function<void(std::ptrdiff_t, std::ptrdiff_t)>& body) {
  tbb::this_task_arena::isolate([&] { parallel_for(begin, end, grain, body); });
}

}  // namespace malus
