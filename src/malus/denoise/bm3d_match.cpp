// Block matching of a tile: for each displacement the distances of all reference blocks at once.
//
// The squared differences of a whole tile are summed once per displacement and shared by all blocks
// that overlap. Blocks start at multiples of the step, so the picture is cut into cells of step x
// step; a block is a sum of whole cells and of the parts of cells at its far edges. The picture is
// stored with its columns sorted by column modulo step: one vector holds the same column of
// neighbouring cells, and no lane is wasted on positions where no block starts.
#include "malus/base/vector_targets.h"
#include "malus/denoise/internal/bm3d_stage.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/bm3d_match.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

#ifndef MALUS_BM3D_MATCH_ONCE
#define MALUS_BM3D_MATCH_ONCE
namespace malus::internal {

inline constexpr std::uint32_t kNoMatch = 0xFFFFFFFFu;

/// Plain pointers for the kernels.
struct MatchKernelJob {
  const std::int16_t* steps;  ///< [plane][row][column modulo step][cell]
  std::ptrdiff_t plane_stride, row_stride, phase_stride;
  int planes, step, range, first_cell, cell_rows;
  int ref_rows;
  bool clamp;  ///< differences may exceed 255 steps
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

/// Squared difference; without kClamp the caller has made sure that no difference exceeds 255.
template <bool kClamp>
HWY_INLINE hn::Vec<Distance> squared_difference(const std::int16_t* own,
                                                const std::int16_t* other) {
  const Step tag;
  auto d = hn::SaturatedSub(hn::LoadU(tag, own), hn::LoadU(tag, other));
  if constexpr (kClamp) d = hn::Max(hn::Min(d, hn::Set(tag, 255)), hn::Set(tag, -255));
  return hn::BitCast(Distance(), hn::Mul(d, d));
}

template <int kStep, bool kClamp>
HWY_INLINE void sum_cells(const MatchKernelJob& job, Displacement displacement, CellSums& sums) {
  constexpr int kPart = kPatch % kStep;
  const Distance distance;
  std::ptrdiff_t other_column[kStep];
  for (int x = 0; x < kStep; ++x) {
    const int column = x + displacement.col + kStep * job.first_cell;
    other_column[x] = displacement.row * job.row_stride + (column % kStep) * job.phase_stride +
                      column / kStep - job.first_cell;
  }
  const std::int16_t* cells = job.steps + job.first_cell + job.range * job.row_stride;
  for (int cell_row = 0; cell_row < job.cell_rows; ++cell_row, cells += kStep * job.row_stride)
    for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance))) {
      auto full = hn::Zero(distance), part_cols = full, part_rows = full, part_both = full;
      HWY_UNROLL(8)
      for (int y = 0; y < kStep; ++y) {
        auto row = hn::Zero(distance), row_part = row;
        for (int plane = 0; plane < job.planes; ++plane) {
          const std::int16_t* own = cells + cell + y * job.row_stride + plane * job.plane_stride;
          HWY_UNROLL(8)
          for (int x = 0; x < kStep; ++x) {
            const auto square =
                squared_difference<kClamp>(own + x * job.phase_stride, own + other_column[x]);
            row = hn::SaturatedAdd(row, square);
            if (x < kPart) row_part = hn::SaturatedAdd(row_part, square);
          }
        }
        full = hn::SaturatedAdd(full, row);
        part_cols = hn::SaturatedAdd(part_cols, row_part);
        if (y == kPart - 1) {
          part_rows = full;
          part_both = part_cols;
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

/// Sums along a cell row what a block covers of it: whole cells, then the part of the next one.
template <int kStep>
HWY_INLINE hn::Vec<Distance> along_row(const std::uint16_t* whole, const std::uint16_t* part) {
  constexpr int kWhole = kPatch / kStep, kPart = kPatch % kStep;
  const Distance distance;
  auto total = hn::LoadU(distance, whole);
  HWY_UNROLL(8)
  for (int x = 1; x < kWhole; ++x) total = hn::SaturatedAdd(total, hn::LoadU(distance, whole + x));
  if constexpr (kPart > 0) total = hn::SaturatedAdd(total, hn::LoadU(distance, part + kWhole));
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

/// Puts the blocks of one vector that are near enough into their lists.
template <int kGroup>
HWY_INLINE void collect(const MatchKernelJob& job, hn::Vec<Distance> found, int row, int cell,
                        int candidate) {
  const Distance distance;
  std::uint16_t* limit = job.limit + row * kCells + cell;
  const auto nearer = hn::Lt(found, hn::LoadU(distance, limit));
  if (HWY_LIKELY(hn::AllFalse(distance, nearer))) return;
  alignas(64) std::uint16_t value[kCells];
  hn::StoreU(found, distance, value);
  alignas(8) std::uint8_t bits[8] = {};
  hn::StoreMaskBits(distance, nearer, bits);
  std::uint64_t set = 0;
  std::memcpy(&set, bits, sizeof(set));
  std::uint32_t* lists =
      job.lists + (row * kCells + cell) * std::ptrdiff_t{job.list_stride} + kListLead;
  for (; set != 0; set &= set - 1) {
    const auto lane = static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(set));
    const std::uint32_t key = std::uint32_t{value[lane]} << 16 | static_cast<unsigned>(candidate);
    limit[lane] =
        insert_key<kGroup>(lists + lane * std::ptrdiff_t{job.list_stride}, key, limit[lane]);
  }
}

template <int kStep, int kGroup, bool kClamp>
void search(const MatchKernelJob& job) {
  constexpr int kWhole = kPatch / kStep;
  const Distance distance;
  CellSums sums;
  std::memset(&sums, 0, sizeof(sums));
  for (int candidate = 1; candidate < job.candidates; ++candidate) {
    sum_cells<kStep, kClamp>(job, job.order[candidate], sums);
    for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance))) {
      // The last kWhole cell rows, summed along the row: a block is their sum and the part below.
      hn::Vec<Distance> above[kWhole];
      for (auto& row : above) row = hn::Zero(distance);
      for (int cell_row = 0; cell_row < job.cell_rows; ++cell_row) {
        const auto whole =
            along_row<kStep>(sums.full[cell_row] + cell, sums.part_cols[cell_row] + cell);
        hn::Vec<Distance> found;
        if constexpr (kPatch % kStep > 0) {
          found =
              along_row<kStep>(sums.part_rows[cell_row] + cell, sums.part_both[cell_row] + cell);
          HWY_UNROLL(8)
          for (int i = 0; i < kWhole; ++i) found = hn::SaturatedAdd(found, above[i]);
        }
        HWY_UNROLL(8)
        for (int i = 0; i + 1 < kWhole; ++i) above[i] = above[i + 1];
        above[kWhole - 1] = whole;
        if constexpr (kPatch % kStep == 0) {
          found = above[0];
          HWY_UNROLL(8)
          for (int i = 1; i < kWhole; ++i) found = hn::SaturatedAdd(found, above[i]);
        }
        const int row = cell_row - (kPatch + kStep - 1) / kStep + 1;
        if (row >= 0) collect<kGroup>(job, found, row, cell, candidate);
      }
    }
  }
}

