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

/// A key is distance << 16 | position in the search order.
inline constexpr std::uint32_t kNoMatch = 0xFFFFFFFFu;

/// Plain pointers for the kernels.
struct MatchKernelJob {
  const std::int16_t* steps;  ///< the tile's first cell
  std::ptrdiff_t plane_stride, row_stride, phase_stride;
  int planes, step, range, first_cell, cell_rows;
  int ref_rows;
  bool clamp;  ///< differences may exceed 255 steps
  const Displacement* order;
  int candidates;
  std::uint16_t* limit;  ///< [ref row][kCells]: only smaller distances can enter the list
  std::uint32_t* lists;  ///< [ref row][kCells][group], sorted; see kNoMatch
  int group;
};

}  // namespace malus::internal
#endif

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Distance = hn::CappedTag<std::uint16_t, kCells>;
using Step = hn::CappedTag<std::int16_t, kCells>;

/// Sums over the rows of a block, of a cell's columns (whole) and of its first ones (part):
/// [row of blocks][cell], with a row's tail staying zero.
struct CellSums {
  static constexpr int kStride = 2 * kCells;
  alignas(64) std::uint16_t whole[kCells][kStride];
  alignas(64) std::uint16_t part[kCells][kStride];
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

/// Squared differences of a row of cells: of all their columns, and of the first kPatch % kStep.
struct RowOfCells {
  hn::Vec<Distance> whole, part;
};

template <int kStep, bool kClamp>
HWY_INLINE RowOfCells row_of_cells(const std::int16_t* own, std::ptrdiff_t phase_stride,
                                   const std::ptrdiff_t (&other_column)[kStep]) {
  constexpr int kPart = kPatch % kStep;
  RowOfCells row{};
  HWY_UNROLL(8)
  for (int x = 0; x < kStep; ++x) {
    const auto square = squared_difference<kClamp>(own + x * phase_stride, own + other_column[x]);
    row.whole = x == 0 ? square : hn::SaturatedAdd(row.whole, square);
    if (x == kPart - 1) row.part = row.whole;
  }
  return row;
}

template <int kCount>
HWY_INLINE hn::Vec<Distance> sum_of(const hn::Vec<Distance> (&rows)[kCount]) {
  auto total = rows[0];
  HWY_UNROLL(8)
  for (int i = 1; i < kCount; ++i) total = hn::SaturatedAdd(total, rows[i]);
  return total;
}

/// Sums of all blocks' rows at one displacement.
template <int kStep, bool kClamp>
HWY_INLINE void sum_cells(const MatchKernelJob& job, Displacement displacement, CellSums& sums) {
  constexpr int kPart = kPatch % kStep, kCellsDown = (kPatch + kStep - 1) / kStep;
  const Distance distance;
  std::ptrdiff_t other_column[kStep];
  for (int x = 0; x < kStep; ++x) {
    const int column = x + displacement.col + kStep * job.first_cell;
    other_column[x] = displacement.row * job.row_stride + (column % kStep) * job.phase_stride +
                      column / kStep - job.first_cell;
  }
  for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance))) {
    // The rows of cells that a block covers, the last of them (of which a part may count) below.
    hn::Vec<Distance> rows[kCellsDown], part_rows[kCellsDown];
    for (int i = 0; i < kCellsDown; ++i) rows[i] = part_rows[i] = hn::Zero(distance);
    const std::int16_t* own = job.steps + cell + job.range * job.row_stride;
    for (int cell_row = 0; cell_row < job.cell_rows; ++cell_row) {
      auto whole = hn::Zero(distance), part = whole;
      HWY_UNROLL(8)
      for (int y = 0; y < kStep; ++y, own += job.row_stride) {
        RowOfCells row = row_of_cells<kStep, kClamp>(own, job.phase_stride, other_column);
        for (int plane = 1; plane < job.planes; ++plane) {
          const auto more = row_of_cells<kStep, kClamp>(own + plane * job.plane_stride,
                                                        job.phase_stride, other_column);
          row.whole = hn::SaturatedAdd(row.whole, more.whole);
          if constexpr (kPart > 0) row.part = hn::SaturatedAdd(row.part, more.part);
        }
        whole = y == 0 ? row.whole : hn::SaturatedAdd(whole, row.whole);
        if constexpr (kPart > 0) part = y == 0 ? row.part : hn::SaturatedAdd(part, row.part);
        if (y == (kPart + kStep - 1) % kStep) {
          rows[kCellsDown - 1] = whole;
          part_rows[kCellsDown - 1] = part;
        }
      }
      const int block_row = cell_row - kCellsDown + 1;
      if (block_row >= 0) {
        hn::Store(sum_of(rows), distance, sums.whole[block_row] + cell);
        if constexpr (kPart > 0)
          hn::Store(sum_of(part_rows), distance, sums.part[block_row] + cell);
      }
      rows[kCellsDown - 1] = whole;
      part_rows[kCellsDown - 1] = part;
      HWY_UNROLL(8)
      for (int i = 0; i + 1 < kCellsDown; ++i) {
        rows[i] = rows[i + 1];
        part_rows[i] = part_rows[i + 1];
      }
    }
  }
}

