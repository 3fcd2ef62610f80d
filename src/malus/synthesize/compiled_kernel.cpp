#include "malus/synthesize/compiled_kernel.h"

#include "malus/synthesize/internal/scalar_formation.h"
#include "malus/synthesize/internal/vector_targets.h"

#include <algorithm>
#include <cmath>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/synthesize/compiled_kernel.cpp"
#include <hwy/foreach_target.h>  // keep first
#include <hwy/highway.h>
// once per target
#include "malus/synthesize/internal/vector_words-inl.h"

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#if HWY_TARGET != HWY_SCALAR

#define MALUS_FORMATION HWY_INLINE
#include "malus/synthesize/formation-inl.h"
#undef MALUS_FORMATION

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
HWY_INLINE void run_group(const RowJob& job, const GroupWords& words, int phase, const In* in,
                          Out* out) {
  const RowLanes& p = job.lanes;
  const Floats d;
  for (int place = 0; place < kGroupColumns; place += kLanes) {
    const int at = phase + place;
    const ChannelLanes<Arithmetic> lanes{
        {hn::LoadU(d, p.gain_dn + at)},      {hn::LoadU(d, p.electrons_per_dn + at)},
        {hn::LoadU(d, p.variance_dn2 + at)}, {hn::LoadU(d, p.scale_dn + at)},
        {hn::LoadU(d, p.offset_dn + at)},    {hn::LoadU(Words(), p.first_line + at)}};
    const Real noisy = noisy_pixel<Arithmetic>({load_pixels(in + place, p.black_dn + at)}, lanes,
                                               job.tables, {hn::Load(Words(), words.shot + place)},
                                               {hn::Load(Words(), words.read + place)});
    store_pixels(noisy.v, job, p.black_dn + at, out + place);
  }
}

#else  // HWY_SCALAR

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
void run_group(const RowJob& job, const GroupWords& words, int phase, const In* in, Out* out) {
  using A = scalar::Arithmetic;
  const RowLanes& p = job.lanes;
  for (int place = 0; place < kGroupColumns; ++place) {
    const int at = phase + place;
    const scalar::ChannelLanes<A> lanes{p.gain_dn[at],  p.electrons_per_dn[at], p.variance_dn2[at],
                                        p.scale_dn[at], p.offset_dn[at],        p.first_line[at]};
    store_pixel(scalar::noisy_pixel<A>(load_pixel(in + place, p.black_dn[at]), lanes, job.tables,
                                       words.shot[place], words.read[place]),
                job, p.black_dn[at], out + place);
  }
}

#endif

template <class In, class Out>
void run_columns(const RowJob& job) {
  const auto* in = static_cast<const In*>(job.in);
  auto* out = static_cast<Out*>(job.out);
  RowWords row_words(job.seed, job.frame, job.row);
  for (ColumnGroup group(job); group.is_in_row(); group.advance()) {
    const GroupWords& words = row_words.of(group.number());
    const std::ptrdiff_t at = group.at();
    if (group.is_whole()) {
      run_group(job, words, group.phase(), in + at, out + at);
    } else {
      In in_group[kGroupColumns] = {};
      Out out_group[kGroupColumns];
      const int from = group.from(), to = group.to();
      std::copy(in + (at + from), in + (at + to), in_group + from);
      run_group(job, words, group.phase(), in_group, out_group);
      std::copy(out_group + from, out_group + to, out + (at + from));
    }
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
