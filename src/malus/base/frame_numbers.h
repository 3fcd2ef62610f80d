// Frames and scenes are numbered with 32 bits (base/random.h), and a number that came round would
// repeat noise.
#pragma once

#include <cstdint>
#include <string>

namespace malus {

/// Throws InputError, naming the flag or argument, where `count` numbers from `first` do not fit.
void require_numbers_left(const std::string& name, std::uint32_t first, std::int64_t count);

}  // namespace malus
