// Parallel loops on the threads that libtorch's own operations use: oneTBB's beside them would be
// too many.
#pragma once

#include <cstddef>
#include <functional>

namespace malus::internal {

/// task(i) for i < tasks.
void for_each_task(std::ptrdiff_t tasks, const std::function<void(std::ptrdiff_t)>& task);

}  // namespace malus::internal