/// Sums along a row what blocks cover of it: whole cells, then the part of the next one.
template <int kStep>
HWY_INLINE hn::Vec<Distance> along_row(const std::uint16_t* whole, const std::uint16_t* part) {
  constexpr int kWhole = kPatch / kStep, kPart = kPatch % kStep;
  const Distance distance;
  auto total = hn::Load(distance, whole);
  HWY_UNROLL(8)
  for (int x = 1; x < kWhole; ++x) total = hn::SaturatedAdd(total, hn::LoadU(distance, whole + x));
  if constexpr (kPart > 0) total = hn::SaturatedAdd(total, hn::LoadU(distance, part + kWhole));
  return total;
}

using Keys4 = std::uint32_t __attribute__((vector_size(16)));
using Keys8 = std::uint32_t __attribute__((vector_size(32)));
using Keys16 = std::uint32_t __attribute__((vector_size(64)));

/// here, moved up by one lane; before's last lane comes in.
template <class Vector>
HWY_INLINE Vector moved_up(Vector before, Vector here) {
  using Raw = decltype(here.raw);
  if constexpr (sizeof(Vector) == sizeof(Keys16)) {
    return Vector{__builtin_bit_cast(
        Raw, __builtin_shufflevector(__builtin_bit_cast(Keys16, before.raw),
                                     __builtin_bit_cast(Keys16, here.raw), 15, 16, 17, 18, 19, 20,
                                     21, 22, 23, 24, 25, 26, 27, 28, 29, 30))};
  } else if constexpr (sizeof(Vector) == sizeof(Keys8)) {
    return Vector{__builtin_bit_cast(
        Raw,
        __builtin_shufflevector(__builtin_bit_cast(Keys8, before.raw),
                                __builtin_bit_cast(Keys8, here.raw), 7, 8, 9, 10, 11, 12, 13, 14))};
  } else if constexpr (sizeof(Vector) == sizeof(Keys4)) {
    return Vector{__builtin_bit_cast(
        Raw, __builtin_shufflevector(__builtin_bit_cast(Keys4, before.raw),
                                     __builtin_bit_cast(Keys4, here.raw), 3, 4, 5, 6))};
  } else {
    return before;  // one lane
  }
}

