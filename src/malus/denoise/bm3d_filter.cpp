// Collaborative filtering of groups: transform of each block along its rows (its columns are
// transformed already, bm3d_spectra.cpp), Haar transform along the group, shrinkage, and back. Two
// blocks lie side by side in a vector of 16 floats, one coefficient of their columns per lane.
// Vectors are 16 floats on every machine, in as many registers as it needs, so all machines compute
// the same. What goes back is what the filter takes away, so that a group from which nothing is
// taken leaves its pixels as they are, to the bit.
#include "malus/base/vector_targets.h"
#include "malus/denoise/internal/bm3d_stage.h"
#include "malus/denoise/internal/bm3d_transform.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/bm3d_filter.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

#ifndef MALUS_BM3D_FILTER_ONCE
#define MALUS_BM3D_FILTER_ONCE
namespace malus::internal {
struct FilterKernelJob {
  const BlockGroup* groups;
  std::size_t count;
  FilterTarget target;
  const GroupFilter::Tables* tables;
};
}  // namespace malus::internal
#endif

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#include "malus/denoise/internal/wide-inl.h"
// After wide-inl.h.
#include "malus/denoise/internal/bm3d_transforms-inl.h"

HWY_INLINE float sum_lanes(const Floats& v, int lanes) {
  float values[2 * kPatch];
  store(v, values);
  float sum = 0;
  for (int i = 0; i < lanes; ++i) sum += values[i];
  return sum;
}

/// A block's first float among the spectra.
HWY_INLINE std::ptrdiff_t spectra_of(std::int32_t place) { return std::ptrdiff_t{place} * kPatch; }

HWY_INLINE void add_row(const Floats8& weighted, float* residual) {
  Floats8 sum;
  load(residual, sum);
  sum += weighted;
  store(sum, residual);
}

/// Back along the rows of one block, and aggregation.
template <bool kWiener>
HWY_INLINE void write_back(Floats8 (&block)[kPatch], const float* share, float* residual) {
  inverse<kWiener>(block);
  HWY_UNROLL(8)
  for (int r = 0; r < kPatch; ++r) add_row(block[r] * share[r], residual + r * kPatch);
}

/// Of a pair.
template <bool kWiener, class Vector>
HWY_INLINE void write_back(Vector (&rows)[kPatch], const float* share, float* first, float* second,
                           bool single) {
  if constexpr (kIsTwo<Vector>) {
    Floats8 block[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(rows[r].low, block[r]);
    write_back<kWiener>(block, share, first);
    if (single) return;
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(rows[r].high, block[r]);
    write_back<kWiener>(block, share, second);
  } else {
    Vector both[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) both[r] = rows[r];
    inverse<kWiener>(both);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) both[r] *= share[r];
    // Blocks may overlap: the order of additions is that of the other instruction sets.
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) add_row(low_half(both[r]), first + r * kPatch);
    if (single) return;
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) add_row(high_half(both[r]), second + r * kPatch);
  }
}

/// Of a whole group.
template <bool kWiener, int kPairs, bool kSingle>
HWY_INLINE void write_back(Pair (&pairs)[kPairs], const FilterKernelJob& job,
                           const BlockGroup& group, float energy) {
  constexpr int kBlocks = kSingle ? 1 : 2 * kPairs;
  // Less than the inverse variance 1 / energy: overlapping estimates are not independent
  // (docs/bm3d.md).
  const float weight = 1 / std::sqrt(energy * std::sqrt(energy));
  float share[kPatch];
  for (int r = 0; r < kPatch; ++r) share[r] = weight * job.tables->window[r];
  const FilterTarget target = job.target;  // a copy, which no store can change
  for (int i = 0; i < kPairs; ++i)
    write_back<kWiener>(pairs[i].row, share, target.residual + spectra_of(group.place[i]),
                        target.residual + spectra_of(group.place[kSingle ? 0 : kPairs + i]),
                        kSingle);
  for (int i = 0; i < kBlocks; ++i) target.weight[group.place[i]] += weight;
  if (target.passed_noise)
    for (int i = 0; i < kBlocks; ++i)
      target.passed_noise[group.place[i]] += weight * energy / (kBlocks * kPatchPixels);
}

