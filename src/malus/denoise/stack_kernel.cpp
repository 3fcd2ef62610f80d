// The inner loops of the mosaic filter. Vectors are 16 floats on every machine, in as many
// registers as it needs, and where products are added in one rounding (`fused`), the source says
// so, not the compiler: so all machines that can do that compute the same bits.
#include "malus/denoise/internal/stack_kernel.h"

#include "malus/base/vector_targets.h"
#include "malus/denoise/internal/pilot_doubt.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/stack_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/aligned_allocator.h>
#include <hwy/highway.h>

// Wide vectors cross only inlined calls: their calling convention does not matter.
#pragma GCC diagnostic ignored "-Wpsabi"

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#include "malus/denoise/internal/cells-inl.h"
constexpr float kHalfRoot = 0.70710678118654752f;

/// Haar transform along the stack, count a power of two.
HWY_INLINE void haar(Floats* cells, int count, int stride) {
  Floats scratch[kMaxStack];
  for (int n = count; n > 1; n /= 2) {
    for (int i = 0; i < n / 2; ++i) {
      const Floats a = cells[2 * i * stride], b = cells[(2 * i + 1) * stride];
      scratch[i] = (a + b) * kHalfRoot;
      scratch[n / 2 + i] = (a - b) * kHalfRoot;
    }
    for (int i = 0; i < n; ++i) copy(scratch[i], cells[i * stride]);
  }
}

HWY_INLINE void inverse_haar(Floats* cells, int count, int stride) {
  Floats scratch[kMaxStack];
  for (int n = 2; n <= count; n *= 2) {
    for (int i = 0; i < n / 2; ++i) {
      const Floats a = cells[i * stride], b = cells[(n / 2 + i) * stride];
      scratch[2 * i] = (a + b) * kHalfRoot;
      scratch[2 * i + 1] = (a - b) * kHalfRoot;
    }
    for (int i = 0; i < n; ++i) copy(scratch[i], cells[i * stride]);
  }
}

/// Variances of values along the stack, independent after the transform -> before it.
HWY_INLINE void spread_variances(Floats* variances, int count) {
  Floats scratch[kMaxStack];
  for (int n = 2; n <= count; n *= 2) {
    for (int i = 0; i < n / 2; ++i)
      scratch[2 * i] = scratch[2 * i + 1] = 0.5f * (variances[i] + variances[n / 2 + i]);
    for (int i = 0; i < n; ++i) copy(scratch[i], variances[i]);
  }
}

template <int kSide>
HWY_INLINE void transform_blocks(Floats* cells, int count, const StackJob& job, bool inverse) {
  for (int n = 0; n < count; ++n)
    transform_block<kSide>(cells + n * kSide * kSide, job.dct, inverse);
}

template <int kSide>
HWY_INLINE void transform_stack(Floats* cells, int count, const StackJob& job, bool inverse) {
  constexpr int kCells = kSide * kSide;
  if (inverse)
    for (int i = 0; i < kCells; ++i) inverse_haar(cells + i, count, kCells);
  transform_blocks<kSide>(cells, count, job, inverse);
  if (!inverse)
    for (int i = 0; i < kCells; ++i) haar(cells + i, count, kCells);
}

template <int kSide>
HWY_INLINE void gather(const StackJob& job, const float* from, const std::ptrdiff_t* matches,
                       int count, Floats* cells) {
  for (int n = 0; n < count; ++n)
    for (int r = 0; r < kSide; ++r)
      for (int c = 0; c < kSide; ++c)
        cells[(n * kSide + r) * kSide + c] =
            load_cell(from + matches[n] + r * kCell * job.stride + c * kCell, job.stride);
}

/// Every second cell of the blocks, as on a chessboard; returns how many.
template <int kSide>
HWY_INLINE int gather_half(const StackJob& job, const float* from, const std::ptrdiff_t* matches,
                           int count, Floats* cells) {
  int total = 0;
  for (int n = 0; n < count; ++n)
    for (int r = 0; r < kSide; ++r)
      for (int c = (n + r) % 2; c < kSide; c += 2)
        cells[total++] =
            load_cell(from + matches[n] + r * kCell * job.stride + c * kCell, job.stride);
  return total;
}

