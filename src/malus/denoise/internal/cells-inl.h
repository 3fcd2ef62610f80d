// Cells of 4x4 mosaic pixels as vectors: the arithmetic that the kernels share. No include guard:
// included once per instruction set, inside that set's namespace and after Highway's header.

#include "malus/denoise/internal/wide-inl.h"

static_assert(sizeof(Floats) == sizeof(float) * kLanes);

HWY_INLINE Floats load_cell(const float* at, std::ptrdiff_t stride) {
  Floats4 row[kCell];
  for (int r = 0; r < kCell; ++r) load(at + r * stride, row[r]);
  return joined(joined(row[0], row[1]), joined(row[2], row[3]));
}

HWY_INLINE void add_cell(float* at, std::ptrdiff_t stride, const Floats& value) {
  const auto top = low_half(value), bottom = high_half(value);
  const Floats4 rows[kCell] = {low_half(top), high_half(top), low_half(bottom), high_half(bottom)};
  for (int r = 0; r < kCell; ++r) {
    Floats4 sum;
    load(at + r * stride, sum);
    sum += rows[r];
    store(sum, at + r * stride);
  }
}

HWY_INLINE float lane_sum(const Floats& v) {
  float lanes[kLanes];
  store(v, lanes);
  float sum = 0;
  for (const float lane : lanes) sum += lane;
  return sum;
}

HWY_INLINE const float* lanes_of(const Floats& cell) {
  return reinterpret_cast<const float*>(&cell);
}

HWY_INLINE Floats row_of(const CellMatrix& matrix, std::size_t i) {
  Floats row;
  load(matrix[i].data(), row);
  return row;
}

/// cells[i] -> sum over k of cells[i][k] * matrix[k], for kCount cells, few enough that
/// sums stay in registers.
template <int kCount>
HWY_INLINE void rotate_some(Floats* cells, const CellMatrix& matrix) {
  Floats sum[kCount] = {};
  for (std::size_t k = 0; k < kLanes; ++k) {
    const Floats row = row_of(matrix, k);
    for (int i = 0; i < kCount; ++i)
      sum[i] = fused(all<Floats>(lanes_of(cells[i])[k]), row, sum[i]);
  }
  for (int i = 0; i < kCount; ++i) cells[i] = sum[i];
}

HWY_INLINE void rotate(Floats* cells, int count, const CellMatrix& matrix) {
  constexpr int kTogether = 4;
  int i = 0;
  for (; i + kTogether <= count; i += kTogether) rotate_some<kTogether>(cells + i, matrix);
  for (; i < count; ++i) rotate_some<1>(cells + i, matrix);
}

constexpr CellMatrix kIdentity = [] {
  CellMatrix matrix{};
  for (std::size_t i = 0; i < kLanes; ++i) matrix[i][i] = 1;
  return matrix;
}();

/// Rows of diagonal * I + sum over n of a[n] b[n]^T, vectors `stride` apart; only their last
/// values, as many as Vector holds.
template <class Vector, std::size_t kRows>
HWY_INLINE void product_rows(const Floats* a, const Floats* b, int count, int stride,
                             float diagonal, std::size_t row, CellMatrix& matrix) {
  constexpr std::size_t kFirst = kLanes - sizeof(Vector) / sizeof(float);
  Vector sums[kRows];
  for (std::size_t i = 0; i < kRows; ++i) {
    load(kIdentity[row + i].data() + kFirst, sums[i]);
    sums[i] *= diagonal;
  }
  for (int n = 0; n < count; ++n) {
    Vector values;
    load(lanes_of(b[n * stride]) + kFirst, values);
    for (std::size_t i = 0; i < kRows; ++i)
      sums[i] = fused(all<Vector>(lanes_of(a[n * stride])[row + i]), values, sums[i]);
  }
  for (std::size_t i = 0; i < kRows; ++i) store(sums[i], matrix[row + i].data() + kFirst);
}

HWY_INLINE void products(const Floats* a, const Floats* b, int count, int stride, float diagonal,
                         CellMatrix& matrix) {
  constexpr std::size_t kRows =  // whose sums stay in registers
      HWY_MAX_BYTES == sizeof(Floats) ? kLanes : 4;
  for (std::size_t row = 0; row < kLanes; row += kRows)
    product_rows<Floats, kRows>(a, b, count, stride, diagonal, row, matrix);
}

/// Orthonormal DCT-II of kSide cells, `stride` apart; matrix[k][i]. Even coefficients are those of
/// half as many sums (every second row of the matrix, kStep rows apart), odd ones come from the
/// differences.
template <int kSide, int kStep = 1, int kSize>
HWY_INLINE void transform_line(Floats* cells, int stride, const float (&matrix)[kSize][kSize]) {
  if constexpr (kSide == 1) {
    cells[0] = matrix[0][0] * cells[0];
  } else {
    constexpr int kHalf = kSide / 2;
    Floats sums[kHalf], differences[kHalf];
    for (int i = 0; i < kHalf; ++i) {
      const Floats a = cells[i * stride], b = cells[(kSide - 1 - i) * stride];
      sums[i] = a + b;
      differences[i] = a - b;
    }
    transform_line<kHalf, 2 * kStep>(sums, 1, matrix);
    for (int k = 0; k < kHalf; ++k) {
      const auto& row = matrix[kStep * (2 * k + 1)];
      Floats odd = row[0] * differences[0];
      for (int i = 1; i < kHalf; ++i) odd = fused(all<Floats>(row[i]), differences[i], odd);
      cells[2 * k * stride] = sums[k];
      cells[(2 * k + 1) * stride] = odd;
    }
  }
}

template <int kSide, int kStep = 1, int kSize>
HWY_INLINE void inverse_line(Floats* cells, int stride, const float (&matrix)[kSize][kSize]) {
  if constexpr (kSide == 1) {
    cells[0] = matrix[0][0] * cells[0];
  } else {
    constexpr int kHalf = kSide / 2;
    Floats evens[kHalf], odds[kHalf];
    for (int i = 0; i < kHalf; ++i) {
      evens[i] = cells[2 * i * stride];
      odds[i] = cells[(2 * i + 1) * stride];
    }
    inverse_line<kHalf, 2 * kStep>(evens, 1, matrix);
    for (int i = 0; i < kHalf; ++i) {
      Floats odd = matrix[kStep][i] * odds[0];
      for (int k = 1; k < kHalf; ++k)
        odd = fused(all<Floats>(matrix[kStep * (2 * k + 1)][i]), odds[k], odd);
      cells[i * stride] = evens[i] + odd;
      cells[(kSide - 1 - i) * stride] = evens[i] - odd;
    }
  }
}

/// Separable orthonormal transform of kSide x kSide cells; matrix[k][i].
template <int kSide, int kSize>
HWY_INLINE void transform_block(Floats* cells, const float (&matrix)[kSize][kSize], bool inverse) {
  const auto line = [&](Floats* first, int stride) {
    if (inverse)
      inverse_line<kSide>(first, stride, matrix);
    else
      transform_line<kSide>(first, stride, matrix);
  };
  for (int r = 0; r < kSide; ++r) line(cells + r * kSide, 1);
  for (int c = 0; c < kSide; ++c) line(cells + c, kSide);
}
