// Small matrices in whole tiles of the matrix unit: float32 rows are rounded into the order in
// which it takes them, and multiplied. Sizes are multiples of kLane; the inner one is filled up
// with zeros to whole steps. No include guard, as tile_registers-inl.h.

#include "malus/neural/internal/tile_registers-inl.h"

constexpr std::ptrdiff_t kTileValues = kTileRows * kDepth;
constexpr std::ptrdiff_t whole_steps(std::ptrdiff_t n) {
  return (n + kDepth - 1) / kDepth * kDepth;
}

void shape_whole_tiles() {
  TileShapes shapes;
  for (int tile = 0; tile < 8; ++tile) shape_tile(shapes, tile, kTileRows, 64);
  use_shapes(shapes);
}

// 16 rows of a times kAcross tiles of columns; b's tiles lie step by step, `tiles` each.
template <int kAcross>
HWY_INLINE void multiply_strip(const Bfloat16* a, std::ptrdiff_t a_row, const Bfloat16* b,
                               std::ptrdiff_t tiles, std::ptrdiff_t steps, float* c,
                               std::ptrdiff_t c_row) {
  constexpr std::ptrdiff_t kRow = 64;
  clear<0>();
  if constexpr (kAcross > 1) clear<1>();
  if constexpr (kAcross > 2) clear<2>();
  if constexpr (kAcross > 3) clear<3>();
  for (std::ptrdiff_t step = 0; step < steps; ++step, a += kDepth, b += tiles * kTileValues) {
    load<4>(a, 2 * a_row);
    load<5>(b, kRow);
    multiply_add<0, 4, 5>();
    if constexpr (kAcross > 1) {
      load<6>(b + kTileValues, kRow);
      multiply_add<1, 4, 6>();
    }
    if constexpr (kAcross > 2) {
      load<7>(b + 2 * kTileValues, kRow);
      multiply_add<2, 4, 7>();
    }
    if constexpr (kAcross > 3) {
      load<5>(b + 3 * kTileValues, kRow);
      multiply_add<3, 4, 5>();
    }
  }
  const std::ptrdiff_t bytes = c_row * kFloatBytes;
  store<0>(c, bytes);
  if constexpr (kAcross > 1) store<1>(c + kLane, bytes);
  if constexpr (kAcross > 2) store<2>(c + 2 * kLane, bytes);
  if constexpr (kAcross > 3) store<3>(c + 3 * kLane, bytes);
}

void multiply_strip(const Bfloat16* a, std::ptrdiff_t a_row, const Bfloat16* b,
                    std::ptrdiff_t tiles, std::ptrdiff_t steps, float* c, std::ptrdiff_t c_row) {
  for (std::ptrdiff_t n = 0; n < tiles; n += 4, b += 4 * kTileValues, c += 4 * kLane) {
    const std::ptrdiff_t left = tiles - n;
    if (left > 3)
      multiply_strip<4>(a, a_row, b, tiles, steps, c, c_row);
    else if (left == 3)
      multiply_strip<3>(a, a_row, b, tiles, steps, c, c_row);
    else if (left == 2)
      multiply_strip<2>(a, a_row, b, tiles, steps, c, c_row);
    else
      multiply_strip<1>(a, a_row, b, tiles, steps, c, c_row);
  }
}

HWY_INLINE __m512i rounded(__m512 low, __m512 high) {
  return (__m512i)_mm512_cvtne2ps_pbh(high, low);
}

// Values of two rows, each beside the other row's: so the unit takes two inner values at once.
HWY_INLINE __m512i side_by_side(__m512 upper, __m512 lower) {
  const __m512i order = _mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24,
                                         8, 23, 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
  return _mm512_permutexvar_epi16(order, rounded(upper, lower));
}

HWY_INLINE __m512i chosen(__m512i a, __m512i b, bool odd) {
  return odd ? _mm512_shuffle_i32x4(a, b, 0xDD) : _mm512_shuffle_i32x4(a, b, 0x88);
}

