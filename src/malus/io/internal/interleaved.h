// Samples side by side in a file's rows, channel by channel within a pixel, and planes.
#pragma once

#include "malus/image/view.h"
#include "malus/io/internal/stored_value.h"

#include <cstddef>
#include <span>
#include <vector>

namespace malus::internal {

/// Rows row0 to row1 (exclusive) as a file's sample type holds them.
template <class T>
std::vector<T> interleaved_rows(std::span<const Image> planes, int row0, int row1) {
  std::vector<T> values;
  const int cols = planes[0].cols();
  values.reserve(planes.size() * static_cast<std::size_t>(cols) *
                 static_cast<std::size_t>(row1 - row0));
  for (int r = row0; r < row1; ++r)
    for (int c = 0; c < cols; ++c)
      for (const Image& plane : planes) values.push_back(stored_value<T>(plane(r, c)));
  return values;
}

/// A part of one row, and the channels that it holds.
struct RowPart {
  int row, col0, cols;
  int first, channels;
};

/// sample(i): the part's i-th. Contract: it lies within the planes.
template <class Sample>
void take_interleaved(const RowPart& part, Planes& planes, const Sample& sample) {
  for (int k = 0; k < part.channels; ++k) {
    float* const to = &planes[part.first + k](part.row, part.col0);
    for (int c = 0; c < part.cols; ++c)
      to[c] = static_cast<float>(
          sample(static_cast<std::size_t>(c) * static_cast<std::size_t>(part.channels) +
                 static_cast<std::size_t>(k)));
  }
}

}  // namespace malus::internal
