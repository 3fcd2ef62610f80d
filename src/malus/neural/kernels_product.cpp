// Products of matrices in tiles that stay in registers (Goto and van de Geijn, "Anatomy of
// high-performance matrix multiplication", 2008), for many rows of few values times packed weights.
#include "malus/neural/internal/kernels.h"

#include <algorithm>
#include <array>
#include <cstring>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/neural/kernels_product.cpp"
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3_DL)
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kLane>;
using Vec = hn::Vec<Tag>;
constexpr std::ptrdiff_t kWidth = hn::MaxLanes(Tag());

// Registers decide the tile: 8 rows by 3 vectors where there are 32 of 512 bits, else 4 rows by 16
// columns.
constexpr int kRows = kWidth == kLane ? 8 : 4;
constexpr std::ptrdiff_t kTileCols = kWidth == kLane ? kPanel : kLane;
// Rows of b that stay in the second-level cache while all rows of a pass by.
constexpr std::ptrdiff_t kInnerBlock = 384;

// A part of the inner dimension: values [k0, k1) of each tap in [tap0, tap1).
struct InnerPart {
  std::ptrdiff_t tap0, tap1, k0, k1;
  bool first, last;
};

// Where a tile lies: its corner of a, its columns of b and c.
struct TilePlace {
  const float *a, *b;
  std::ptrdiff_t b_inner;
  const float* bias;
  float* c;
  std::ptrdiff_t c_row;
};

template <int kHeight, int kVectors>
HWY_INLINE void tile(const MatrixProduct& p, const InnerPart& part, const TilePlace& at) {
  const Tag d;
  Vec sum[kHeight][kVectors];
  for (int i = 0; i < kHeight; ++i)
    for (int j = 0; j < kVectors; ++j) {
      sum[i][j] =
          part.first && !p.add ? hn::Zero(d) : hn::LoadU(d, at.c + i * at.c_row + j * kWidth);
      if (part.first && at.bias != nullptr)
        sum[i][j] = hn::Add(sum[i][j], hn::LoadU(d, at.bias + j * kWidth));
    }
  for (std::ptrdiff_t tap = part.tap0; tap < part.tap1; ++tap) {
    const float* a = at.a + (p.taps.empty() ? 0 : p.taps[static_cast<std::size_t>(tap)]);
    const float* b = at.b + tap * p.inner * at.b_inner;
    for (std::ptrdiff_t k = part.k0; k < part.k1; ++k) {
      Vec row[kVectors];
      for (int j = 0; j < kVectors; ++j) row[j] = hn::LoadU(d, b + k * at.b_inner + j * kWidth);
      for (int i = 0; i < kHeight; ++i) {
        const Vec value = hn::Set(d, a[i * p.a_row + k * p.a_inner]);
        for (int j = 0; j < kVectors; ++j) sum[i][j] = hn::MulAdd(value, row[j], sum[i][j]);
      }
    }
  }
  const bool leaks = part.last && p.leak < 1;
  const Vec leak = hn::Set(d, p.leak);
  for (int i = 0; i < kHeight; ++i)
    for (int j = 0; j < kVectors; ++j) {
      if (leaks) sum[i][j] = hn::Max(sum[i][j], hn::Mul(leak, sum[i][j]));
      hn::StoreU(sum[i][j], d, at.c + i * at.c_row + j * kWidth);
    }
}

template <int kHeight>
HWY_INLINE void tile_of(std::ptrdiff_t cols, const MatrixProduct& p, const InnerPart& part,
                        const TilePlace& at) {
  constexpr int kOne = static_cast<int>(kLane / kWidth);
  if constexpr (kTileCols == kPanel) {
    if (cols > 2 * kLane) return tile<kHeight, 3>(p, part, at);
    if (cols > kLane) return tile<kHeight, 2>(p, part, at);
  }
  tile<kHeight, kOne>(p, part, at);
}

// Rows in tiles, the rest in tiles of 4, 2 and 1.
template <int kHeight>
HWY_INLINE void rows_of(std::ptrdiff_t row, std::ptrdiff_t cols, const MatrixProduct& p,
                        const InnerPart& part, TilePlace at) {
  const TilePlace corner = at;
  for (; row + kHeight <= p.rows; row += kHeight) {
    at.a = corner.a + row * p.a_row;
    at.c = corner.c + row * at.c_row;
    tile_of<kHeight>(cols, p, part, at);
  }
  if constexpr (kHeight > 1) rows_of<kHeight / 2>(row, cols, p, part, corner);
}