/// A pair, transformed along its rows. One block after the other where registers hold half a pair:
/// the rows of both would not stay in them.
template <bool kWiener, class Vector>
HWY_INLINE void load_transformed(const float* first, const float* second, Vector (&rows)[kPatch]) {
  if constexpr (kIsTwo<Vector>) {
    Floats8 block[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load(first + r * kPatch, block[r]);
    forward<kWiener>(block);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(block[r], rows[r].low);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load(second + r * kPatch, block[r]);
    forward<kWiener>(block);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(block[r], rows[r].high);
  } else {
    Vector both[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load_row(first + r * kPatch, second + r * kPatch, both[r]);
    forward<kWiener>(both);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) rows[r] = both[r];
  }
}

template <bool kWiener, int kPairs, bool kSingle>
HWY_INLINE void transform_group(const float* spectra, const BlockGroup& group,
                                Pair (&pairs)[kPairs]) {
  for (int i = 0; i < kPairs; ++i)
    load_transformed<kWiener>(spectra + spectra_of(group.place[i]),
                              spectra + spectra_of(group.place[kSingle ? 0 : kPairs + i]),
                              pairs[i].row);
}

template <int kPairs, bool kSingle>
void hard_group(const FilterKernelJob& job, const BlockGroup& group) {
  Pair pairs[kPairs];
  transform_group<false, kPairs, kSingle>(job.target.noisy, group, pairs);
  const GroupFilter::Tables& table = *job.tables;
  Floats kept = {};
  for (int r = 0; r < kPatch; ++r) {
    Floats v[kPairs], limit, always;
    load(table.power[r].data(), limit);
    load(table.mean[r].data(), always);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(pairs[i].row[r], v[i]);
    haar_forward<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) {
      constexpr Floats kZero = {};
      const float norm = squared_norm<kPairs, kSingle>(i);
      const Floats power = v[i] * v[i], least = limit * norm;
      auto keep = power > least;
      if (i == 0) keep = keep | (always > kZero);
      kept += choose(keep, kZero + 1.0F, kZero);
      v[i] = choose(keep, kZero, v[i] * (table.taken[r] * (1 / norm)));
    }
    haar_inverse<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(v[i], pairs[i].row[r]);
  }
  write_back<false, kPairs, kSingle>(pairs, job, group,
                                     sum_lanes(kept, kSingle ? kPatch : 2 * kPatch));
}

/// The noise's powers that a coefficient is taken to have at most, so that the product of four is
/// finite; with as many it passes whole, in the precision of a float.
constexpr float kMostPower = 1e9F;

/// x := 1 / (x + 1) of one, two or four, with one division.
template <int kCount>
HWY_INLINE void losses(Floats* x) {
  Floats above[kCount];
  HWY_UNROLL(4)
  for (int i = 0; i < kCount; ++i) above[i] = smaller(x[i], kMostPower) + 1.0F;
  if constexpr (kCount == 1) {
    x[0] = 1.0F / above[0];
  } else if constexpr (kCount == 2) {
    const Floats inverse = 1.0F / (above[0] * above[1]);
    x[0] = above[1] * inverse;
    x[1] = above[0] * inverse;
  } else {
    const Floats first = above[0] * above[1], second = above[2] * above[3];
    const Floats inverse = 1.0F / (first * second);
    const Floats of_first = second * inverse, of_second = first * inverse;
    x[0] = above[1] * of_first;
    x[1] = above[0] * of_first;
    x[2] = above[3] * of_second;
    x[3] = above[2] * of_second;
  }
}

