#include "malus/base/frame_numbers.h"

#include "malus/base/error.h"

#include <algorithm>
#include <limits>

#include <fmt/format.h>

namespace malus {

void require_numbers_left(const std::string& name, std::uint32_t first, std::int64_t count) {
  constexpr std::int64_t kLast = std::numeric_limits<std::uint32_t>::max();
  if (count - 1 > kLast - first)
    throw InputError(
        fmt::format("{} {}", name, first),
        fmt::format("leaves no {} numbers up to {}, and a number twice repeats its noise", count,
                    kLast),
        fmt::format("begin at {} or below", std::max<std::int64_t>(0, kLast - count + 1)));
}

}  // namespace malus
