// The integers that block matching compares.
#include "malus/denoise/internal/bm3d_stage.h"

#include <algorithm>
#include <utility>

namespace malus::internal {
namespace {

constexpr float kMaxStep = 32000;         ///< values further from the tile's first are cut there
constexpr std::int16_t kOutside = 32767;  ///< more than 255 from all of them
/// Where values span no more than this, no difference needs a limit of 255, and a step of 255 from
/// the smallest still leaves any block outside too far away.
constexpr int kUnclampedSpan = 180;
static_assert(kPatch * (255 - kUnclampedSpan) * (255 - kUnclampedSpan) > kMatchFullScale);

/// Where the surroundings of a tile lie in the padded picture, and where blocks may lie.
struct Extent {
  int row, col, rows, cols;                    ///< surroundings
  int first_row, first_col, end_row, end_col;  ///< blocks, relative to the surroundings
};

/// Nearest integer by the rounding of the addition; a function of x alone, whatever its size.
inline float rounded(float x) {
  constexpr float kMagic = 0x1.8p23F;
  return (x + kMagic) - kMagic;
}

/// Fills one plane inside the bounds, relative to the tile's first reference pixel; returns the
/// smallest and largest step.
std::pair<int, int> quantise_plane(const PaddedPlane& plane, float scale, float first,
                                   const Extent& extent, int step, const MatchSteps& layout,
                                   std::int16_t* out) {
  const float base = rounded(scale * first);
  std::vector<std::int16_t> line(static_cast<std::size_t>(extent.cols));
  std::int16_t smallest = 0, largest = 0;
  for (int r = extent.first_row; r < extent.end_row; ++r) {
    const float* source = plane.data.row(extent.row + r) + extent.col;
    for (int c = extent.first_col; c < extent.end_col; ++c) {
      const float value = rounded(scale * source[c]) - base;
      line[static_cast<std::size_t>(c)] =
          static_cast<std::int16_t>(std::max(std::min(value, kMaxStep), -kMaxStep));
    }
    for (int c = extent.first_col; c < extent.end_col;
         ++c) {  // a loop of its own becomes whole vectors
      smallest = std::min(smallest, line[static_cast<std::size_t>(c)]);
      largest = std::max(largest, line[static_cast<std::size_t>(c)]);
    }
    for (int phase = 0; phase < step; ++phase) {
      std::int16_t* cells = out + r * layout.row_stride + phase * layout.phase_stride;
      for (int c = phase; c < extent.cols; c += step) *cells++ = line[static_cast<std::size_t>(c)];
    }
  }
  return {smallest, largest};
}

/// Writes value everywhere outside the bounds.
void fill_outside(const Extent& extent, int step, const MatchSteps& layout, std::int16_t value,
                  std::int16_t* out) {
  for (int r = 0; r < extent.rows; ++r) {
    std::int16_t* row = out + r * layout.row_stride;
    if (r < extent.first_row || r >= extent.end_row) {
      std::fill_n(row, layout.row_stride, value);
      continue;
    }
    for (int phase = 0; phase < step; ++phase, row += layout.phase_stride) {
      const auto cells_before = [&](int col) {
        return (std::max(col - phase, 0) + step - 1) / step;
      };
      const int all = cells_before(extent.cols);
      const int first = std::min(cells_before(extent.first_col), all);
      std::fill_n(row, first, value);
      const int end = std::clamp(cells_before(extent.end_col), first, all);
      std::fill(row + end, row + all, value);
    }
  }
}

Extent extent_of(const PaddedPlane& plane, const Bm3dStage& stage, const Tile& tile,
                 const MatchSteps& layout) {
  Extent e{};
  e.row = plane.pad + tile.row - stage.range;
  e.col = plane.pad + tile.col - layout.first_cell * stage.step;
  e.rows = layout.cell_rows * stage.step + 2 * stage.range;
  e.cols = (kCells + 2 * layout.first_cell + 1) * stage.step;
  const auto end = [&](int padded) {
    return plane.pad + (lattice_size(padded - 2 * plane.pad, stage.step) - 1) * stage.step + kPatch;
  };
  e.first_row = std::max(plane.pad - e.row, 0);
  e.first_col = std::max(plane.pad - e.col, 0);
  e.end_row = std::min(end(plane.data.rows()) - e.row, e.rows);
  e.end_col = std::min(end(plane.data.cols()) - e.col, e.cols);
  return e;
}

}  // namespace

MatchSteps quantise(const MatchInput& input, const Bm3dStage& stage, const Tile& tile) {
  MatchSteps steps{};
  steps.first_cell = (stage.range + stage.step - 1) / stage.step;
  steps.cell_rows = tile.ref_rows + (kPatch + stage.step - 1) / stage.step - 1;
  const Extent extent = extent_of(*input.planes[0], stage, tile, steps);
  constexpr int kVector = 32;  // cells in the widest
  steps.phase_stride = (extent.cols / stage.step + kVector - 1) / kVector * kVector;
  steps.row_stride = steps.phase_stride * stage.step;
  steps.plane_stride = steps.row_stride * extent.rows;
  const std::size_t size = input.planes.size() * static_cast<std::size_t>(steps.plane_stride);
  steps.values.resize(size + 2 * kVector);
  const auto tile_cell = reinterpret_cast<std::uintptr_t>(steps.values.data() + steps.first_cell);
  steps.offset = (kVector - tile_cell / sizeof(std::int16_t) % kVector) % kVector;

  const auto out = [&](std::size_t plane) {
    return steps.values.data() + steps.offset + std::ptrdiff_t(plane) * steps.plane_stride;
  };
  std::vector<int> smallest;
  for (std::size_t p = 0; p < input.planes.size(); ++p) {
    const auto& plane = *input.planes[p];
    const float first = plane.data(plane.pad + tile.row, plane.pad + tile.col);
    const auto [low, high] =
        quantise_plane(plane, input.scale[p], first, extent, stage.step, steps, out(p));
    smallest.push_back(low);
    steps.clamp |= high - low > kUnclampedSpan;
  }
  for (std::size_t p = 0; p < input.planes.size(); ++p)
    fill_outside(extent, stage.step, steps,
                 steps.clamp ? kOutside : static_cast<std::int16_t>(smallest[p] + 255), out(p));
  return steps;
}

}  // namespace malus::internal