#include "malus/denoise/internal/stack_axes-inl.h"
#include "malus/denoise/internal/stack_select-inl.h"
// After the selection.
#include "malus/denoise/internal/stack_match-inl.h"
#include "malus/denoise/internal/stack_shrink-inl.h"
// After the shrinkage.
#include "malus/denoise/internal/stack_ridge-inl.h"

/// The upper triangle, the only part that axes_of needs.
HWY_INLINE CellMatrix second_moments(const Floats* cells, int total) {
  constexpr std::size_t kHalf = kLanes / 2, kRows = HWY_MAX_BYTES == sizeof(Floats) ? kHalf : 4;
  CellMatrix moments{};
  for (std::size_t row = 0; row < kHalf; row += kRows)
    product_rows<Floats, kRows>(cells, cells, total, 1, 0, row, moments);
  product_rows<Floats8, kHalf>(cells, cells, total, 1, 0, kHalf, moments);
  for (CellVector& row : moments)
    for (float& value : row) value *= 1.0f / static_cast<float>(total);
  return moments;
}

HWY_INLINE CellMatrix transposed(const CellMatrix& m) {
  CellMatrix t;
  for (std::size_t i = 0; i < kLanes; ++i)
    for (std::size_t k = 0; k < kLanes; ++k) t[k][i] = m[i][k];
  return t;
}

HWY_INLINE void add(CellMatrix& to, float share, const CellMatrix& more) {
  for (std::size_t i = 0; i < kLanes; ++i)
    for (std::size_t k = 0; k < kLanes; ++k) to[i][k] += share * more[i][k];
}

/// What a stack's axes are the principal ones of.
template <int kSide>
HWY_INLINE CellMatrix stack_moments(const StackJob& job, std::size_t alignment,
                                    const std::vector<std::ptrdiff_t>& matches, int count,
                                    Floats* room) {
  constexpr int kCells = kSide * kSide;
  // Blocks beyond the stack are similar enough to steady its axes; half of their cells will do.
  constexpr float kBeyondShare = 0.3f;
  CellMatrix moments{};
  const int beyond = static_cast<int>(matches.size()) - count;
  if (job.filter != StackFilter::hard && beyond > 0) {
    const int total = gather_half<kSide>(job, job.guide, matches.data() + count, beyond, room);
    add(moments, kBeyondShare, second_moments(room, total));
  }
  gather<kSide>(job, job.guide, matches.data(), count, room);
  add(moments, 1.0f, second_moments(room, count * kCells));
  add(moments, job.axes_prior, (*job.priors)[alignment]);
  return moments;
}

/// How unlike the blocks of a stack are: the variance of their samples about the stack's mean, less
/// that of noise [noise variances].
template <int kSide>
HWY_INLINE float unlikeness(const Floats* cells, int count) {
  constexpr int kCells = kSide * kSide;
  if (count < 2) return kUnlikeAny;
  const float share = 1.0f / static_cast<float>(count);
  Floats spread{};
  for (int i = 0; i < kCells; ++i) {
    Floats sum{};
    for (int n = 1; n < count; ++n) {
      const Floats difference = cells[n * kCells + i] - cells[i];
      sum += difference;
      spread = fused(difference, difference, spread);
    }
    spread -= share * (sum * sum);
  }
  return lane_sum(spread) / static_cast<float>((count - 1) * kCells * kLanes) - 1.0f;
}

template <int kSide>
HWY_INLINE void put_back(const StackJob& job, const std::ptrdiff_t* matches, int count,
                         const Floats* cells, float weight, const Floats* errors) {
  for (int n = 0; n < count; ++n) job.weight[matches[n]] += weight;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) {
      Floats window;
      load(job.window[static_cast<std::size_t>(r * kSide + c)].data(), window);
      window *= weight;
      for (int n = 0; n < count; ++n) {
        const std::ptrdiff_t at = matches[n] + r * kCell * job.stride + c * kCell;
        add_cell(job.sum + at, job.stride, window * cells[(n * kSide + r) * kSide + c]);
        if (job.error) add_cell(job.error + at, job.stride, window * errors[n]);
      }
    }
}

