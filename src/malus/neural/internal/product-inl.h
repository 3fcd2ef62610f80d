// Products of matrices in tiles that stay in registers (Goto and van de Geijn, "Anatomy of
// high-performance matrix multiplication", 2008), written once for every arithmetic. The including
// file defines, in its own namespace, `struct Arithmetic` with the types Value (of a and b), Vec
// (kWidth float32 sums) and Factor (what multiplies), and the operations used below; this file has
// no include guard because it is included once per instruction set.
//
// Inner values are taken Arithmetic::kDepth at a time: weights of that many rows lie interleaved,
// and each tap's last ones are filled up with zeros, which meet whatever follows the values of a.

using Value = Arithmetic::Value;
using Vec = Arithmetic::Vec;

constexpr std::ptrdiff_t kWidth = Arithmetic::kWidth;
constexpr std::ptrdiff_t kDepth = Arithmetic::kDepth;

// Registers decide the tile: where there are 32 of 512 bits, 24 sums (16 of single columns), which
// hide the multiply-add's latency; of AVX2's 16, 12 sums of 6 rows by 16 columns, 2 factors and one
// value; else 4 rows by 16 columns.
constexpr std::ptrdiff_t kTileCols = kWidth == kLane ? 4 * kLane : kLane;
template <int kVectors>
constexpr int kTileRows = 2 * kWidth == kLane ? 6
                          : kWidth < kLane    ? 4
                          : kVectors == 1     ? 16
                                              : 24 / kVectors;
// Columns of a panel of packed weights: a tile's, so that what a tile reads of them lies together.
// For whole tiles of three or of four vectors whichever leaves no narrow panel.
constexpr std::ptrdiff_t panel_cols_of(std::ptrdiff_t cols) {
  return kWidth == kLane ? panel_of(cols) : kTileCols;
}
// Rows that columns which end inside a vector pass at a time.
constexpr std::ptrdiff_t kRaggedRows = 24;
// Rows of b that stay in the second-level cache while all rows of a pass by; a panel of a narrow
// tile stays in the first level's.
constexpr std::ptrdiff_t kInnerBlock = (kWidth == kLane ? 1280 : 384) * kDepth;

#include "malus/neural/internal/inner_parts-inl.h"

// Where a tile lies: its corner of a, its columns of b and c, its rows' factors (or null).
struct TilePlace {
  const Value *a, *b;
  std::ptrdiff_t b_inner;
  const float *bias, *factors;
  float* c;
  std::ptrdiff_t c_row;
  const float* ahead = nullptr;  // of the first row, or null
};

// Where the sums of a tile start: at the bias, or at what c holds already. What is decided once per
// tile is decided outside of the loops over its sums, so that these stay in registers.
template <int kHeight, int kVectors>
HWY_INLINE void start_sums(const MatrixProduct& p, const InnerPart& part, const TilePlace& at,
                           Vec (&sum)[kHeight][kVectors]) {
  using A = Arithmetic;
  const bool biased = part.first && at.bias != nullptr && at.factors == nullptr;
  for (int j = 0; j < kVectors; ++j) {
    const Vec bias = biased ? A::load(at.bias + j * kWidth) : A::zero();
    for (int i = 0; i < kHeight; ++i) sum[i][j] = bias;
  }
  if (part.first && !p.add) return;
  for (int i = 0; i < kHeight; ++i)
    for (int j = 0; j < kVectors; ++j)
      sum[i][j] = A::add(sum[i][j], A::load(at.c + i * at.c_row + j * kWidth));
}

// What becomes of a tile's sums once they are whole.
template <int kHeight, int kVectors>
HWY_INLINE void finish_sums(const MatrixProduct& p, const TilePlace& at,
                            Vec (&sum)[kHeight][kVectors]) {
  using A = Arithmetic;
  if (at.factors != nullptr)
    for (int j = 0; j < kVectors; ++j) {
      const Vec bias = at.bias == nullptr ? A::zero() : A::load(at.bias + j * kWidth);
      for (int i = 0; i < kHeight; ++i)
        sum[i][j] = A::add(A::multiply(sum[i][j], A::fill(at.factors[i])), bias);
    }
  if (p.leak < 1) {
    const Vec leak = A::fill(p.leak);
    for (int i = 0; i < kHeight; ++i)
      for (int j = 0; j < kVectors; ++j)
        sum[i][j] = A::max(sum[i][j], A::multiply(leak, sum[i][j]));
  }
}

template <int kHeight, int kVectors>
HWY_INLINE void store_sums(const MatrixProduct& p, const InnerPart& part, const TilePlace& at,
                           Vec (&sum)[kHeight][kVectors]) {
  using A = Arithmetic;
  if (part.last && (at.factors != nullptr || p.leak < 1)) finish_sums(p, at, sum);
  if constexpr (kVectors % 2 == 0) {
    constexpr int kHalf = kVectors / 2;
    if (p.gate) {
      for (int i = 0; i < kHeight; ++i)
        for (int j = 0; j < kHalf; ++j)
          A::store(A::multiply(sum[i][j], sum[i][kHalf + j]), at.c + i * at.c_row + j * kWidth);
      return;
    }
  }
  for (int i = 0; i < kHeight; ++i)
    for (int j = 0; j < kVectors; ++j) A::store(sum[i][j], at.c + i * at.c_row + j * kWidth);
}

