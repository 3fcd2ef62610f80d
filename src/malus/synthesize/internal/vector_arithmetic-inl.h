// The operations of formation-inl.h and level_formation-inl.h on vectors of floats, for the
// instruction set that highway compiles at the moment: included once for each, inside no namespace.
#if defined(MALUS_VECTOR_ARITHMETIC_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef MALUS_VECTOR_ARITHMETIC_INL_H_
#undef MALUS_VECTOR_ARITHMETIC_INL_H_
#else
#define MALUS_VECTOR_ARITHMETIC_INL_H_
#endif

#include "malus/synthesize/formation.h"

#include <cstdint>

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET != HWY_SCALAR

using Floats = hn::CappedTag<float, 16>;
using Words = hn::Rebind<std::uint32_t, Floats>;
using Pairs = hn::Repartition<std::uint64_t, Words>;
using WordVec = hn::Vec<Words>;
using FloatVec = hn::Vec<Floats>;
constexpr int kLanes = static_cast<int>(hn::MaxLanes(Floats()));

struct Truth {
  hn::Mask<Floats> m;
};
struct Real {
  FloatVec v;
  friend HWY_INLINE Real operator+(Real a, Real b) { return {hn::Add(a.v, b.v)}; }
  friend HWY_INLINE Real operator-(Real a, Real b) { return {hn::Sub(a.v, b.v)}; }
  friend HWY_INLINE Real operator*(Real a, Real b) { return {hn::Mul(a.v, b.v)}; }
  friend HWY_INLINE Real operator/(Real a, Real b) { return {hn::Div(a.v, b.v)}; }
  friend HWY_INLINE Truth operator<(Real a, Real b) { return {hn::Lt(a.v, b.v)}; }
  friend HWY_INLINE Truth operator>(Real a, Real b) { return {hn::Gt(a.v, b.v)}; }
};
struct Word {
  WordVec v;
  friend HWY_INLINE Word operator+(Word a, Word b) { return {hn::Add(a.v, b.v)}; }
  friend HWY_INLINE Word operator*(Word a, Word b) { return {hn::Mul(a.v, b.v)}; }
  friend HWY_INLINE Word operator&(Word a, Word b) { return {hn::And(a.v, b.v)}; }
};

// Reads table[index] as two floats each: one 64-bit load per lane is quicker than two gathers.
template <class D>
HWY_INLINE hn::Vec<D> load_pairs(D d, const double* table, const std::uint32_t* index) {
  if constexpr (hn::MaxLanes(d) == 1) {
    return hn::LoadU(d, table + *index);
  } else {
    const hn::Half<D> half;
    return hn::Combine(d, load_pairs(half, table, index + hn::MaxLanes(half)),
                       load_pairs(half, table, index));
  }
}

struct Arithmetic {
  using Real = HWY_NAMESPACE::Real;
  using Word = HWY_NAMESPACE::Word;
  using Truth = HWY_NAMESPACE::Truth;

