// Block matching of a tile: for each displacement the distances of all reference blocks at once.
//
// The squared differences of a whole tile are summed once per displacement and shared by all blocks
// that overlap. Blocks start at multiples of the step, so the picture is cut into cells of step x
// step; a block is a sum of whole cells and of the parts of cells at its far edges. The picture is
// stored with its columns sorted by column modulo step: one vector holds the same column of
// neighbouring cells, and no lane is wasted on positions where no block starts.
#include "malus/denoise/internal/bm3d_stage.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/bm3d_match.cpp"
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3_DL)
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

#ifndef MALUS_BM3D_MATCH_ONCE
#define MALUS_BM3D_MATCH_ONCE
namespace malus::internal {

inline constexpr int kCells = 32;  ///< cells along a tile's side, those at the far edge included
inline constexpr std::uint32_t kNoMatch = 0xFFFFFFFFu;

/// Plain pointers for the kernels.
struct MatchKernelJob {
  const std::int16_t* steps;  ///< [plane][row][column modulo step][cell]
  std::ptrdiff_t plane_stride, row_stride, phase_stride;
  int planes, step, range, first_cell, cell_rows;
  int ref_rows, ref_cols;
  const Displacement* order;
  int candidates;
  std::uint16_t* limit;  ///< [ref row][kCells]: only smaller distances can enter the list
  std::uint32_t* lists;  ///< [ref row][kCells][list_stride], sorted keys from kListLead on
  int group, list_stride;
};

/// A key is distance << 16 | position in the search order; before the first key lies room for
/// a sentinel, so that the list shifted by one can be loaded.
inline constexpr int kListLead = 16;

}  // namespace malus::internal
#endif

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Distance = hn::CappedTag<std::uint16_t, kCells>;
using Step = hn::CappedTag<std::int16_t, kCells>;

/// Sums over whole cells (full), over their first columns (part_cols), first rows (part_rows), both
/// (part_both): [cell row][cell], with a cell row's tail staying zero.
struct CellSums {
  static constexpr int kStride = kCells + 16;
  alignas(64) std::uint16_t full[kCells + 8][kStride];
  alignas(64) std::uint16_t part_cols[kCells + 8][kStride];
  alignas(64) std::uint16_t part_rows[kCells + 8][kStride];
  alignas(64) std::uint16_t part_both[kCells + 8][kStride];
};

template <int kStep>
HWY_INLINE void sum_cells(const MatchKernelJob& job, Displacement displacement, CellSums& sums) {
  constexpr int kPart = kPatch % kStep;
  const Distance distance;
  const Step signed_steps;
  const auto largest = hn::Set(signed_steps, 255), smallest = hn::Set(signed_steps, -255);
  for (int cell_row = 0; cell_row < job.cell_rows; ++cell_row) {
    for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance))) {
      auto full = hn::Zero(distance), part_cols = full, part_rows = full, part_both = full;
      for (int plane = 0; plane < job.planes; ++plane) {
        const std::int16_t* own = job.steps + plane * job.plane_stride + job.first_cell + cell +
                                  (cell_row * kStep + job.range) * job.row_stride;
        const std::int16_t* other = own + displacement.row * job.row_stride;
        HWY_UNROLL(8)
        for (int y = 0; y < kStep; ++y) {
          HWY_UNROLL(8)
          for (int x = 0; x < kStep; ++x) {
            const int column = x + displacement.col + kStep * job.first_cell;
            const auto a = hn::LoadU(signed_steps, own + y * job.row_stride + x * job.phase_stride);
            const auto b = hn::LoadU(signed_steps, other + y * job.row_stride +
                                                       (column % kStep) * job.phase_stride +
                                                       column / kStep - job.first_cell);
            const auto d = hn::Max(hn::Min(hn::SaturatedSub(a, b), largest), smallest);
            const auto square = hn::BitCast(distance, hn::Mul(d, d));
            full = hn::SaturatedAdd(full, square);
            if (x < kPart) part_cols = hn::SaturatedAdd(part_cols, square);
            if (y < kPart) part_rows = hn::SaturatedAdd(part_rows, square);
            if (x < kPart && y < kPart) part_both = hn::SaturatedAdd(part_both, square);
          }
        }
      }
      hn::StoreU(full, distance, sums.full[cell_row] + cell);
      if constexpr (kPart > 0) {
        hn::StoreU(part_cols, distance, sums.part_cols[cell_row] + cell);
        hn::StoreU(part_rows, distance, sums.part_rows[cell_row] + cell);
        hn::StoreU(part_both, distance, sums.part_both[cell_row] + cell);
      }
    }
  }
}