template <int kHeight, int kVectors>
HWY_INLINE void tile(const MatrixProduct& p, const InnerPart& part, const TilePlace& at) {
  using A = Arithmetic;
  Vec sum[kHeight][kVectors];
  start_sums(p, part, at, sum);
  for (std::ptrdiff_t tap = part.tap0; tap < part.tap1; ++tap) {
    const Value* a = at.a + (p.taps.empty() ? 0 : p.taps[static_cast<std::size_t>(tap)]);
    const Value* b = at.b + tap * whole_depth(p.inner) * at.b_inner;
    for (std::ptrdiff_t k = part.k0; k < part.k1; k += kDepth) {
      A::Factor row[kVectors];
      for (int j = 0; j < kVectors; ++j)
        row[j] = A::factors(b + k * at.b_inner + j * kWidth * kDepth);
      for (int i = 0; i < kHeight; ++i) {
        const A::Factor value = A::spread(a + i * p.a_row + k * p.a_inner);
        for (int j = 0; j < kVectors; ++j) sum[i][j] = A::multiply_add(value, row[j], sum[i][j]);
      }
    }
  }
  store_sums(p, part, at, sum);
}

// Rows from `row` on in tiles, the rest in tiles of 4, 2 and 1.
template <int kHeight, int kVectors>
HWY_INLINE void tiles_of(std::ptrdiff_t row, const MatrixProduct& p, const InnerPart& part,
                         TilePlace at) {
  const TilePlace corner = at;
  for (; row + kHeight <= p.rows; row += kHeight) {
    at.a = corner.a + row * p.a_row;
    at.c = corner.c + row * at.c_row;
    if (corner.factors != nullptr) at.factors = corner.factors + row;
    if (corner.ahead != nullptr) fetch(corner.ahead + row * p.ahead_row, kHeight * p.ahead_row);
    tile<kHeight, kVectors>(p, part, at);
  }
  constexpr int kLess = kHeight > 4 ? 4 : kHeight / 2;
  if constexpr (kLess > 0) tiles_of<kLess, kVectors>(row, p, part, corner);
}

// All rows of up to kTileCols columns.
inline void rows_of(std::ptrdiff_t cols, const MatrixProduct& p, const InnerPart& part,
                    const TilePlace& at) {
  constexpr int kOne = static_cast<int>(kLane / kWidth);
  if constexpr (kOne == 1) {
    if (cols > 3 * kLane) return tiles_of<kTileRows<4>, 4>(0, p, part, at);
    if (cols > 2 * kLane) return tiles_of<kTileRows<3>, 3>(0, p, part, at);
    if (cols > kLane) return tiles_of<kTileRows<2>, 2>(0, p, part, at);
  }
  tiles_of<kTileRows<kOne>, kOne>(0, p, part, at);
}

// Columns that end inside a vector pass through a buffer of whole vectors.
inline void ragged_columns(std::ptrdiff_t cols, const MatrixProduct& p, const InnerPart& part,
                           const TilePlace& at) {
  alignas(64) std::array<float, kTileCols> bias{};
  alignas(64) std::array<float, kRaggedRows * kTileCols> c{};
  if (at.bias != nullptr) std::copy_n(at.bias, cols, bias.data());
  for (std::ptrdiff_t row = 0; row < p.rows; row += kRaggedRows) {
    MatrixProduct few = p;
    few.rows = std::min(kRaggedRows, p.rows - row);
    for (std::ptrdiff_t i = 0; i < few.rows; ++i)
      std::copy_n(at.c + (row + i) * p.c_row, cols, c.data() + i * kTileCols);
    rows_of(whole_lanes(cols), few, part,
            {at.a + row * p.a_row, at.b, at.b_inner, bias.data(),
             at.factors == nullptr ? nullptr : at.factors + row, c.data(), kTileCols});
    for (std::ptrdiff_t i = 0; i < few.rows; ++i)
      std::copy_n(c.data() + i * kTileCols, cols, at.c + (row + i) * p.c_row);
  }
}

// Up to kTileCols columns from col on of the panel of panel_cols columns that begins at panel.
inline void multiply_part(const MatrixProduct& p, const Value* a, const Value* b,
                          const InnerPart& part, std::ptrdiff_t panel, std::ptrdiff_t panel_cols,
                          std::ptrdiff_t col) {
  const std::ptrdiff_t taps = std::max<std::ptrdiff_t>(std::ssize(p.taps), 1);
  const std::ptrdiff_t cols = std::min(kTileCols, panel_cols - col), n = panel + col;
  const bool plain = p.b_inner != 0;
  TilePlace at{a,
               b + (plain ? n : panel * taps * whole_depth(p.inner) + col * kDepth),
               plain ? p.b_inner : whole_lanes(panel_cols),
               p.bias == nullptr ? nullptr : p.bias + n,
               p.row_factors,
               p.c + (p.gate ? n / 2 : n),
               p.c_row,
               n == 0 && part.first ? p.ahead : nullptr};
  for (std::ptrdiff_t group = 0; group < p.groups; ++group) {
    if (cols % kLane == 0)
      rows_of(cols, p, part, at);
    else
      ragged_columns(cols, p, part, at);
    at.a += p.a_group;
    at.c += p.c_group;
    if (at.factors != nullptr) at.factors += p.rows;
    if (at.ahead != nullptr) at.ahead += p.ahead_group;
  }
}

// The whole product p with a and b in place of its own.
inline void multiply_parts(const MatrixProduct& p, const Value* a, const Value* b) {
  const std::ptrdiff_t most = p.gate ? kTileCols : panel_cols_of(p.cols);
  for (std::ptrdiff_t panel = 0; panel < p.cols; panel += most) {
    const std::ptrdiff_t panel_cols = std::min(most, p.cols - panel);
    for (std::ptrdiff_t col = 0; col < panel_cols; col += kTileCols)
      for_inner_parts(
          p, [&](const InnerPart& part) { multiply_part(p, a, b, part, panel, panel_cols, col); });
  }
}
