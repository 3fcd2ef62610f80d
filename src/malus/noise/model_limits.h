// What a model file holds at most, far above any real model: reading refuses more before it
// allocates, and writing and calibrating keep to it.
#pragma once

#include <cstddef>

namespace malus {

/// Numbers of one data set, such as levels x bins of one channel's distributions.
inline constexpr std::size_t kMostModelValues = std::size_t{1} << 24;

}  // namespace malus
