#include "malus/neural/threads.h"

#include "malus/neural/internal/tasks.h"

#include <ATen/Parallel.h>

namespace malus {

void use_network_threads(int threads) { at::set_num_threads(threads); }

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
