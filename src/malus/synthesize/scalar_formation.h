// formation-inl.h and level_formation-inl.h for one pixel at a time: the twin that vector kernels
// are compared with, that runs where no vector unit with fused multiply-add exists, and that CUDA
// compiles.
#pragma once

#include "malus/synthesize/formation.h"
#include "malus/synthesize/level_tables.h"

#if !defined(__CUDACC__)
#include <bit>
#include <cmath>
#endif

namespace malus::scalar {

#define MALUS_FORMATION MALUS_HOST_DEVICE inline

struct Arithmetic {
  using Real = float;
  using Word = std::uint32_t;
  using Truth = bool;

  MALUS_HOST_DEVICE static Real real(float x) { return x; }
  MALUS_HOST_DEVICE static Word word(std::uint32_t x) { return x; }
  MALUS_HOST_DEVICE static Real real_of(Word w) { return static_cast<float>(w); }
  MALUS_HOST_DEVICE static Real tail_position(Word w) { return real_of(w & 0x7FFFFFFFu) + 0.5f; }
  MALUS_HOST_DEVICE static Word bits_of(Real x) {
#if defined(__CUDA_ARCH__)
    return __float_as_uint(x);
#else
    return std::bit_cast<Word>(x);
#endif
  }
  MALUS_HOST_DEVICE static Real from_bits(Word w) {
#if defined(__CUDA_ARCH__)
    return __uint_as_float(w);
#else
    return std::bit_cast<Real>(w);
#endif
  }
  MALUS_HOST_DEVICE static Word cell_of(Real x) { return bits_of(x) >> kTailShift; }
  MALUS_HOST_DEVICE static Real multiply_add(Real a, Real b, Real c) { return ::fmaf(a, b, c); }
  MALUS_HOST_DEVICE static Real sqrt(Real a) { return ::sqrtf(a); }
  MALUS_HOST_DEVICE static void root_and_reciprocal(Real m, Real& root, Real& reciprocal) {
    root = ::sqrtf(m);
    reciprocal = 1.0f / m;
  }
  MALUS_HOST_DEVICE static Real floor(Real a) { return ::floorf(a); }
  MALUS_HOST_DEVICE static Real max(Real a, Real b) { return a > b ? a : b; }
  MALUS_HOST_DEVICE static Real select(Truth t, Real a, Real b) { return t ? a : b; }
  MALUS_HOST_DEVICE static Truth finite(Real a) { return ::fabsf(a) <= 3.4028234e38f; }
  MALUS_HOST_DEVICE static bool none(Truth t) { return !t; }
  MALUS_HOST_DEVICE static bool all(Truth t) { return t; }
  MALUS_HOST_DEVICE static Truth both(Truth a, Truth b) { return a && b; }
  MALUS_HOST_DEVICE static Real add_where(Truth t, Real a, Real b) { return t ? a + b : a; }
  MALUS_HOST_DEVICE static Real flip_sign_unless_top_bit(Real a, Word w) {
    return w & 0x80000000u ? a : -a;
  }
  MALUS_HOST_DEVICE static Real select_top_bit(Word w, Real a, Real b) {
    return w & 0x80000000u ? a : b;
  }
  MALUS_HOST_DEVICE static Real scale_down(Real a, Real n) {
    return from_bits(bits_of(a) - (static_cast<Word>(n) << 23));
  }
  MALUS_HOST_DEVICE static Truth deep_upper_tail(Word w) {
    return w - 0x80000000u < kShotTailWords;
  }
  MALUS_HOST_DEVICE static void look_up(const TailLine* lines, Word index, Real& a, Real& b) {
#if defined(__CUDA_ARCH__)
    // One load of eight bytes through the read-only cache; device memory is aligned well enough.
    const float2 line = __ldg(reinterpret_cast<const float2*>(lines) + index);
    a = line.x;
    b = line.y;
#else
    a = lines[index].a;
    b = lines[index].b;
#endif
  }
  MALUS_HOST_DEVICE static Word truncated(Real a) { return static_cast<Word>(a); }
  MALUS_HOST_DEVICE static Real min(Real a, Real b) { return a < b ? a : b; }
  template <int kBits>
  MALUS_HOST_DEVICE static Word shifted_right(Word a) {
    return a >> kBits;
  }
  MALUS_HOST_DEVICE static Truth below(Word a, Word b) { return a < b; }
  MALUS_HOST_DEVICE static Truth at_least(Real a, Real b) { return a >= b; }
  MALUS_HOST_DEVICE static Word add_where(Truth t, Word a, Word b) { return t ? a + b : a; }
  MALUS_HOST_DEVICE static Word select(Truth t, Word a, Word b) { return t ? a : b; }
  MALUS_HOST_DEVICE static void multiply_wide(Word a, Word b, Word& high, Word& low) {
    const std::uint64_t product = std::uint64_t{a} * b;
    high = static_cast<Word>(product >> 32);
    low = static_cast<Word>(product);
  }
  MALUS_HOST_DEVICE static Word look_up(const Word* table, Word index) { return table[index]; }
  MALUS_HOST_DEVICE static void look_up(const LevelSpan* table, Word index, Real& a, Real& b) {
    a = table[index].low_dn;
    b = table[index].high_dn;
  }
  MALUS_HOST_DEVICE static void look_up(const BinPlace* table, Word index, Real& a, Real& b) {
    a = table[index].start_dn;
    b = table[index].width_dn;
  }
  MALUS_HOST_DEVICE static void look_up(const AliasCell* table, Word index, Word& a, Word& b) {
    a = table[index].threshold;
    b = table[index].alias;
  }
  MALUS_HOST_DEVICE static Real shot_upper_tail_where(Truth t, Real mean, Word w, Real count) {
    return t ? shot_upper_tail(mean, w) : count;
  }
};

#include "malus/synthesize/formation-inl.h"
#include "malus/synthesize/level_formation-inl.h"

#undef MALUS_FORMATION

}  // namespace malus::scalar
