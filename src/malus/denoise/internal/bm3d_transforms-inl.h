// The transforms of the collaborative filter on pairs of blocks: biorthogonal and DCT along a
// direction of the plane, Haar along the group. No include guard: bm3d_spectra.cpp and
// bm3d_filter.cpp include it once per instruction set, inside that set's namespace, after
// wide-inl.h.

/// Row r of two blocks: lanes 0-7 of the first, 8-15 of the second.
struct Pair {
  Floats row[kPatch];
};

HWY_INLINE void load_row(const float* first, const float* second, Floats& out) {
  Floats8 a, b;
  load(first, a);
  load(second, b);
  out = joined(a, b);
}

/// The named lanes of every eight of a (0-7) and b (8-15).
template <int... kLane, class Vector>
HWY_INLINE Vector mixed(const Vector& a, const Vector& b) {
  if constexpr (sizeof(Vector) == 32)
    return __builtin_shufflevector(a, b, kLane...);
  else
    return __builtin_shufflevector(a, b, (kLane + kLane / 8 * 8)...,
                                   (8 + kLane + kLane / 8 * 8)...);
}

/// Transposes the 8x8 values in every eight lanes.
template <class Vector>
HWY_INLINE void transpose(Vector (&x)[kPatch]) {
  if constexpr (kIsTwo<Vector>) {  // of registers of four
    float from[kPatch][kPatch], to[kPatch][kPatch];
    for (int r = 0; r < kPatch; ++r) store(x[r], from[r]);
    for (int r = 0; r < kPatch; ++r)
      for (int c = 0; c < kPatch; ++c) to[c][r] = from[r][c];
    for (int r = 0; r < kPatch; ++r) load(to[r], x[r]);
  } else {
    Vector a[8], b[8];
    HWY_UNROLL(4)
    for (int i = 0; i < 8; i += 2) {
      a[i] = mixed<0, 8, 1, 9, 4, 12, 5, 13>(x[i], x[i + 1]);
      a[i + 1] = mixed<2, 10, 3, 11, 6, 14, 7, 15>(x[i], x[i + 1]);
    }
    HWY_UNROLL(2)
    for (int i = 0; i < 8; i += 4) {
      HWY_UNROLL(2)
      for (int j = 0; j < 2; ++j) {
        b[i + 2 * j] = mixed<0, 1, 8, 9, 4, 5, 12, 13>(a[i + j], a[i + j + 2]);
        b[i + 2 * j + 1] = mixed<2, 3, 10, 11, 6, 7, 14, 15>(a[i + j], a[i + j + 2]);
      }
    }
    HWY_UNROLL(4)
    for (int i = 0; i < 4; ++i) {
      x[i] = mixed<0, 1, 2, 3, 8, 9, 10, 11>(b[i], b[i + 4]);
      x[i + 4] = mixed<4, 5, 6, 7, 12, 13, 14, 15>(b[i], b[i + 4]);
    }
  }
}

/// Biorthogonal 1.5 along the rows, without its scaling (biorthogonal_matrix): every level adds and
/// subtracts.
template <class Vector>
HWY_INLINE void biorthogonal_forward(Vector (&x)[kPatch]) {
  constexpr float kCorrection = static_cast<float>(kBiorthogonalCorrection);
  Vector s0 = x[0] + x[1], s1 = x[2] + x[3], s2 = x[4] + x[5], s3 = x[6] + x[7];
  const Vector d0 = x[0] - x[1], d1 = x[2] - x[3], d2 = x[4] - x[5], d3 = x[6] - x[7];
  const Vector even = kCorrection * (d1 - d3), odd = kCorrection * (d2 - d0);
  s0 += even;
  s1 += odd;
  s2 -= even;
  s3 -= odd;
  const Vector low0 = s0 + s1, low1 = s2 + s3;
  x[0] = low0 + low1;
  x[1] = low0 - low1;
  x[2] = s0 - s1;
  x[3] = s2 - s3;
  x[4] = d0;
  x[5] = d1;
  x[6] = d2;
  x[7] = d3;
}

/// Its inverse for coefficients scaled by the squares of the forward norms.
template <class Vector>
HWY_INLINE void biorthogonal_inverse(Vector (&x)[kPatch]) {
  constexpr float kCorrection = static_cast<float>(kBiorthogonalCorrection);
  const Vector low0 = x[0] + x[1], low1 = x[0] - x[1];
  const Vector d0 = x[4], d1 = x[5], d2 = x[6], d3 = x[7];
  const Vector even = kCorrection * (d1 - d3), odd = kCorrection * (d2 - d0);
  const Vector s0 = low0 + x[2] - even, s1 = low0 - x[2] - odd;
  const Vector s2 = low1 + x[3] + even, s3 = low1 - x[3] + odd;
  x[0] = s0 + d0;
  x[1] = s0 - d0;
  x[2] = s1 + d1;
  x[3] = s1 - d1;
  x[4] = s2 + d2;
  x[5] = s2 - d2;
  x[6] = s3 + d3;
  x[7] = s3 - d3;
}

