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

/// x -> sum over k of x[k] * matrix[k].
HWY_INLINE void rotate(Floats* cells, int count, const CellMatrix& matrix) {
  Floats m[kLanes];
  for (std::size_t k = 0; k < kLanes; ++k) load(matrix[k].data(), m[k]);
  for (int i = 0; i < count; ++i) {
    const Floats x = cells[i];
    Floats even{}, odd{};
    for (int k = 0; k < kLanes; k += 2) {
      even += lane(x, k) * m[k];
      odd += lane(x, k + 1) * m[k + 1];
    }
    cells[i] = even + odd;
  }
}

/// Separable orthonormal transform of kSide x kSide cells; matrix[k][i].
template <int kSide, int kSize>
HWY_INLINE void transform_block(Floats* cells, const float (&matrix)[kSize][kSize], bool inverse) {
  Floats rows[kSide * kSide];
  const auto weight = [&](int k, int i) { return inverse ? matrix[i][k] : matrix[k][i]; };
  for (int r = 0; r < kSide; ++r)
    for (int k = 0; k < kSide; ++k) {
      Floats sum = weight(k, 0) * cells[r * kSide];
      for (int i = 1; i < kSide; ++i) sum += weight(k, i) * cells[r * kSide + i];
      rows[r * kSide + k] = sum;
    }
  for (int c = 0; c < kSide; ++c)
    for (int k = 0; k < kSide; ++k) {
      Floats sum = weight(k, 0) * rows[c];
      for (int i = 1; i < kSide; ++i) sum += weight(k, i) * rows[i * kSide + c];
      cells[k * kSide + c] = sum;
    }
}