/// Puts key into the sorted list, whose last key falls out; returns the new last distance.
template <int kGroup>
HWY_INLINE std::uint16_t insert_key(std::uint32_t* list, std::uint32_t key, std::uint16_t limit) {
  const hn::CappedTag<std::uint32_t, kGroup> tag;
  constexpr int kLanes = static_cast<int>(hn::MaxLanes(tag));
  const auto incoming = hn::Set(tag, key);
  HWY_UNROLL(4)
  for (int i = kGroup - kLanes; i >= 0; i -= kLanes) {
    const auto here = hn::Load(tag, list + i);
    const auto before = i > 0 ? hn::Load(tag, list + i - kLanes) : hn::Zero(tag);
    hn::Store(hn::Max(moved_up(before, here), hn::Min(here, incoming)), tag, list + i);
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
  std::uint32_t* lists = job.lists + (row * kCells + cell) * std::ptrdiff_t{kGroup};
  for (; set != 0; set &= set - 1) {
    const auto lane = static_cast<int>(hwy::Num0BitsBelowLS1Bit_Nonzero64(set));
    const std::uint32_t key = std::uint32_t{value[lane]} << 16 | static_cast<unsigned>(candidate);
    limit[lane] = insert_key<kGroup>(lists + lane * std::ptrdiff_t{kGroup}, key, limit[lane]);
  }
}

template <int kStep, int kGroup, bool kClamp>
void search(const MatchKernelJob& job) {
  const Distance distance;
  CellSums sums;
  std::memset(&sums, 0, sizeof(sums));
  for (int candidate = 1; candidate < job.candidates; ++candidate) {
    sum_cells<kStep, kClamp>(job, job.order[candidate], sums);
    for (int row = 0; row < job.ref_rows; ++row)
      for (int cell = 0; cell < kCells; cell += static_cast<int>(hn::Lanes(distance)))
        collect<kGroup>(job, along_row<kStep>(sums.whole[row] + cell, sums.part[row] + cell), row,
                        cell, candidate);
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
void read_lists(const MatchKernelJob& job, const Bm3dStage& stage, const Tile& tile, int pad,
                const TileRegion& region, std::span<BlockGroup> groups) {
  for (int r = 0; r < tile.ref_rows; ++r)
    for (int c = 0; c < tile.ref_cols; ++c) {
      const std::uint32_t* list = job.lists + (r * kCells + c) * std::ptrdiff_t{job.group};
      auto& group = groups[static_cast<std::size_t>(r * tile.ref_cols + c)];
      group.count = 1;
      while (group.count * 2 <= stage.group && list[group.count * 2 - 1] != kNoMatch)
        group.count *= 2;
      const int row = pad + tile.row + r * stage.step - region.row;
      const int col = pad + tile.col + c * stage.step - region.col;
      for (int i = 0; i < group.count; ++i) {
        const Displacement found = job.order[list[i] & 0xFFFF];
        group.place[static_cast<std::size_t>(i)] = region.place(row + found.row, col + found.col);
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
                std::span<const Displacement> order, const Tile& tile, const TileRegion& region,
                std::span<BlockGroup> groups) {
  const int step = stage.step;
  const MatchSteps steps = quantise(input, stage, tile);
  MatchKernelJob job{};
  job.steps = steps.first() + steps.first_cell;
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

  const std::size_t lists = static_cast<std::size_t>(tile.ref_rows) * kCells;
  const auto limit = hwy::AllocateAligned<std::uint16_t>(lists);
  const auto keys =
      hwy::AllocateAligned<std::uint32_t>(lists * static_cast<std::size_t>(job.group));
  for (std::size_t i = 0; i < lists; ++i) {
    limit[i] = static_cast<int>(i % kCells) < tile.ref_cols ? kMatchFullScale : 0;
    std::uint32_t* list = keys.get() + i * static_cast<std::size_t>(job.group);
    list[0] = 0;  // the reference block itself
    std::fill(list + 1, list + job.group, kNoMatch);
  }
  job.limit = limit.get();
  job.lists = keys.get();
  HWY_DYNAMIC_DISPATCH(search_tile)(job);

  read_lists(job, stage, tile, input.planes[0]->pad, region, groups);
}

}  // namespace malus::internal
#endif
