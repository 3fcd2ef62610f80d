#include "malus/synthesize/compiled_kernel.h"

#include "malus/synthesize/scalar_formation.h"

#include <cmath>
#include <cstring>

// Wrappers with operators need vector types of known size, and one rounding per multiply-add needs
// a fused unit: older x86 and all else run the scalar twin.
#define HWY_DISABLED_TARGETS \
  (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV | HWY_SSSE3 | HWY_SSE4 | HWY_EMU128)
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/synthesize/compiled_kernel.cpp"
#include <hwy/foreach_target.h>  // keep first
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

#if HWY_TARGET != HWY_SCALAR

#define MALUS_FORMATION HWY_INLINE

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
struct Shift {
  int bits;
};
struct Word {
  WordVec v;
  friend HWY_INLINE Word operator+(Word a, Word b) { return {hn::Add(a.v, b.v)}; }
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
  static HWY_INLINE void look_up(const TailLine* lines, Word index, Real& a, Real& b) {
    HWY_ALIGN std::uint32_t at[kLanes];
    hn::Store(index.v, Words(), at);
    const hn::Repartition<double, Floats> d;
    const auto* table = reinterpret_cast<const double*>(lines);
    const auto low = hn::BitCast(Floats(), load_pairs(d, table, at));
    const auto high = hn::BitCast(Floats(), load_pairs(d, table, at + kLanes / 2));
    a = {hn::ConcatEven(Floats(), high, low)};
    b = {hn::ConcatOdd(Floats(), high, low)};
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
};

#include "malus/synthesize/formation-inl.h"

#undef MALUS_FORMATION

// Philox on 64-bit lanes: the low half of each holds a word, what lies above is never read. Half as
// many blocks as float lanes.
struct Counters {
  hn::Vec<Pairs> word[4];
};

HWY_INLINE Counters philox(Counters x, std::uint64_t key) {
  const Pairs d;
  const auto multiplier0 = hn::Set(d, 0xD2511F53u), multiplier1 = hn::Set(d, 0xCD9E8D57u);
  auto key0 = static_cast<std::uint32_t>(key), key1 = static_cast<std::uint32_t>(key >> 32);
  const Words w;
  for (int round = 0; round < 10; ++round) {
    const auto product0 = hn::MulEven(hn::BitCast(w, x.word[0]), hn::BitCast(w, multiplier0));
    const auto product1 = hn::MulEven(hn::BitCast(w, x.word[2]), hn::BitCast(w, multiplier1));
    x.word[0] = hn::Xor(hn::Xor(hn::ShiftRight<32>(product1), x.word[1]), hn::Set(d, key0));
    x.word[2] = hn::Xor(hn::Xor(hn::ShiftRight<32>(product0), x.word[3]), hn::Set(d, key1));
    x.word[1] = product1;
    x.word[3] = product0;
    key0 += 0x9E3779B9u;
    key1 += 0xBB67AE85u;
  }
  return x;
}

// The four words of kLanes blocks whose numbers start at `first` (same words as random_block).
HWY_INLINE void random_words(std::uint64_t seed, std::uint32_t frame, int row, std::uint32_t first,
                             WordVec (&word)[4]) {
  const Pairs d;
  const auto even = hn::Add(hn::Set(d, first), hn::ShiftLeft<1>(hn::Iota(d, 0)));
  Counters x;
  x.word[1] = hn::Set(d, static_cast<std::uint32_t>(row));
  x.word[2] = hn::Set(d, frame);
  x.word[3] = hn::Set(d, static_cast<std::uint32_t>(Draw::kPixel) << 24);
  x.word[0] = even;
  const Counters a = philox(x, seed);
  x.word[0] = hn::Add(even, hn::Set(d, 1));
  const Counters b = philox(x, seed);
  for (int i = 0; i < 4; ++i)
    word[i] = hn::OddEven(hn::BitCast(Words(), hn::ShiftLeft<32>(b.word[i])),
                          hn::BitCast(Words(), a.word[i]));
}

HWY_INLINE FloatVec load_pixels(const float* in, const float*) { return hn::LoadU(Floats(), in); }
HWY_INLINE FloatVec load_pixels(const std::uint16_t* in, const float* black_dn) {
  const hn::Rebind<std::uint16_t, Floats> d16;
  const hn::RebindToSigned<Words> d32;
  return hn::Sub(hn::ConvertTo(Floats(), hn::PromoteTo(d32, hn::LoadU(d16, in))),
                 hn::LoadU(Floats(), black_dn));
}
HWY_INLINE void store_pixels(FloatVec dn, const RowJob&, const float*, float* out) {
  hn::StoreU(dn, Floats(), out);
}
// As the camera writes it: black back, rounded to the step, clipped; NaN becomes 0.
HWY_INLINE void store_pixels(FloatVec dn, const RowJob& job, const float* black_dn,
                             std::uint16_t* out) {
  const Floats d;
  const auto step = hn::Set(d, job.step_dn);
  auto raw = hn::Add(dn, hn::LoadU(d, black_dn));
  raw = hn::Mul(hn::Round(hn::Div(raw, step)), step);
  // Maximum first: its second operand wins against NaN on every instruction set but NEON, so NaN is
  // put aside by hand.
  raw = hn::IfThenElseZero(hn::Eq(raw, raw), raw);
  raw = hn::Min(hn::Max(raw, hn::Zero(d)), hn::Set(d, job.white_dn));
  const hn::Rebind<std::uint16_t, Floats> d16;
  hn::StoreU(hn::DemoteTo(d16, hn::ConvertTo(hn::RebindToSigned<Words>(), raw)), d16, out);
}

template <class In, class Out>
HWY_INLINE void run_group(const RowJob& job, int group, int phase, const In* in, Out* out) {
  const RowLanes& p = job.lanes;
  for (int first = 0; first < 16; first += kLanes) {
    WordVec word[4];
    random_words(job.seed, job.frame, job.row, static_cast<std::uint32_t>(16 * group + first),
                 word);
    for (int half = 0; half < 2; ++half) {
      const int place = 16 * half + first, at = phase + place;
      const Floats d;
      const ChannelLanes<Arithmetic> lanes{
          {hn::LoadU(d, p.gain_dn + at)},      {hn::LoadU(d, p.electrons_per_dn + at)},
          {hn::LoadU(d, p.variance_dn2 + at)}, {hn::LoadU(d, p.scale_dn + at)},
          {hn::LoadU(d, p.offset_dn + at)},    {hn::LoadU(Words(), p.first_line + at)}};
      const Real noisy =
          noisy_pixel<Arithmetic>({load_pixels(in + place, p.black_dn + at)}, lanes, job.tables,
                                  {word[2 * half]}, {word[2 * half + 1]});
      store_pixels(noisy.v, job, p.black_dn + at, out + place);
    }
  }
}

void group_words(std::uint64_t seed, std::uint32_t frame, int row, int group, std::uint32_t* shot,
                 std::uint32_t* read) {
  for (int first = 0; first < 16; first += kLanes) {
    WordVec word[4];
    random_words(seed, frame, row, static_cast<std::uint32_t>(16 * group + first), word);
    for (int half = 0; half < 2; ++half) {
      hn::StoreU(word[2 * half], Words(), shot + 16 * half + first);
      hn::StoreU(word[2 * half + 1], Words(), read + 16 * half + first);
    }
  }
}

#else  // HWY_SCALAR

void group_words(std::uint64_t seed, std::uint32_t frame, int row, int group, std::uint32_t* shot,
                 std::uint32_t* read) {
  for (int place = 0; place < kGroupColumns; ++place) {
    const PixelWords words = pixel_words(seed, frame, row, group * kGroupColumns + place);
    shot[place] = words.shot;
    read[place] = words.read;
  }
}

float load_pixel(const float* in, float) { return *in; }
float load_pixel(const std::uint16_t* in, float black_dn) {
  return static_cast<float>(*in) - black_dn;
}
void store_pixel(float dn, const RowJob&, float, float* out) { *out = dn; }
void store_pixel(float dn, const RowJob& job, float black_dn, std::uint16_t* out) {
  float raw = std::nearbyint((dn + black_dn) / job.step_dn) * job.step_dn;
  raw = raw > 0.0f ? raw : 0.0f;  // NaN too
  *out = static_cast<std::uint16_t>(std::nearbyint(raw < job.white_dn ? raw : job.white_dn));
}

template <class In, class Out>
void run_group(const RowJob& job, int group, int phase, const In* in, Out* out) {
  using A = scalar::Arithmetic;
  const RowLanes& p = job.lanes;
  for (int place = 0; place < kGroupColumns; ++place) {
    const int at = phase + place;
    const PixelWords words =
        pixel_words(job.seed, job.frame, job.row, group * kGroupColumns + place);
    const scalar::ChannelLanes<A> lanes{p.gain_dn[at],  p.electrons_per_dn[at], p.variance_dn2[at],
                                        p.scale_dn[at], p.offset_dn[at],        p.first_line[at]};
    store_pixel(scalar::noisy_pixel<A>(load_pixel(in + place, p.black_dn[at]), lanes, job.tables,
                                       words.shot, words.read),
                job, p.black_dn[at], out + place);
  }
}

#endif

template <class In, class Out>
void run_columns(const RowJob& job) {
  const auto* in = static_cast<const In*>(job.in);
  auto* out = static_cast<Out*>(job.out);
  const int end = job.col0 + job.cols;
  int group = job.col0 / kGroupColumns;
  int phase = group * kGroupColumns % job.lanes.period;
  for (; group * kGroupColumns < end; ++group) {
    const int start = group * kGroupColumns;
    if (start >= job.col0 && start + kGroupColumns <= end) {
      run_group(job, group, phase, in + (start - job.col0), out + (start - job.col0));
    } else {  // the view ends inside this group
      In in_group[kGroupColumns] = {};
      Out out_group[kGroupColumns];
      const int from = start > job.col0 ? start : job.col0;
      const int to = start + kGroupColumns < end ? start + kGroupColumns : end;
      const auto count = static_cast<std::size_t>(to - from);
      std::memcpy(in_group + (from - start), in + (from - job.col0), count * sizeof(In));
      run_group(job, group, phase, in_group, out_group);
      std::memcpy(out + (from - job.col0), out_group + (from - start), count * sizeof(Out));
    }
    phase += kGroupColumns;
    if (phase == job.lanes.period) phase = 0;
  }
}

void run_row(const RowJob& job) {
  if (job.in_u16)
    job.out_u16 ? run_columns<std::uint16_t, std::uint16_t>(job)
                : run_columns<std::uint16_t, float>(job);
  else
    job.out_u16 ? run_columns<float, std::uint16_t>(job) : run_columns<float, float>(job);
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(run_row);
HWY_EXPORT(group_words);

void group_words(std::uint64_t seed, std::uint32_t frame, int row, int group, std::uint32_t* shot,
                 std::uint32_t* read) {
  HWY_DYNAMIC_DISPATCH(group_words)(seed, frame, row, group, shot, read);
}

void run_row(const RowJob& job) { HWY_DYNAMIC_DISPATCH(run_row)(job); }

std::string kernel_target() {
  const auto targets = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(static_cast<std::int64_t>(targets & -targets));
}

std::vector<std::string> kernel_targets() {
  std::vector<std::string> names;
  for (const auto target : hwy::SupportedAndGeneratedTargets())
    names.push_back(hwy::TargetName(target));
  return names;
}

void force_kernel_target(const std::string& name) {
  hwy::SetSupportedTargetsForTest(0);
  if (name.empty()) return;
  for (const auto target : hwy::SupportedAndGeneratedTargets())
    if (name == hwy::TargetName(target)) hwy::SetSupportedTargetsForTest(target);
}

}  // namespace malus::internal
#endif
