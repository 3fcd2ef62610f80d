// One row of a mosaic to and from the rows of its channels' packed planes.
#pragma once

#include <array>
#include <cstddef>

namespace malus::internal {

/// kStep channels take turns along the row: the cells of all known layouts, whose loops become
/// vector code.
template <std::size_t kStep>
void join_row(const float* const* planes, std::size_t cols, float* mosaic) {
  std::array<const float*, kStep> from;
  for (std::size_t k = 0; k < kStep; ++k) from[k] = planes[k];
  float* __restrict to = mosaic;
  for (std::size_t c = 0; c < cols; ++c)
    for (std::size_t k = 0; k < kStep; ++k) to[c * kStep + k] = from[k][c];
}

template <std::size_t kStep>
void split_row(const float* mosaic, std::size_t cols, float* const* planes) {
  for (std::size_t k = 0; k < kStep; ++k) {
    float* __restrict to = planes[k];
    for (std::size_t c = 0; c < cols; ++c) to[c] = mosaic[c * kStep + k];
  }
}

/// The same for any number of channels along the row.
inline void join_row(std::size_t step, const float* const* planes, std::size_t cols,
                     float* mosaic) {
  if (step == 1) return join_row<1>(planes, cols, mosaic);
  if (step == 2) return join_row<2>(planes, cols, mosaic);
  if (step == 4) return join_row<4>(planes, cols, mosaic);
  for (std::size_t k = 0; k < step; ++k)
    for (std::size_t c = 0; c < cols; ++c) mosaic[c * step + k] = planes[k][c];
}

inline void split_row(std::size_t step, const float* mosaic, std::size_t cols,
                      float* const* planes) {
  if (step == 1) return split_row<1>(mosaic, cols, planes);
  if (step == 2) return split_row<2>(mosaic, cols, planes);
  if (step == 4) return split_row<4>(mosaic, cols, planes);
  for (std::size_t k = 0; k < step; ++k)
    for (std::size_t c = 0; c < cols; ++c) planes[k][c] = mosaic[c * step + k];
}

}  // namespace malus::internal