template <int kPairs, bool kSingle>
void wiener_group(const FilterKernelJob& job, const BlockGroup& group) {
  Pair pairs[kPairs], pilot[kPairs];
  transform_group<true, kPairs, kSingle>(job.target.noisy, group, pairs);
  transform_group<true, kPairs, kSingle>(job.target.pilot, group, pilot);
  const GroupFilter::Tables& table = *job.tables;
  Floats energy[2] = {};  // two, that additions wait less for each other
  for (int r = 0; r < kPatch; ++r) {
    // loss: one less the Wiener gain.
    Floats v[kPairs], loss[kPairs], inverse_noise, mean;
    load(table.power[r].data(), inverse_noise);
    load(table.mean[r].data(), mean);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(pilot[i].row[r], loss[i]);
    haar_forward<kPairs, kSingle>(loss);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i)
      loss[i] *= loss[i] * (inverse_noise * (1 / squared_norm<kPairs, kSingle>(i)));
    constexpr int kTogether = std::min(kPairs, 4);
    HWY_UNROLL(4)
    for (int i = 0; i < kPairs; i += kTogether) losses<kTogether>(loss + i);
    loss[0] = choose(mean > 0.0F, Floats{}, loss[0]);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) {
      const Floats gain = 1.0F - loss[i];
      energy[i % 2] += gain * gain;
    }
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(pairs[i].row[r], v[i]);
    haar_forward<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i)
      v[i] *= loss[i] * (table.taken[r] * (1 / squared_norm<kPairs, kSingle>(i)));
    haar_inverse<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(v[i], pairs[i].row[r]);
  }
  write_back<true, kPairs, kSingle>(
      pairs, job, group, sum_lanes(energy[0] + energy[1], kSingle ? kPatch : 2 * kPatch));
}

template <template <int, bool> class Filter>
void filter_groups(const FilterKernelJob& job) {
  for (std::size_t i = 0; i < job.count; ++i) {
    const BlockGroup& group = job.groups[i];
    switch (group.count) {
      case 1:
        Filter<1, true>::run(job, group);
        break;
      case 2:
        Filter<1, false>::run(job, group);
        break;
      case 4:
        Filter<2, false>::run(job, group);
        break;
      case 8:
        Filter<4, false>::run(job, group);
        break;
      case 16:
        Filter<8, false>::run(job, group);
        break;
      default:
        Filter<16, false>::run(job, group);
        break;
    }
  }
}

template <int kPairs, bool kSingle>
struct HardFilter {
  static void run(const FilterKernelJob& job, const BlockGroup& group) {
    hard_group<kPairs, kSingle>(job, group);
  }
};
void hard_groups(const FilterKernelJob& job) { filter_groups<HardFilter>(job); }

template <int kPairs, bool kSingle>
struct WienerFilter {
  static void run(const FilterKernelJob& job, const BlockGroup& group) {
    wiener_group<kPairs, kSingle>(job, group);
  }
};
void wiener_groups(const FilterKernelJob& job) { filter_groups<WienerFilter>(job); }

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(hard_groups);
HWY_EXPORT(wiener_groups);

namespace {

/// taken: back along the rows; power[r][lane] = power_of(square of what makes the coefficient
/// orthonormal).
template <class PowerOf>
void fill(GroupFilter::Tables& t, BlockTransform transform, PowerOf power_of) {
  const auto norm = transform_norms(transform), back = transform_back(transform);
  const auto window = kaiser_window();
  for (std::size_t r = 0; r < kPatch; ++r) {
    t.taken[r] = static_cast<float>(-back[r]);
    t.window[r] = static_cast<float>(window[r]);
    for (std::size_t lane = 0; lane < GroupFilter::kLanes; ++lane) {
      const double f = norm[r] * norm[lane % kPatch];
      t.power[r][lane] = static_cast<float>(power_of(f * f));
    }
  }
  t.mean = {};
  t.mean[0][0] = 1;
}

}  // namespace

GroupFilter GroupFilter::hard(float sigma, float threshold) {
  GroupFilter filter;
  const double limit = double{sigma} * threshold;
  fill(filter.tables_, BlockTransform::biorthogonal,
       [&](double norm2) { return limit * limit / norm2; });
  return filter;
}

GroupFilter GroupFilter::wiener(float sigma) {
  GroupFilter filter;
  filter.wiener_ = true;
  const double noise = double{sigma} * sigma;
  fill(filter.tables_, BlockTransform::dct, [&](double norm2) { return norm2 / noise; });
  return filter;
}

void GroupFilter::run(std::span<const BlockGroup> groups, const FilterTarget& target) const {
  const FilterKernelJob job{groups.data(), groups.size(), target, &tables_};
  if (wiener_)
    HWY_DYNAMIC_DISPATCH(wiener_groups)(job);
  else
    HWY_DYNAMIC_DISPATCH(hard_groups)(job);
}

}  // namespace malus::internal
#endif