/// cos(k π / 16) where the fast DCT needs it. Arai, Agui, Nakajima, "A fast DCT-SQ scheme for
/// images", Trans. IEICE E71, 1988: five products, each output scaled (dct_norm).
constexpr float kC4 = 0.70710678F, kC6 = 0.38268343F, kC2MinusC6 = 0.54119610F,
                kC2PlusC6 = 1.30656296F, kRoot2 = 1.41421356F, kTwiceC2 = 1.84775907F,
                kTwiceC2MinusC6 = 1.08239220F, kTwiceC2PlusC6 = 2.61312593F;

template <class Vector>
HWY_INLINE void dct_forward(Vector (&x)[kPatch]) {
  const Vector s07 = x[0] + x[7], d07 = x[0] - x[7], s16 = x[1] + x[6], d16 = x[1] - x[6];
  const Vector s25 = x[2] + x[5], d25 = x[2] - x[5], s34 = x[3] + x[4], d34 = x[3] - x[4];
  const Vector outer = s07 + s34, outer_d = s07 - s34, inner = s16 + s25, inner_d = s16 - s25;
  const Vector turn = kC4 * (inner_d + outer_d);
  x[0] = outer + inner;
  x[4] = outer - inner;
  x[2] = outer_d + turn;
  x[6] = outer_d - turn;
  const Vector e = d34 + d25, f = d25 + d16, g = d16 + d07;
  const Vector shared = kC6 * (e - g), z2 = kC2MinusC6 * e + shared, z4 = kC2PlusC6 * g + shared;
  const Vector z3 = kC4 * f, plus = d07 + z3, minus = d07 - z3;
  x[5] = minus + z2;
  x[3] = minus - z2;
  x[1] = plus + z4;
  x[7] = plus - z4;
}

/// Its inverse: for dct_forward's outputs times 1/8.
template <class Vector>
HWY_INLINE void dct_inverse(Vector (&x)[kPatch]) {
  const Vector s04 = x[0] + x[4], d04 = x[0] - x[4], s26 = x[2] + x[6];
  const Vector d26 = kRoot2 * (x[2] - x[6]) - s26;
  const Vector e0 = s04 + s26, e3 = s04 - s26, e1 = d04 + d26, e2 = d04 - d26;
  const Vector s53 = x[5] + x[3], d53 = x[5] - x[3], s17 = x[1] + x[7], d17 = x[1] - x[7];
  const Vector o7 = s17 + s53, turned = kRoot2 * (s17 - s53);
  const Vector shared = kTwiceC2 * (d53 + d17);
  const Vector o6 = shared - kTwiceC2PlusC6 * d53 - o7, o5 = turned - o6;
  const Vector o4 = shared - kTwiceC2MinusC6 * d17 - o5;
  x[0] = e0 + o7;
  x[7] = e0 - o7;
  x[1] = e1 + o6;
  x[6] = e1 - o6;
  x[2] = e2 + o5;
  x[5] = e2 - o5;
  x[3] = e3 + o4;
  x[4] = e3 - o4;
}

/// Across the eight vectors, lane by lane; kDct: else biorthogonal.
template <bool kDct, class Vector>
HWY_INLINE void forward(Vector (&x)[kPatch]) {
  if constexpr (kDct)
    dct_forward(x);
  else
    biorthogonal_forward(x);
}

template <bool kDct, class Vector>
HWY_INLINE void inverse(Vector (&x)[kPatch]) {
  if constexpr (kDct)
    dct_inverse(x);
  else
    biorthogonal_inverse(x);
}

/// Sum and difference of a vector's two blocks.
HWY_INLINE void butterfly_inside(Floats& v) {
  const Floats8 first = low_half(v), second = high_half(v);
  v = joined(first + second, first - second);
}

/// Unscaled Haar transform along the group: over the pairs, which is two transforms of half a group
/// each, then between the two averages unless there is only one block. v[0] receives the group's
/// sum and the coarsest difference, v[i] the difference between sums of lowest_bit(i) blocks.
template <int kPairs, bool kSingle>
HWY_INLINE void haar_forward(Floats (&v)[kPairs]) {
  HWY_UNROLL(4)
  for (int span = 1; span < kPairs; span *= 2) {
    HWY_UNROLL(8)
    for (int i = 0; i < kPairs; i += 2 * span) {
      const Floats a = v[i], b = v[i + span];
      v[i] = a + b;
      v[i + span] = a - b;
    }
  }
  if constexpr (!kSingle) butterfly_inside(v[0]);
}

/// Its inverse for coefficients divided by squared_norm.
template <int kPairs, bool kSingle>
HWY_INLINE void haar_inverse(Floats (&v)[kPairs]) {
  if constexpr (!kSingle) butterfly_inside(v[0]);
  HWY_UNROLL(4)
  for (int span = kPairs / 2; span > 0; span /= 2) {
    HWY_UNROLL(8)
    for (int i = 0; i < kPairs; i += 2 * span) {
      const Floats a = v[i], b = v[i + span];
      v[i] = a + b;
      v[i + span] = a - b;
    }
  }
}

/// What unscaled coefficients of v[i] are above orthonormal ones, squared.
template <int kPairs, bool kSingle>
constexpr float squared_norm(int i) {
  return static_cast<float>(i == 0 ? (kSingle ? 1 : 2 * kPairs) : 2 * (i & -i));
}
