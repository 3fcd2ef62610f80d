// Tar archives (ustar), in which shards are kept.
#pragma once

#include <cstddef>

namespace malus::internal {

/// Headers and contents are padded to multiples of this.
inline constexpr std::size_t kTarBlock = 512;

}  // namespace malus::internal