/// Stacks that get their axes together.
struct Batch {
  int size = 0;
  struct Stack {
    int row, col, count;
    std::vector<std::ptrdiff_t> matches;
  } stacks[kLanes];
  CellMatrix moments[kLanes], axes[kLanes];
};

/// The estimate of a stack in its components. passed, when given: per block the noise let through.
template <int kSide>
HWY_INLINE Shrinkage shrink_stack(const StackJob& job, const Batch::Stack& stack, Floats* cells,
                                  Floats* pilot, Floats* passed) {
  constexpr int kCells = kSide * kSide;
  const int count = stack.count;
  const int row = job.row0 + stack.row, col = job.col0 + stack.col;
  const float doubt = job.doubt ? job.doubt.near(row, col) : 1.0f;
  if (kSide == 2 && job.filter == StackFilter::ridge)
    return combine_blocks(job, count, cells, pilot, doubt, passed);
  Shrinkage result;
  transform_stack<kSide>(cells, count, job, false);
  if (job.filter == StackFilter::hard) {
    result = shrink_hard(cells, count * kCells, job.threshold);
  } else {
    transform_stack<kSide>(pilot, count, job, false);
    Doubts doubts{doubt, doubt};
    float bright = 0;
    if (job.excess || job.doubt) {
      const StackEvidence evidence = weigh_pilot(cells, pilot, count * kCells);
      if (job.excess) {
        const float weight = weight_around(evidence.strong, count * kCells);
        job.excess.at(row, col) = weight * evidence.strong.excess;
        job.energy.at(row, col) = weight * evidence.strong.energy;
      }
      if (job.doubt)
        doubts = {settled_doubt(doubt, evidence.strong), settled_doubt(doubt, evidence.others)};
      bright = evidence.bright;
    }
    if (job.settled) job.settled.at(row, col) = doubt_of_combinations(doubts.strong, bright);
    result = shrink_wiener<kCells>(cells, pilot, count, doubts, passed);
    if (passed) spread_variances(passed, count);
  }
  transform_stack<kSide>(cells, count, job, true);
  return result;
}

/// The errors of a stack's pixels, block by block: of its components' error, or of the noise that
/// each block's components have in `errors`.
HWY_INLINE void errors_of_pixels(const StackJob& job, const CellMatrix& back, const Floats& error,
                                 int count, Floats* errors) {
  if (job.noise) {
    CellMatrix squares = back;
    for (CellVector& axis : squares)
      for (float& value : axis) value *= value;
    return rotate(errors, count, squares);
  }
  Floats sum{};
  for (int k = 0; k < kLanes; ++k) {
    const Floats axis = row_of(back, static_cast<std::size_t>(k));
    sum += lane(error, k) * axis * axis;
  }
  for (int n = 0; n < count; ++n) errors[n] = sum;
}

template <int kSide>
HWY_INLINE void filter_stack(const StackJob& job, const Batch::Stack& stack, const CellMatrix& axes,
                             Floats* cells) {
  const int total = stack.count * kSide * kSide;
  const std::ptrdiff_t* matches = stack.matches.data();
  Floats *pilot = cells + job.stack * kSide * kSide, *errors = pilot + job.stack * kSide * kSide;
  gather<kSide>(job, job.noisy, matches, stack.count, cells);
  const float unlike = job.unlike ? unlikeness<kSide>(cells, stack.count) : 0.0f;
  rotate(cells, total, axes);
  if (job.filter != StackFilter::hard) {
    gather<kSide>(job, job.guide, matches, stack.count, pilot);
    rotate(pilot, total, axes);
  }
  const Shrinkage result =
      shrink_stack<kSide>(job, stack, cells, pilot, job.noise ? errors : nullptr);
  if (job.passed)
    job.passed.at(job.row0 + stack.row, job.col0 + stack.col) =
        1.0f / (result.weight * static_cast<float>(total * kLanes));
  const CellMatrix back = transposed(axes);
  rotate(cells, total, back);
  if (job.error) errors_of_pixels(job, back, result.error, stack.count, errors);
  if (job.unlike)
    for (int n = 0; n < stack.count; ++n) job.unlike[matches[n]] += result.weight * unlike;
  put_back<kSide>(job, matches, stack.count, cells, result.weight, errors);
}