// Columns that end inside a vector pass through a buffer of whole vectors.
void ragged_columns(std::ptrdiff_t cols, const MatrixProduct& p, const InnerPart& part,
                    const TilePlace& at) {
  alignas(64) std::array<float, kPanel> bias{};
  alignas(64) std::array<float, kRows * kPanel> c{};
  if (at.bias != nullptr) std::copy_n(at.bias, cols, bias.data());
  for (std::ptrdiff_t row = 0; row < p.rows; row += kRows) {
    MatrixProduct few = p;
    few.rows = std::min<std::ptrdiff_t>(kRows, p.rows - row);
    for (std::ptrdiff_t i = 0; i < few.rows; ++i)
      std::copy_n(at.c + (row + i) * p.c_row, cols, c.data() + i * kPanel);
    rows_of<kRows>(0, whole_lanes(cols), few, part,
                   {at.a + row * p.a_row, at.b, at.b_inner, bias.data(), c.data(), kPanel});
    for (std::ptrdiff_t i = 0; i < few.rows; ++i)
      std::copy_n(c.data() + i * kPanel, cols, at.c + (row + i) * p.c_row);
  }
}

void multiply_part(const MatrixProduct& p, const InnerPart& part) {
  const std::ptrdiff_t taps = std::max<std::ptrdiff_t>(std::ssize(p.taps), 1);
  for (std::ptrdiff_t panel = 0; panel < p.cols; panel += kPanel) {
    const std::ptrdiff_t panel_cols = std::min(kPanel, p.cols - panel);
    for (std::ptrdiff_t col = 0; col < panel_cols; col += kTileCols) {
      const std::ptrdiff_t cols = std::min(kTileCols, panel_cols - col), n = panel + col;
      const bool plain = p.b_inner != 0;
      TilePlace at{p.a,
                   p.b + (plain ? n : panel * taps * p.inner + col),
                   plain ? p.b_inner : whole_lanes(panel_cols),
                   p.bias == nullptr ? nullptr : p.bias + n,
                   p.c + n,
                   p.c_row};
      for (std::ptrdiff_t group = 0; group < p.groups; ++group) {
        if (cols % kLane == 0)
          rows_of<kRows>(0, cols, p, part, at);
        else
          ragged_columns(cols, p, part, at);
        at.a += p.a_group;
        at.c += p.c_group;
      }
    }
  }
}

void multiply(const MatrixProduct& p) {
  const std::ptrdiff_t taps = std::max<std::ptrdiff_t>(std::ssize(p.taps), 1);
  if (p.inner > kInnerBlock / 2) {
    const std::ptrdiff_t parts = (p.inner + kInnerBlock - 1) / kInnerBlock,
                         size = (p.inner + parts - 1) / parts;
    for (std::ptrdiff_t tap = 0; tap < taps; ++tap)
      for (std::ptrdiff_t k = 0; k < p.inner; k += size)
        multiply_part(p, {tap, tap + 1, k, std::min(k + size, p.inner), tap == 0 && k == 0,
                          tap + 1 == taps && k + size >= p.inner});
    return;
  }
  const std::ptrdiff_t group = std::max<std::ptrdiff_t>(kInnerBlock / p.inner, 1);
  for (std::ptrdiff_t tap = 0; tap < taps; tap += group)
    multiply_part(p, {tap, std::min(tap + group, taps), 0, p.inner, tap == 0, tap + group >= taps});
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(multiply);
void multiply(const MatrixProduct& product) { HWY_DYNAMIC_DISPATCH(multiply)(product); }

void pack_columns(const float* b, std::ptrdiff_t inner, std::ptrdiff_t cols,
                  std::ptrdiff_t inner_stride, std::ptrdiff_t col_stride, float* to) {
  for (std::ptrdiff_t panel = 0; panel < cols; panel += kPanel) {
    const std::ptrdiff_t count = std::min(kPanel, cols - panel), width = whole_lanes(count);
    for (std::ptrdiff_t k = 0; k < inner; ++k, to += width)
      for (std::ptrdiff_t n = 0; n < width; ++n)
        to[n] = n < count ? b[k * inner_stride + (panel + n) * col_stride] : 0.0F;
  }
}

}  // namespace malus::internal
#endif
