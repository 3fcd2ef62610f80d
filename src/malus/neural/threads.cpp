#include "malus/neural/threads.h"

#include "malus/base/parallel.h"
#include "malus/neural/internal/tasks.h"

#include <ATen/Parallel.h>

#if defined(_OPENMP)
#include <omp.h>
#endif

namespace malus {

void use_network_threads(int threads) { at::set_num_threads(threads); }

// at::set_num_threads would also start the threads of another pool anew, under a lock that a
// process that is forked meanwhile would find taken.
NetworkThreads::NetworkThreads() : NetworkThreads(thread_count()) {}

NetworkThreads::NetworkThreads([[maybe_unused]] int threads) : before_(at::get_num_threads()) {
#if defined(_OPENMP)
  omp_set_num_threads(threads);
#endif
}

NetworkThreads::~NetworkThreads() {
#if defined(_OPENMP)
  omp_set_num_threads(before_);
#endif
}

std::ptrdiff_t internal::task_threads() {
  return at::in_parallel_region() ? 1 : at::get_num_threads();
}

void internal::for_each_task(std::ptrdiff_t tasks,
                             const std::function<void(std::ptrdiff_t)>& task) {
  at::parallel_for(0, tasks, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t i = begin; i < end; ++i) task(i);
  });
}

}  // namespace malus
