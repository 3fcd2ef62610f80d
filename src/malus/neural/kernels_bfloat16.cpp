// Products of values rounded to bfloat16 with sums in float32: in the processor's matrix unit, or
// by vdpbf16ps (AVX512_BF16), which takes two values of the inner dimension at once: twice the
// multiply-adds of a float32 instruction. Highway 1.0 has no target with it: intrinsics, chosen at
// run time.
#include "malus/base/error.h"
#include "malus/neural/internal/kernels.h"
#include "malus/neural/internal/matrix_unit.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <vector>

#include <hwy/base.h>

#if HWY_ARCH_X86_64
#include <immintrin.h>

HWY_PUSH_ATTRIBUTES("avx512f,avx512bw,avx512vl,avx512dq,avx512bf16")
namespace malus::internal::bfloat16 {
namespace {

struct Arithmetic {
  using Value = Bfloat16;
  using Vec = __m512;
  using Factor = __m512bh;
  static constexpr std::ptrdiff_t kWidth = kLane, kDepth = 2;

  static HWY_INLINE Vec zero() { return _mm512_setzero_ps(); }
  static HWY_INLINE Vec fill(float value) { return _mm512_set1_ps(value); }
  static HWY_INLINE Vec load(const float* from) { return _mm512_loadu_ps(from); }
  static HWY_INLINE void store(Vec value, float* to) { _mm512_storeu_ps(to, value); }
  static HWY_INLINE Vec add(Vec a, Vec b) { return _mm512_add_ps(a, b); }
  static HWY_INLINE Vec multiply(Vec a, Vec b) { return _mm512_mul_ps(a, b); }
  static HWY_INLINE Vec max(Vec a, Vec b) { return a > b ? a : b; }
  static HWY_INLINE Factor factors(const Bfloat16* from) {
    return (Factor)_mm512_loadu_si512(from);
  }
  static HWY_INLINE Factor spread(const Bfloat16* from) {
    std::int32_t pair;
    std::memcpy(&pair, from, sizeof pair);
    return (Factor)_mm512_set1_epi32(pair);
  }
  static HWY_INLINE Vec multiply_add(Factor a, Factor b, Vec sum) {
    return _mm512_dpbf16_ps(sum, a, b);
  }
};
#include "malus/neural/internal/product-inl.h"

void round_values(const float* from, std::ptrdiff_t count, Bfloat16* to) {
  std::ptrdiff_t i = 0;
  for (; i + 2 * kLane <= count; i += 2 * kLane)
    _mm512_storeu_si512(to + i, (__m512i)_mm512_cvtne2ps_pbh(_mm512_loadu_ps(from + i + kLane),
                                                             _mm512_loadu_ps(from + i)));
  for (; i < count; i += kLane) {
    const auto mask = static_cast<__mmask16>(0xFFFFU >> (kLane - std::min(kLane, count - i)));
    _mm256_mask_storeu_epi16(to + i, mask,
                             (__m256i)_mm512_cvtneps_pbh(_mm512_maskz_loadu_ps(mask, from + i)));
  }
}

// Memory of a thread for the rounded rows.
Bfloat16* rounding_memory(std::ptrdiff_t count) {
  thread_local std::vector<Bfloat16> memory;
  if (std::ssize(memory) < count) memory.resize(static_cast<std::size_t>(count));
  return memory.data();
}

void multiply_packed(const MatrixProduct& p, const Bfloat16* a, bool in_unit) {
  if (in_unit)
    multiply_in_matrix_unit(p, a);
  else
    multiply_parts(p, a, p.pairs);
}

void multiply_rounded_values(MatrixProduct p, bool in_unit) {
  if (p.rounded != nullptr) return multiply_packed(p, p.rounded, in_unit);
  const std::ptrdiff_t pitch = whole_depth(p.inner);
  if (!p.taps.empty() || (p.a_row == p.inner && p.inner == pitch)) {
    // Windows share values: what lies from the first to the last is rounded once.
    const std::ptrdiff_t last =
        p.taps.empty() ? 0 : *std::max_element(p.taps.begin(), p.taps.end());
    const std::ptrdiff_t count =
        (p.groups - 1) * p.a_group + (p.rows - 1) * p.a_row + last + p.inner;
    Bfloat16* a = rounding_memory(count + 1);
    round_values(p.a, count, a);
    a[count] = 0;
    multiply_packed(p, a, in_unit);
    return;
  }
  Bfloat16* a = rounding_memory(p.groups * p.rows * pitch);
  for (std::ptrdiff_t i = 0; i < p.groups * p.rows; ++i) {
    round_values(p.a + i / p.rows * p.a_group + i % p.rows * p.a_row, p.inner, a + i * pitch);
    if (pitch > p.inner) a[i * pitch + p.inner] = 0;
  }
  p.a_row = pitch;
  p.a_group = p.rows * pitch;
  multiply_packed(p, a, in_unit);
}

}  // namespace
}  // namespace malus::internal::bfloat16
HWY_POP_ATTRIBUTES

namespace malus::internal {
bool can_round_products() { return __builtin_cpu_supports("avx512bf16") != 0; }
bool rounded_products_pay() {
  return has_matrix_unit() || (can_round_products() && __builtin_cpu_is("amd") != 0);
}
void multiply_rounded(const MatrixProduct& product, bool in_unit) {
  MALUS_REQUIRE(can_round_products() && product.a_inner == 1 && product.b_inner == 0);
  bfloat16::multiply_rounded_values(product, in_unit);
}
void multiply_rounded(const MatrixProduct& product) {
  multiply_rounded(product, has_matrix_unit());
}
void round_values(const float* from, std::ptrdiff_t count, Bfloat16* to) {
  bfloat16::round_values(from, count, to);
}
}  // namespace malus::internal
#else
namespace malus::internal {
bool can_round_products() { return false; }
bool rounded_products_pay() { return false; }
void multiply_rounded(const MatrixProduct&, bool) { MALUS_REQUIRE(can_round_products()); }
void multiply_rounded(const MatrixProduct&) { MALUS_REQUIRE(can_round_products()); }
void round_values(const float*, std::ptrdiff_t, Bfloat16*) { MALUS_REQUIRE(can_round_products()); }
}  // namespace malus::internal
#endif

namespace malus::internal {

Bfloat16 rounded_to_bfloat16(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return static_cast<Bfloat16>((bits + 0x7FFFU + (bits >> 16 & 1U)) >> 16);
}

void pack_pairs(const float* b, std::ptrdiff_t taps, std::ptrdiff_t inner, std::ptrdiff_t cols,
                std::ptrdiff_t inner_stride, std::ptrdiff_t col_stride, Bfloat16* to,
                std::ptrdiff_t panel_cols) {
  if (panel_cols == 0) panel_cols = panel_of(cols);
  for (std::ptrdiff_t panel = 0; panel < cols; panel += panel_cols) {
    const std::ptrdiff_t count = std::min(panel_cols, cols - panel), width = whole_lanes(count);
    for (std::ptrdiff_t tap = 0; tap < taps; ++tap)
      for (std::ptrdiff_t k = 0; k < inner; k += 2, to += 2 * width)
        for (std::ptrdiff_t n = 0; n < 2 * width; ++n) {
          const bool outside = n / 2 >= count || k + n % 2 >= inner;
          const std::ptrdiff_t row = tap * inner + k + n % 2, col = panel + n / 2;
          to[n] =
              outside ? Bfloat16{0} : rounded_to_bfloat16(b[row * inner_stride + col * col_stride]);
        }
  }
}

}  // namespace malus::internal
