// What a reader gets of a report's picture, by the format's description
// (malus/report/internal/raster.h): the page has its own (web/src).
#pragma once

#include "malus/report/internal/raster.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <zlib.h>

namespace malus::testing {

inline double raster_value(std::int32_t code, const RasterScale& scale, std::int32_t dither) {
  if (code == kNoValueCode) return std::numeric_limits<double>::quiet_NaN();
  const double t = (code - dither / 256.0) * scale.step, root = std::sqrt(scale.offset);
  if (t < 0 || scale.slope == 0) return t * root;
  return (std::pow(t * scale.slope / 2 + root, 2) - scale.offset) / scale.slope;
}

inline std::string inflated(std::string_view packed, std::size_t most) {
  std::string bytes(most, '\0');
  auto size = static_cast<uLongf>(most);
  if (uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size,
                 reinterpret_cast<const Bytef*>(packed.data()),
                 static_cast<uLong>(packed.size())) != Z_OK)
    throw std::runtime_error("the packed bytes are damaged");
  bytes.resize(size);
  return bytes;
}

// Reads one integer and moves `at` behind it.
inline std::int32_t take_integer(const std::string& bytes, std::size_t& at) {
  std::uint32_t zigzag = 0;
  for (int shift = 0;; shift += 7) {
    const auto byte = static_cast<unsigned char>(bytes.at(at++));
    zigzag |= static_cast<std::uint32_t>(byte & 127) << shift;
    if (byte < 128) break;
  }
  return static_cast<std::int32_t>(zigzag >> 1) ^ -static_cast<std::int32_t>(zigzag & 1);
}

/// The codes before it are in 1/256 of a step, without their dither.
inline std::int32_t expected_code(const std::vector<std::int32_t>& before, int row, int col,
                                  int cols, std::int32_t dither) {
  const auto at = [&](int r, int c) { return before[static_cast<std::size_t>(r * cols + c)]; };
  std::int32_t expected = 0;
  if (row == 0)
    expected = col == 0 ? 0 : at(0, col - 1);
  else if (col == 0 || col == cols - 1)
    expected = at(row - 1, col);
  else
    expected =
        (at(row, col - 1) + at(row - 1, col - 1) + at(row - 1, col) + at(row - 1, col + 1)) >> 2;
  return (expected + dither + 128) >> 8;
}

/// Throws where the bytes do not hold exactly this many values.
inline Planes decode_raster(std::string_view packed, int rows, int cols,
                            std::span<const RasterScale> scales, bool dithered) {
  Planes planes(static_cast<int>(scales.size()), rows, cols);
  const std::string bytes = inflated(packed, 5 * planes[0].size() * scales.size());
  std::size_t from = 0;
  for (int channel = 0; channel < planes.channels(); ++channel) {
    std::vector<std::int32_t> before;
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const std::int32_t dither = dithered ? dither_256({channel, r, c}) : 0;
        const std::int32_t code =
            expected_code(before, r, c, cols, dither) + take_integer(bytes, from);
        planes[channel](r, c) = static_cast<float>(
            raster_value(code, scales[static_cast<std::size_t>(channel)], dither));
        before.push_back(256 * code - dither);
      }
  }
  if (from != bytes.size()) throw std::runtime_error("it is longer than its size says");
  return planes;
}

}  // namespace malus::testing