  static HWY_INLINE Real real(float x) { return {hn::Set(Floats(), x)}; }
  static HWY_INLINE Word word(std::uint32_t x) { return {hn::Set(Words(), x)}; }
  static HWY_INLINE Real real_of(Word w) {  // exact for w < 2^31
    return {hn::ConvertTo(Floats(), hn::BitCast(hn::RebindToSigned<Words>(), w.v))};
  }
  static HWY_INLINE Real tail_position(Word w) {
    return real_of(w & word(0x7FFFFFFFu)) + real(0.5f);
  }
  static HWY_INLINE Word cell_of(Real x) {
    return {hn::ShiftRight<kTailShift>(hn::BitCast(Words(), x.v))};
  }
  static HWY_INLINE Real multiply_add(Real a, Real b, Real c) {
    return {hn::MulAdd(a.v, b.v, c.v)};
  }
  static HWY_INLINE Real sqrt(Real a) { return {hn::Sqrt(a.v)}; }
  static HWY_INLINE void root_and_reciprocal(Real m, Real& root, Real& reciprocal) {
    root = {hn::Sqrt(m.v)};
    reciprocal = real(1.0f) / m;
  }
  static HWY_INLINE Real floor(Real a) { return {hn::Floor(a.v)}; }
  static HWY_INLINE Real max(Real a, Real b) { return {hn::Max(a.v, b.v)}; }
  static HWY_INLINE Real select(Truth t, Real a, Real b) { return {hn::IfThenElse(t.m, a.v, b.v)}; }
  static HWY_INLINE Truth finite(Real a) {
    return {hn::Le(hn::Abs(a.v), hn::Set(Floats(), 3.4028234e38f))};
  }
  static HWY_INLINE bool none(Truth t) { return hn::AllFalse(Floats(), t.m); }
  static HWY_INLINE bool all(Truth t) { return hn::AllTrue(Floats(), t.m); }
  static HWY_INLINE Real add_where(Truth t, Real a, Real b) {
    return {hn::Add(a.v, hn::IfThenElseZero(t.m, b.v))};
  }
  static HWY_INLINE Real flip_sign_unless_top_bit(Real a, Word w) {
    const auto sign = hn::AndNot(w.v, hn::Set(Words(), 0x80000000u));
    return {hn::BitCast(Floats(), hn::Xor(hn::BitCast(Words(), a.v), sign))};
  }
  static HWY_INLINE Real select_top_bit(Word w, Real a, Real b) {
    return {hn::IfThenElse(
        hn::MaskFromVec(hn::BitCast(
            Floats(), hn::BroadcastSignBit(hn::BitCast(hn::RebindToSigned<Words>(), w.v)))),
        a.v, b.v)};
  }
  /// a 2^-n, n a whole number below 100.
  static HWY_INLINE Real scale_down(Real a, Real n) {
    const auto exponent = hn::ShiftLeft<23>(hn::ConvertTo(hn::RebindToSigned<Words>(), n.v));
    return {
        hn::BitCast(Floats(), hn::Sub(hn::BitCast(Words(), a.v), hn::BitCast(Words(), exponent)))};
  }
  /// Upper-half words with v < kShotTailWords.
  static HWY_INLINE Truth deep_upper_tail(Word w) {
    const hn::RebindToSigned<Words> d;
    // As signed numbers the upper half's words start at the lowest one.
    const auto shifted = hn::BitCast(d, w.v);
    const auto end = hn::Set(d, static_cast<std::int32_t>(0x80000000u + kShotTailWords));
    return {hn::RebindMask(Floats(), hn::Lt(shifted, end))};
  }
  static HWY_INLINE Truth both(Truth a, Truth b) { return {hn::And(a.m, b.m)}; }
  static HWY_INLINE Word truncated(Real a) {  // 0 <= a < 2^31
    return {hn::BitCast(Words(), hn::ConvertTo(hn::RebindToSigned<Words>(), a.v))};
  }
  static HWY_INLINE Real min(Real a, Real b) { return {hn::Min(a.v, b.v)}; }
  template <int kBits>
  static HWY_INLINE Word shifted_right(Word a) {
    return {hn::ShiftRight<kBits>(a.v)};
  }
  static HWY_INLINE Truth below(Word a, Word b) {
    return {hn::RebindMask(Floats(), hn::Lt(a.v, b.v))};
  }
  static HWY_INLINE Truth at_least(Real a, Real b) { return {hn::Ge(a.v, b.v)}; }
  static HWY_INLINE Word add_where(Truth t, Word a, Word b) {
    return {hn::Add(a.v, hn::IfThenElseZero(hn::RebindMask(Words(), t.m), b.v))};
  }
  static HWY_INLINE Word select(Truth t, Word a, Word b) {
    return {hn::IfThenElse(hn::RebindMask(Words(), t.m), a.v, b.v)};
  }
  /// The two halves of the 64-bit product.
  static HWY_INLINE void multiply_wide(Word a, Word b, Word& high, Word& low) {
    const auto even = hn::MulEven(a.v, b.v);
    const auto odd =
        hn::MulEven(hn::BitCast(Words(), hn::ShiftRight<32>(hn::BitCast(Pairs(), a.v))),
                    hn::BitCast(Words(), hn::ShiftRight<32>(hn::BitCast(Pairs(), b.v))));
    high = {hn::OddEven(hn::BitCast(Words(), odd), hn::BitCast(Words(), hn::ShiftRight<32>(even)))};
    low = {hn::OddEven(hn::BitCast(Words(), hn::ShiftLeft<32>(odd)), hn::BitCast(Words(), even))};
  }
  /// table[index], entries of two floats.
  template <class Entry>
  static HWY_INLINE void look_up(const Entry* table, Word index, Real& first, Real& second) {
    FloatVec low, high;
    load_entries(table, index, low, high);
    first = {hn::ConcatEven(Floats(), high, low)};
    second = {hn::ConcatOdd(Floats(), high, low)};
  }
  /// table[index], entries of two words.
  template <class Entry>
  static HWY_INLINE void look_up(const Entry* table, Word index, Word& first, Word& second) {
    FloatVec low, high;
    load_entries(table, index, low, high);
    first = {hn::BitCast(Words(), hn::ConcatEven(Floats(), high, low))};
    second = {hn::BitCast(Words(), hn::ConcatOdd(Floats(), high, low))};
  }
  static HWY_INLINE Word look_up(const std::uint32_t* table, Word index) {
    return {hn::GatherIndex(Words(), table, hn::BitCast(hn::RebindToSigned<Words>(), index.v))};
  }
  static HWY_NOINLINE Real shot_upper_tail_where(Truth t, Real mean, Word w, Real count) {
    HWY_ALIGN float m[kLanes], n[kLanes];
    HWY_ALIGN std::uint32_t words[kLanes];
    hn::Store(mean.v, Floats(), m);
    hn::Store(hn::IfThenElse(t.m, hn::Set(Floats(), -1.0f), count.v), Floats(), n);
    hn::Store(w.v, Words(), words);
    for (int i = 0; i < kLanes; ++i)
      if (n[i] < 0) n[i] = shot_upper_tail(m[i], words[i]);
    return {hn::Load(Floats(), n)};
  }

 private:
  // Entries of the lower half of the lanes, and of the upper half.
  template <class Entry>
  static HWY_INLINE void load_entries(const Entry* table, Word index, FloatVec& low,
                                      FloatVec& high) {
    static_assert(sizeof(Entry) == sizeof(double));
    HWY_ALIGN std::uint32_t at[kLanes];
    hn::Store(index.v, Words(), at);
    // Through memory: compilers else take the lanes out one by one, which costs twice as much.
    asm volatile("" : "+m"(at));
    const hn::Repartition<double, Floats> d;
    const auto* entries = reinterpret_cast<const double*>(table);
    low = hn::BitCast(Floats(), load_pairs(d, entries, at));
    high = hn::BitCast(Floats(), load_pairs(d, entries, at + kLanes / 2));
  }
};

#endif  // HWY_TARGET != HWY_SCALAR

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif  // per target
