// Parallel loops on the threads that libtorch's own operations use: oneTBB's beside them would be
// too many.
#pragma once

#include <cstddef>
#include <functional>

namespace malus::internal {

/// task(i) for i < tasks.
void for_each_task(std::ptrdiff_t tasks, const std::function<void(std::ptrdiff_t)>& task);
/// On how many threads for_each_task would run here.
std::ptrdiff_t task_threads();

}  // namespace malus::internal