/// Distance of the blocks that start in cells [cell, cell + lanes) of a cell row.
template <int kStep>
HWY_INLINE hn::Vec<Distance> block_distance(const CellSums& sums, int cell_row, int cell) {
  constexpr int kWhole = kPatch / kStep, kPart = kPatch % kStep;
  const Distance distance;
  auto total = hn::Zero(distance);
  HWY_UNROLL(8)
  for (int y = 0; y < kWhole; ++y) {
    HWY_UNROLL(8)
    for (int x = 0; x < kWhole; ++x)
      total = hn::SaturatedAdd(total, hn::LoadU(distance, sums.full[cell_row + y] + cell + x));
    if constexpr (kPart > 0)
      total = hn::SaturatedAdd(total,
                               hn::LoadU(distance, sums.part_cols[cell_row + y] + cell + kWhole));
  }
  if constexpr (kPart > 0) {
    HWY_UNROLL(8)
    for (int x = 0; x < kWhole; ++x)
      total = hn::SaturatedAdd(total,
                               hn::LoadU(distance, sums.part_rows[cell_row + kWhole] + cell + x));
    total = hn::SaturatedAdd(
        total, hn::LoadU(distance, sums.part_both[cell_row + kWhole] + cell + kWhole));
  }
  return total;
}

/// Puts key into the sorted list, whose last key falls out; returns the new last distance.
template <int kGroup>
HWY_INLINE std::uint16_t insert_key(std::uint32_t* list, std::uint32_t key, std::uint16_t limit) {
  const hn::CappedTag<std::uint32_t, kGroup> tag;
  constexpr int kLanes = static_cast<int>(hn::MaxLanes(tag));
  const auto incoming = hn::Set(tag, key);
  for (int i = kGroup - kLanes; i >= 0; i -= kLanes) {
    const auto here = hn::LoadU(tag, list + i), before = hn::LoadU(tag, list + i - 1);
    hn::StoreU(hn::Max(before, hn::Min(here, incoming)), tag, list + i);
  }
  const auto last = static_cast<std::uint16_t>(list[kGroup - 1] >> 16);
  return last < limit ? last : limit;
}

template <int kStep, int kGroup>
void search(const MatchKernelJob& job) {
  const Distance distance;
  CellSums sums;
  std::memset(&sums, 0, sizeof(sums));
  for (int candidate = 1; candidate < job.candidates; ++candidate) {
    sum_cells<kStep>(job, job.order[candidate], sums);
    for (int row = 0; row < job.ref_rows; ++row) {
      std::uint16_t* limit = job.limit + row * kCells;
      for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance))) {
        const auto found = block_distance<kStep>(sums, row, cell);
        const auto nearer = hn::Lt(found, hn::LoadU(distance, limit + cell));
        if (HWY_LIKELY(hn::AllFalse(distance, nearer))) continue;
        alignas(64) std::uint16_t value[kCells];
        hn::StoreU(found, distance, value);
        alignas(8) std::uint8_t bits[8] = {};
        hn::StoreMaskBits(distance, nearer, bits);
        std::uint64_t set = 0;
        std::memcpy(&set, bits, sizeof(set));
        for (; set != 0; set &= set - 1) {
          const int lane = static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(set));
          const int at = cell + lane;
          std::uint32_t* list =
              job.lists + (row * kCells + at) * std::ptrdiff_t{job.list_stride} + kListLead;
          limit[at] = insert_key<kGroup>(
              list, std::uint32_t{value[lane]} << 16 | static_cast<std::uint32_t>(candidate),
              limit[at]);
        }
      }
    }
  }
}

template <int kStep>
void search_step(const MatchKernelJob& job) {
  switch (job.group) {
    case 8:
      return search<kStep, 8>(job);
    case 16:
      return search<kStep, 16>(job);
    default:
      return search<kStep, 32>(job);
  }
}