// 16 x 16 words of 32 bits.
HWY_INLINE void transpose(__m512i (&v)[16]) {
  __m512i two[16], four[16];
  for (int i = 0; i < 16; i += 2) {
    two[i] = _mm512_unpacklo_epi32(v[i], v[i + 1]);
    two[i + 1] = _mm512_unpackhi_epi32(v[i], v[i + 1]);
  }
  for (int i = 0; i < 16; i += 4)
    for (int half = 0; half < 2; ++half) {
      four[i + 2 * half] = _mm512_unpacklo_epi64(two[i + half], two[i + half + 2]);
      four[i + 2 * half + 1] = _mm512_unpackhi_epi64(two[i + half], two[i + half + 2]);
    }
  for (int c = 0; c < 4; ++c)
    for (int odd = 0; odd < 2; ++odd) {
      const __m512i above = chosen(four[c], four[4 + c], odd != 0),
                    below = chosen(four[8 + c], four[12 + c], odd != 0);
      v[4 * odd + c] = chosen(above, below, false);
      v[4 * odd + 8 + c] = chosen(above, below, true);
    }
}

HWY_INLINE void store_tile(const __m512i (&v)[16], Bfloat16* to, std::ptrdiff_t to_row) {
  for (int i = 0; i < 16; ++i) _mm512_store_si512(to + i * to_row, v[i]);
}

// The rounded values [k, k + kDepth) of a row; zeros from width on.
HWY_INLINE __m512i rounded_step(const float* row, std::ptrdiff_t k, std::ptrdiff_t width) {
  return rounded(_mm512_loadu_ps(row + k),
                 k + kLane < width ? _mm512_loadu_ps(row + k + kLane) : _mm512_setzero_ps());
}

// Rows as they are, which is how the unit takes a; the last step is filled up with zeros.
void round_rows(const float* from, std::ptrdiff_t row, std::ptrdiff_t rows, std::ptrdiff_t width,
                Bfloat16* to) {
  for (std::ptrdiff_t i = 0; i < rows; ++i, from += row)
    for (std::ptrdiff_t k = 0; k < width; k += kDepth, to += kDepth)
      _mm512_store_si512(to, rounded_step(from, k, width));
}

// Rows become b's columns.
void round_to_columns(const float* from, std::ptrdiff_t row, std::ptrdiff_t rows,
                      std::ptrdiff_t width, Bfloat16* to) {
  for (std::ptrdiff_t k = 0; k < width; k += kDepth)
    for (std::ptrdiff_t i = 0; i < rows; i += kTileRows, to += kTileValues) {
      __m512i words[16];
      for (int r = 0; r < 16; ++r) words[r] = rounded_step(from + (i + r) * row, k, width);
      transpose(words);
      store_tile(words, to, kDepth);
    }
}

// Rows become the inner dimension: of b as they are, of a as its columns. squares (null: not
// wanted): sums over the rows.
template <bool kOfA>
void round_to_inner(const float* from, std::ptrdiff_t row, std::ptrdiff_t rows,
                    std::ptrdiff_t width, Bfloat16* to, float* squares) {
  const std::ptrdiff_t tiles = width / kLane, whole = whole_steps(rows);
  for (std::ptrdiff_t tile = 0; tile < tiles; ++tile) {
    const float* corner = from + tile * kLane;
    __m512 sum[2] = {_mm512_setzero_ps(), _mm512_setzero_ps()};
    for (std::ptrdiff_t step = 0; step < whole; step += kDepth) {
      __m512i words[16];
      for (int i = 0; i < 16; ++i) {
        const std::ptrdiff_t r = step + 2 * i;
        if (r >= rows) {
          words[i] = _mm512_setzero_si512();
          continue;
        }
        const __m512 upper = _mm512_loadu_ps(corner + r * row),
                     lower = _mm512_loadu_ps(corner + (r + 1) * row);
        sum[0] = _mm512_fmadd_ps(upper, upper, sum[0]);
        sum[1] = _mm512_fmadd_ps(lower, lower, sum[1]);
        words[i] = side_by_side(upper, lower);
      }
      if constexpr (kOfA) {
        transpose(words);
        store_tile(words, to + tile * kTileRows * whole + step, whole);
      } else {
        store_tile(words, to + (step / kDepth * tiles + tile) * kTileValues, kDepth);
      }
    }
    if (squares != nullptr) _mm512_store_ps(squares + tile * kLane, _mm512_add_ps(sum[0], sum[1]));
  }
}
