#include "malus/image/pack.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"

#include <algorithm>
#include <map>

#include <fmt/format.h>

namespace malus {
namespace {

// Mosaic coordinate of a packed sample, moved by a whole cell (else clamped) where it falls
// outside.
int inside(int position, int size, int cell) {
  if (position < 0) position += cell;
  if (position < size) return position;
  return position - cell >= 0 ? position - cell : size - 1;
}

void pack_row(View<const float> mosaic, const SensorLayout& layout, CellPhase phase, int channel,
              int r, Image& plane) {
  const int cell_rows = layout.rows(), cell_cols = layout.cols();
  const int row = r * cell_rows + channel / cell_cols - phase.row;
  const int col = channel % cell_cols - phase.col;  // of the plane's first sample
  const float* from = mosaic.row(inside(row, mosaic.rows(), cell_rows));
  float* to = plane.row(r);
  const int begin = col < 0 ? 1 : 0;
  const int end =
      std::clamp((mosaic.cols() - col + cell_cols - 1) / cell_cols, begin, plane.cols());
  for (int c = begin; c < end; ++c) to[c] = from[c * cell_cols + col];
  if (begin > 0) to[0] = from[inside(col, mosaic.cols(), cell_cols)];
  for (int c = end; c < plane.cols(); ++c)
    to[c] = from[inside(c * cell_cols + col, mosaic.cols(), cell_cols)];
}

}  // namespace

int packed_size(int mosaic_size, int cell_size) {
  return (mosaic_size + cell_size - 1) / cell_size;
}

Planes pack(View<const float> mosaic, const SensorLayout& layout, CellPhase phase) {
  const int cell_rows = layout.rows(), cell_cols = layout.cols();
  Planes planes(layout.channels(), packed_size(phase.row + mosaic.rows(), cell_rows),
                packed_size(phase.col + mosaic.cols(), cell_cols));
  if (mosaic.empty()) return planes;
  parallel_for(0, planes.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (int r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int k = 0; k < planes.channels(); ++k) pack_row(mosaic, layout, phase, k, r, planes[k]);
  });
  return planes;
}

Image pack_channel(View<const float> mosaic, const SensorLayout& layout, int channel) {
  Image plane(packed_size(mosaic.rows(), layout.rows()), packed_size(mosaic.cols(), layout.cols()));
  if (mosaic.empty()) return plane;
  for (int r = 0; r < plane.rows(); ++r) pack_row(mosaic, layout, {}, channel, r, plane);
  return plane;
}

void unpack(const Planes& planes, const SensorLayout& layout, View<float> mosaic, CellPhase phase) {
  const int cell_rows = layout.rows(), cell_cols = layout.cols();
  MALUS_REQUIRE(planes.channels() == layout.channels());
  MALUS_REQUIRE(planes.rows() == packed_size(phase.row + mosaic.rows(), cell_rows) &&
                planes.cols() == packed_size(phase.col + mosaic.cols(), cell_cols));
  parallel_for(0, mosaic.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (int r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      float* to = mosaic.row(r);
      for (int dc = 0; dc < cell_cols; ++dc) {
        const int row = r + phase.row, col = dc + phase.col;
        const float* from =
            planes[layout.channel_at(row, col)].row(row / cell_rows) + col / cell_cols;
        for (int c = dc; c < mosaic.cols(); c += cell_cols) to[c] = from[c / cell_cols];
      }
    }
  });
}

std::vector<std::string> plane_names(const SensorLayout& layout) {
  std::map<std::string, int> met;
  std::vector<std::string> names;
  for (const std::string& name : layout.channel_names()) {
    const int times = ++met[name];
    names.push_back(times == 1 ? name : fmt::format("{}_{}", name, times));
  }
  return names;
}

void require_whole_cell(View<const float> mosaic, const SensorLayout& layout,
                        const std::string& source) {
  if (mosaic.rows() >= layout.rows() && mosaic.cols() >= layout.cols()) return;
  throw InputError(
      source,
      fmt::format("{} x {} pixels, smaller than one cell of {} ({} x {})", mosaic.cols(),
                  mosaic.rows(), layout.name(), layout.cols(), layout.rows()),
      "give a larger frame, or declare its layout");
}

}  // namespace malus
