#include "malus/base/large_pages.h"

#include "malus/base/parallel.h"

#include <cstdint>

#ifdef __linux__
#include <sys/mman.h>
#include <unistd.h>
#endif

namespace malus {

void prepare_pages([[maybe_unused]] void* begin, [[maybe_unused]] std::size_t bytes) {
#ifdef __linux__
  constexpr std::size_t kLeastBytes = std::size_t{4} << 20;
  if (bytes < kLeastBytes) return;
  // The system wants whole small pages; those at the ends are shared with other memory.
  static const auto page = static_cast<std::uintptr_t>(sysconf(_SC_PAGESIZE));
  const auto address = reinterpret_cast<std::uintptr_t>(begin);
  const std::uintptr_t first = (address + page - 1) / page * page,
                       last = (address + bytes) / page * page;
  (void)madvise(reinterpret_cast<void*>(first), last - first, MADV_HUGEPAGE);
  constexpr std::uintptr_t kLargePage = std::uintptr_t{2} << 20;
  const auto pages_of_piece = static_cast<std::ptrdiff_t>(kLargePage / page);
  auto* const memory = reinterpret_cast<volatile unsigned char*>(first);
  parallel_for_apart(0, static_cast<std::ptrdiff_t>((last - first) / page), pages_of_piece,
                     [&](std::ptrdiff_t from, std::ptrdiff_t to) {
                       for (std::ptrdiff_t i = from; i < to; ++i)
                         memory[static_cast<std::uintptr_t>(i) * page] = 0;
                     });
#endif
}

}  // namespace malus
