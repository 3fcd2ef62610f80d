#include "malus/synthesize/internal/level_kernel.h"

#include "malus/synthesize/internal/scalar_formation.h"
#include "malus/synthesize/internal/vector_targets.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/synthesize/level_kernel.cpp"
#include <hwy/foreach_target.h>  // keep first
#include <hwy/highway.h>
// once per target
#include "malus/synthesize/internal/vector_words-inl.h"

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#if HWY_TARGET != HWY_SCALAR

#define MALUS_FORMATION HWY_INLINE
#include "malus/synthesize/internal/level_formation-inl.h"
#undef MALUS_FORMATION

// The pixels of a whole group.
HWY_INLINE void run_group(const LevelRowJob& job, const GroupWords& words, int phase,
                          const float* signal_dn, const float* base_dn, float* out_dn) {
  using A = Arithmetic;
  const LevelRowLanes& p = job.lanes;
  const Floats d;
  const Words w;
  for (int place = 0; place < kGroupColumns; place += kLanes) {
    const int at = phase + place;
    const LevelLanes<A> lanes{
        {hn::LoadU(d, p.guess_start_dn + at)},  {hn::LoadU(d, p.guesses_per_dn + at)},
        {hn::LoadU(w, p.first_guess + at)},     {hn::LoadU(w, p.first_span + at)},
        {hn::LoadU(w, p.last_span + at)},       {hn::LoadU(w, p.bins + at)},
        {hn::LoadU(w, p.first_cell + at)},      {hn::LoadU(w, p.first_place + at)},
        {hn::LoadU(w, p.places_per_level + at)}};
    const Real signal{hn::LoadU(d, signal_dn + place)}, base{hn::LoadU(d, base_dn + place)};
    const Truth usable = A::both(A::finite(signal), A::finite(base));
    const Real noise =
        level_noise<A>(job.tables, A::select(usable, signal, lanes.guess_start_dn), lanes,
                       {hn::Load(w, words.shot + place)}, {hn::Load(w, words.read + place)});
    const Real noisy = base + noise + Real{hn::LoadU(d, p.offset_dn + at)};
    hn::StoreU(A::select(usable, noisy, base).v, d, out_dn + place);
  }
}

#else  // HWY_SCALAR

void run_group(const LevelRowJob& job, const GroupWords& words, int phase, const float* signal_dn,
               const float* base_dn, float* out_dn) {
  using A = scalar::Arithmetic;
  const LevelRowLanes& p = job.lanes;
  for (int place = 0; place < kGroupColumns; ++place) {
    const int at = phase + place;
    const scalar::LevelLanes<A> lanes{
        p.guess_start_dn[at], p.guesses_per_dn[at], p.first_guess[at],
        p.first_span[at],     p.last_span[at],      p.bins[at],
        p.first_cell[at],     p.first_place[at],    p.places_per_level[at]};
    const float signal = signal_dn[place], base = base_dn[place];
    out_dn[place] = A::finite(signal) && A::finite(base)
                        ? base +
                              scalar::level_noise<A>(job.tables, signal, lanes, words.shot[place],
                                                     words.read[place]) +
                              p.offset_dn[at]
                        : base;
  }
}

#endif

void run_level_row(const LevelRowJob& job) {
  RowWords row_words(job.seed, job.frame, job.row);
  for (ColumnGroup group(job); group.is_in_row(); group.advance()) {
    const GroupWords& words = row_words.of(group.number());
    const std::ptrdiff_t at = group.at();
    if (group.is_whole()) {
      run_group(job, words, group.phase(), job.signal_dn + at, job.base_dn + at, job.out_dn + at);
    } else {
      float signal[kGroupColumns] = {}, base[kGroupColumns] = {}, out[kGroupColumns];
      const int from = group.from(), to = group.to();
      std::copy(job.signal_dn + (at + from), job.signal_dn + (at + to), signal + from);
      std::copy(job.base_dn + (at + from), job.base_dn + (at + to), base + from);
      run_group(job, words, group.phase(), signal, base, out);
      std::copy(out + from, out + to, job.out_dn + (at + from));
    }
  }
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(run_level_row);

void run_level_row(const LevelRowJob& job) { HWY_DYNAMIC_DISPATCH(run_level_row)(job); }

}  // namespace malus::internal
#endif
