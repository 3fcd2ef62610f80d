// Where a thread of a kernel stands, for functions made by ptx_to_cpp.py.
#pragma once

#include <array>

namespace malus::testing::ptx {

/// Block of the grid, threads per block, thread of the block; x, y, z.
struct Place {
  std::array<unsigned, 3> block{}, threads{1, 1, 1}, thread{};
};

}  // namespace malus::testing::ptx