template <int kSide>
HWY_INLINE void filter_batch(const StackJob& job, Batch& batch, Floats* cells) {
  const bool own_axes = job.axes_prior != kFrameAxes;
  if (own_axes) axes_of_stacks(batch.moments, batch.size, batch.axes);
  for (int i = 0; i < batch.size; ++i) {
    const Batch::Stack& stack = batch.stacks[i];
    filter_stack<kSide>(
        job, stack,
        own_axes ? batch.axes[i] : (*job.rotations)[job.alignment(stack.row, stack.col)], cells);
  }
  batch.size = 0;
}

template <int kSide>
void filter_block(const StackJob& job, const ReferenceBlock& block) {
  Search search(job, block, kSide * kCell);
  // Samples, pilot, and errors of the blocks.
  const auto size = static_cast<std::size_t>(job.stack * (2 * kSide * kSide + 1));
  const auto memory = hwy::AllocateAligned<Floats>(size);
  if (!memory) throw std::bad_alloc();
  Floats* cells = memory.get();
  std::fill_n(cells, size, Floats{});
  const auto batch = std::make_unique<Batch>();
  for (int row = block.row_begin; row < block.row_end; row += job.step)
    for (int col = block.col_begin; col < block.col_end; col += job.step) {
      Batch::Stack& stack = batch->stacks[batch->size];
      stack.row = row;
      stack.col = col;
      stack.count = match<kSide * kCell>(job, row, col, search);
      std::swap(stack.matches, search.matches);
      if (job.axes_prior != kFrameAxes)
        batch->moments[batch->size] =
            stack_moments<kSide>(job, job.alignment(row, col), stack.matches, stack.count, cells);
      if (++batch->size == kLanes) filter_batch<kSide>(job, *batch, cells);
    }
  filter_batch<kSide>(job, *batch, cells);
}

void filter(const StackJob& job, const ReferenceBlock& block) {
  if (job.block_cells == 2) return filter_block<2>(job, block);
  filter_block<4>(job, block);
}

template <int kBlock>
int match_one_of(const StackJob& job, int row, int col, std::vector<std::ptrdiff_t>& matches) {
  Search search(job, {row, row + 1, col, col + 1}, kBlock);
  const int count = match<kBlock>(job, row, col, search);
  matches = std::move(search.matches);
  return count;
}

int match_one(const StackJob& job, int row, int col, std::vector<std::ptrdiff_t>& matches) {
  return job.block_cells == 2 ? match_one_of<2 * kCell>(job, row, col, matches)
                              : match_one_of<4 * kCell>(job, row, col, matches);
}

void axes_of_all(const CellMatrix* moments, int count, CellMatrix* axes) {
  axes_of(moments, count, axes);
}

/// Weighted sum of linear estimates of all cells on a lattice of kGuideStep pixels.
void smooth(const SmoothJob& job, int row_begin, int row_end) {
  for (int row = row_begin; row < row_end; row += kGuideStep)
    for (int col = 0; col + kCell <= job.cols; col += kGuideStep) {
      const auto a = job.alignment(row, col);
      Floats mean, cell = load_cell(job.noisy + row * job.stride + col, job.stride);
      load(job.means[a].data(), mean);
      cell -= mean;
      rotate(&cell, 1, job.matrices[a]);
      add_cell(job.sum + row * job.stride + col, job.stride, cell + mean);
    }
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {
HWY_EXPORT(filter);
HWY_EXPORT(match_one);
HWY_EXPORT(axes_of_all);
HWY_EXPORT(smooth);
void filter_references(const StackJob& job, const ReferenceBlock& block) {
  HWY_DYNAMIC_DISPATCH(filter)(job, block);
}
int match_reference(const StackJob& job, int row, int col, std::vector<std::ptrdiff_t>& matches) {
  return HWY_DYNAMIC_DISPATCH(match_one)(job, row, col, matches);
}
void axes_of_stacks(const CellMatrix* moments, int count, CellMatrix* axes) {
  HWY_DYNAMIC_DISPATCH(axes_of_all)(moments, count, axes);
}
void smooth_cells(const SmoothJob& job, int row_begin, int row_end) {
  HWY_DYNAMIC_DISPATCH(smooth)(job, row_begin, row_end);
}
}  // namespace malus::internal
#endif
