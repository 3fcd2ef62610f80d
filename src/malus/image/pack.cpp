#include "malus/image/pack.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {
namespace {

// Mosaic coordinate of a packed sample, moved back by whole cells (else clamped) where it falls
// outside.
int inside(int position, int size, int cell) {
  if (position < size) return position;
  return position - cell >= 0 ? position - cell : size - 1;
}

}  // namespace

int packed_size(int mosaic_size, int cell_size) {
  return (mosaic_size + cell_size - 1) / cell_size;
}

Planes pack(View<const float> mosaic, const SensorLayout& layout) {
  Planes planes(layout.channels(), packed_size(mosaic.rows(), layout.rows()),
                packed_size(mosaic.cols(), layout.cols()));
  if (mosaic.empty()) return planes;
  parallel_for(0, planes.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (int r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int k = 0; k < planes.channels(); ++k) {
        const int dr = k / layout.cols(), dc = k % layout.cols();
        const float* from =
            mosaic.row(inside(r * layout.rows() + dr, mosaic.rows(), layout.rows()));
        float* to = planes[k].row(r);
        const int whole =
            std::clamp((mosaic.cols() - dc + layout.cols() - 1) / layout.cols(), 0, planes.cols());
        for (int c = 0; c < whole; ++c) to[c] = from[c * layout.cols() + dc];
        for (int c = whole; c < planes.cols(); ++c)
          to[c] = from[inside(c * layout.cols() + dc, mosaic.cols(), layout.cols())];
      }
  });
  return planes;
}

void unpack(const Planes& planes, const SensorLayout& layout, View<float> mosaic) {
  MALUS_REQUIRE(planes.channels() == layout.channels());
  MALUS_REQUIRE(planes.rows() == packed_size(mosaic.rows(), layout.rows()) &&
                planes.cols() == packed_size(mosaic.cols(), layout.cols()));
  parallel_for(0, mosaic.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (int r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      float* to = mosaic.row(r);
      for (int dc = 0; dc < layout.cols(); ++dc) {
        const float* from = planes[layout.channel_at(r, dc)].row(r / layout.rows());
        for (int c = dc; c < mosaic.cols(); c += layout.cols()) to[c] = from[c / layout.cols()];
      }
    }
  });
}

void require_whole_cell(View<const float> mosaic, const SensorLayout& layout,
                        const std::string& source) {
  if (mosaic.rows() >= layout.rows() && mosaic.cols() >= layout.cols()) return;
  throw InputError(
      source,
      fmt::format("of {} x {} pixels is smaller than one cell of {} ({} x {})", mosaic.cols(),
                  mosaic.rows(), layout.name(), layout.cols(), layout.rows()),
      "give a larger frame, or declare its layout");
}

}  // namespace malus