void search_tile(const MatchKernelJob& job) {
  switch (job.step) {
    case 1:
      return search_step<1>(job);
    case 2:
      return search_step<2>(job);
    case 3:
      return search_step<3>(job);
    case 4:
      return search_step<4>(job);
    case 5:
      return search_step<5>(job);
    case 6:
      return search_step<6>(job);
    case 7:
      return search_step<7>(job);
    default:
      return search_step<8>(job);
  }
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(search_tile);

namespace {

/// Writes value * scale of the tile and its surroundings, columns sorted by column modulo step,
/// relative to the tile's first reference pixel.
void quantise(const MatchInput& input, const Tile& tile, MatchKernelJob& job, int rows, int cells,
              std::int16_t* steps) {
  for (int p = 0; p < job.planes; ++p) {
    const auto& plane = *input.planes[static_cast<std::size_t>(p)];
    const float scale = input.scale[static_cast<std::size_t>(p)];
    const auto origin = plane.data.view();
    const int row0 = plane.pad + tile.row - job.range;
    const int col0 = plane.pad + tile.col - job.first_cell * job.step;
    const float base = std::nearbyint(scale * origin(plane.pad + tile.row, plane.pad + tile.col));
    for (int r = 0; r < rows; ++r) {
      const int row = std::min(row0 + r, plane.data.rows() - 1);
      const float* source = origin.row(row);
      for (int phase = 0; phase < job.step; ++phase) {
        std::int16_t* out =
            steps + p * job.plane_stride + r * job.row_stride + phase * job.phase_stride;
        for (int cell = 0; cell < cells; ++cell) {
          const int col = std::clamp(col0 + cell * job.step + phase, 0, plane.data.cols() - 1);
          const float value = std::nearbyint(scale * source[col]) - base;
          out[cell] = static_cast<std::int16_t>(std::clamp(value, -32767.0F, 32767.0F));
        }
      }
    }
  }
}

}  // namespace

std::vector<Displacement> search_order(int range) {
  std::vector<Displacement> order;
  for (int row = -range; row <= range; ++row)
    for (int col = -range; col <= range; ++col) order.push_back({row, col});
  std::stable_sort(order.begin(), order.end(), [](const Displacement& a, const Displacement& b) {
    return a.row * a.row + a.col * a.col < b.row * b.row + b.col * b.col;
  });
  return order;
}

void match_tile(const MatchInput& input, const Bm3dStage& stage,
                std::span<const Displacement> order, const Tile& tile,
                std::span<BlockGroup> groups) {
  const int step = stage.step;
  MatchKernelJob job{};
  job.planes = static_cast<int>(input.planes.size());
  job.step = step;
  job.range = stage.range;
  job.first_cell = (stage.range + step - 1) / step;
  job.cell_rows = tile.ref_rows + (kPatch + step - 1) / step - 1;
  const int cells = kCells + 2 * job.first_cell + 1, rows = job.cell_rows * step + 2 * stage.range;
  job.phase_stride = (cells + 31) / 32 * 32;
  job.row_stride = job.phase_stride * step;
  job.plane_stride = job.row_stride * rows;
  job.ref_rows = tile.ref_rows;
  job.ref_cols = tile.ref_cols;
  job.order = order.data();
  job.candidates = static_cast<int>(order.size());
  job.group = std::max(stage.group, 8);
  job.list_stride = kListLead + job.group;

  const auto steps =
      hwy::AllocateAligned<std::int16_t>(static_cast<std::size_t>(job.plane_stride * job.planes));
  quantise(input, tile, job, rows, cells, steps.get());
  job.steps = steps.get();

  const std::size_t lists = static_cast<std::size_t>(tile.ref_rows) * kCells;
  const auto limit = hwy::AllocateAligned<std::uint16_t>(lists);
  const auto keys =
      hwy::AllocateAligned<std::uint32_t>(lists * static_cast<std::size_t>(job.list_stride));
  for (std::size_t i = 0; i < lists; ++i) {
    limit[i] = static_cast<int>(i % kCells) < tile.ref_cols ? kMatchFullScale : 0;
    std::uint32_t* list = keys.get() + i * static_cast<std::size_t>(job.list_stride);
    std::fill(list, list + kListLead + 1, 0U);
    std::fill(list + kListLead + 1, list + job.list_stride, kNoMatch);
  }
  job.limit = limit.get();
  job.lists = keys.get();
  HWY_DYNAMIC_DISPATCH(search_tile)(job);

  const auto& plane = *input.planes[0];
  const std::ptrdiff_t stride = plane.stride();
  for (int r = 0; r < tile.ref_rows; ++r)
    for (int c = 0; c < tile.ref_cols; ++c) {
      const std::uint32_t* list =
          keys.get() + (r * kCells + c) * std::ptrdiff_t{job.list_stride} + kListLead;
      auto& group = groups[static_cast<std::size_t>(r * tile.ref_cols + c)];
      int found = 1;
      while (found < stage.group && list[found] != kNoMatch) ++found;
      group.count = 1;
      while (group.count * 2 <= found) group.count *= 2;
      const std::ptrdiff_t origin =
          (plane.pad + tile.row + r * step) * stride + plane.pad + tile.col + c * step;
      for (int i = 0; i < group.count; ++i) {
        const auto& d = order[list[i] & 0xFFFF];
        group.position[static_cast<std::size_t>(i)] =
            static_cast<std::int32_t>(origin + d.row * stride + d.col);
      }
    }
}

}  // namespace malus::internal
#endif