template <int kStep, int kGroup>
void search_group(const MatchKernelJob& job) {
  job.clamp ? search<kStep, kGroup, true>(job) : search<kStep, kGroup, false>(job);
}

template <int kStep>
void search_step(const MatchKernelJob& job) {
  switch (job.group) {
    case 8:
      return search_group<kStep, 8>(job);
    case 16:
      return search_group<kStep, 16>(job);
    default:
      return search_group<kStep, 32>(job);
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

/// Reads the lists of one tile.
void read_lists(const MatchKernelJob& job, const PaddedPlane& plane, const Bm3dStage& stage,
                const Tile& tile, std::span<BlockGroup> groups) {
  const std::ptrdiff_t stride = plane.stride();
  std::vector<std::int32_t> offset(static_cast<std::size_t>(job.candidates));
  for (std::size_t i = 0; i < offset.size(); ++i)
    offset[i] = static_cast<std::int32_t>(job.order[i].row * stride + job.order[i].col);
  for (int r = 0; r < tile.ref_rows; ++r)
    for (int c = 0; c < tile.ref_cols; ++c) {
      const std::uint32_t* list =
          job.lists + (r * kCells + c) * std::ptrdiff_t{job.list_stride} + kListLead;
      auto& group = groups[static_cast<std::size_t>(r * tile.ref_cols + c)];
      group.count = 1;
      while (group.count * 2 <= stage.group && list[group.count * 2 - 1] != kNoMatch)
        group.count *= 2;
      const auto origin = static_cast<std::int32_t>(
          (plane.pad + tile.row + r * stage.step) * stride + plane.pad + tile.col + c * stage.step);
      for (int i = 0; i < group.count; ++i)
        group.position[static_cast<std::size_t>(i)] = origin + offset[list[i] & 0xFFFF];
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
  const MatchSteps steps = quantise(input, stage, tile);
  MatchKernelJob job{};
  job.steps = steps.values.data();
  job.plane_stride = steps.plane_stride;
  job.row_stride = steps.row_stride;
  job.phase_stride = steps.phase_stride;
  job.clamp = steps.clamp;
  job.first_cell = steps.first_cell;
  job.cell_rows = steps.cell_rows;
  job.planes = static_cast<int>(input.planes.size());
  job.step = step;
  job.range = stage.range;
  job.ref_rows = tile.ref_rows;
  job.order = order.data();
  job.candidates = static_cast<int>(order.size());
  job.group = std::max(stage.group, 8);
  job.list_stride = kListLead + job.group;

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

  read_lists(job, *input.planes[0], stage, tile, groups);
}

}  // namespace malus::internal
#endif
