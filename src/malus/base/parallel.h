// Parallel loops over oneTBB. Results must not depend on the number of threads: write to disjoint
// outputs, or reduce through parallel_reduce, whose order is fixed by the grain alone.
#pragma once

#include "malus/base/error.h"

#include <cstddef>
#include <functional>
#include <vector>

namespace malus {

/// Sets the number of threads for the whole process; 0 means all cores. Returns the number in
/// force.
int set_thread_count(int threads);
int thread_count();

/// Calls body(begin, end) on disjoint pieces of [begin, end) whose bounds are multiples of grain
/// from begin. Contract: grain > 0. Exceptions thrown by body reach the caller.
void parallel_for(std::ptrdiff_t begin, std::ptrdiff_t end, std::ptrdiff_t grain,
                  const std::function<void(std::ptrdiff_t, std::ptrdiff_t)>& body);

/// The same for what may run inside of another loop's body: while it waits, its thread takes up no
/// piece of that loop, whose scratch memory may be the thread's own.
void parallel_for_apart(std::ptrdiff_t begin, std::ptrdiff_t end, std::ptrdiff_t grain,
                        const std::function<void(std::ptrdiff_t, std::ptrdiff_t)>& body);

/// While it lives, this thread's loops stay on this thread: for programs that have threads of their
/// own, each with a whole piece of work.
class SerialLoops {
 public:
  SerialLoops();
  ~SerialLoops();
  SerialLoops(const SerialLoops&) = delete;
  SerialLoops& operator=(const SerialLoops&) = delete;

 private:
  bool before_;
};

/// Rows of a picture that one task takes: many tasks even for small frames, few enough to cost
/// nothing.
inline constexpr int kRowsPerTask = 32;

/// Maps each grain-sized piece to a value in parallel and folds them in order: the same bits for
/// any thread count. Contract: grain > 0.
template <class T, class Map, class Fold>
T parallel_reduce(std::ptrdiff_t begin, std::ptrdiff_t end, std::ptrdiff_t grain, T initial,
                  Map&& map, Fold&& fold) {
  MALUS_REQUIRE(grain > 0);
  if (end <= begin) return initial;
  const std::ptrdiff_t pieces = (end - begin + grain - 1) / grain;
  std::vector<T> partial(static_cast<std::size_t>(pieces), initial);
  parallel_for(0, pieces, 1, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (std::ptrdiff_t i = first; i < last; ++i) {
      const std::ptrdiff_t from = begin + i * grain;
      partial[static_cast<std::size_t>(i)] = map(from, from + grain < end ? from + grain : end);
    }
  });
  T total = initial;
  for (const T& part : partial) total = fold(total, part);
  return total;
}

}  // namespace malus
