// formation-inl.h and level_formation-inl.h for one pixel at a time: the twin that vector kernels
// are compared with, and that runs where no vector unit with fused multiply-add exists.
#pragma once

#include "malus/synthesize/formation.h"
#include "malus/synthesize/level_tables.h"

#include <bit>
#include <cmath>

namespace malus::scalar {

#define MALUS_FORMATION inline

struct Arithmetic {
  using Real = float;
  using Word = std::uint32_t;
  using Truth = bool;

  static Real real(float x) { return x; }
  static Word word(std::uint32_t x) { return x; }
  static Real real_of(Word w) { return static_cast<float>(w); }
  static Real tail_position(Word w) { return real_of(w & 0x7FFFFFFFu) + 0.5f; }
  static Word bits_of(Real x) { return std::bit_cast<Word>(x); }
  static Real from_bits(Word w) { return std::bit_cast<Real>(w); }
  static Word cell_of(Real x) { return bits_of(x) >> kTailShift; }
  static Real multiply_add(Real a, Real b, Real c) { return ::fmaf(a, b, c); }
  static Real sqrt(Real a) { return ::sqrtf(a); }
  static void root_and_reciprocal(Real m, Real& root, Real& reciprocal) {
    root = ::sqrtf(m);
    reciprocal = 1.0f / m;
  }
  static Real floor(Real a) { return ::floorf(a); }
  static Real max(Real a, Real b) { return a > b ? a : b; }
  static Real select(Truth t, Real a, Real b) { return t ? a : b; }
  static Truth finite(Real a) { return ::fabsf(a) <= 3.4028234e38f; }
  static bool none(Truth t) { return !t; }
  static bool all(Truth t) { return t; }
  static Truth both(Truth a, Truth b) { return a && b; }
  static Real add_where(Truth t, Real a, Real b) { return t ? a + b : a; }
  static Real flip_sign_unless_top_bit(Real a, Word w) { return w & 0x80000000u ? a : -a; }
  static Real select_top_bit(Word w, Real a, Real b) { return w & 0x80000000u ? a : b; }
  static Real scale_down(Real a, Real n) {
    return from_bits(bits_of(a) - (static_cast<Word>(n) << 23));
  }
  static Truth deep_upper_tail(Word w) { return w - 0x80000000u < kShotTailWords; }
  static void look_up(const TailLine* lines, Word index, Real& a, Real& b) {
    a = lines[index].a;
    b = lines[index].b;
  }
  static Word truncated(Real a) { return static_cast<Word>(a); }
  static Real min(Real a, Real b) { return a < b ? a : b; }
  template <int kBits>
  static Word shifted_right(Word a) {
    return a >> kBits;
  }
  static Truth below(Word a, Word b) { return a < b; }
  static Truth at_least(Real a, Real b) { return a >= b; }
  static Word add_where(Truth t, Word a, Word b) { return t ? a + b : a; }
  static Word select(Truth t, Word a, Word b) { return t ? a : b; }
  static void multiply_wide(Word a, Word b, Word& high, Word& low) {
    const std::uint64_t product = std::uint64_t{a} * b;
    high = static_cast<Word>(product >> 32);
    low = static_cast<Word>(product);
  }
  static Word look_up(const Word* table, Word index) { return table[index]; }
  static void look_up(const LevelSpan* table, Word index, Real& a, Real& b) {
    a = table[index].low_dn;
    b = table[index].high_dn;
  }
  static void look_up(const BinPlace* table, Word index, Real& a, Real& b) {
    a = table[index].start_dn;
    b = table[index].width_dn;
  }
  static void look_up(const AliasCell* table, Word index, Word& a, Word& b) {
    a = table[index].threshold;
    b = table[index].alias;
  }
  static Real shot_upper_tail_where(Truth t, Real mean, Word w, Real count) {
    return t ? shot_upper_tail(mean, w) : count;
  }
};

#include "malus/synthesize/formation-inl.h"
#include "malus/synthesize/internal/level_formation-inl.h"

#undef MALUS_FORMATION

}  // namespace malus::scalar
