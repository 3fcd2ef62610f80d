// Collaborative filtering of groups: 2-D transform of each block, Haar transform along the
// group, shrinkage, and back. Two blocks lie side by side in a vector of 16 floats, so that a
// pass along the columns is plain vertical arithmetic; a transposition inside each half gives the
// other direction. Vectors are 16 floats on every machine, in as many registers as it needs, so all
// machines compute the same.
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
  const float* window;  ///< [row][lane]
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

/// Adds the weighted residual of one block.
HWY_INLINE void add_row(const Floats8& weighted, float* residual) {
  Floats8 sum;
  load(residual, sum);
  sum += weighted;
  store(sum, residual);
}

/// Inverse 2-D transform and aggregation of one block.
template <bool kWiener>
HWY_INLINE void write_back(Floats8 (&block)[kPatch], const FilterTarget& t, std::int32_t position,
                           const float* window, float weight) {
  inverse_2d<kWiener>(block);
  HWY_UNROLL(8)
  for (int r = 0; r < kPatch; ++r) {
    const std::ptrdiff_t at = position + r * t.stride;
    Floats8 share, noisy;
    load(window + r * GroupFilter::kLanes, share);
    load(t.noisy + at, noisy);
    add_row((block[r] - noisy) * (share * weight), t.residual + at);
  }
}

/// Of a pair.
template <bool kWiener, class Vector>
HWY_INLINE void write_back(Vector (&rows)[kPatch], const FilterTarget& t, std::int32_t first,
                           std::int32_t second, const float* window, float weight, bool single) {
  if constexpr (kIsTwo<Vector>) {
    Floats8 block[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(rows[r].low, block[r]);
    write_back<kWiener>(block, t, first, window, weight);
    if (single) return;
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(rows[r].high, block[r]);
    write_back<kWiener>(block, t, second, window, weight);
  } else {
    inverse_2d<kWiener>(rows);
    Floats weighted[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) {
      const std::ptrdiff_t row = r * t.stride;
      Floats share, noisy;
      load(window + r * GroupFilter::kLanes, share);
      load_row(t.noisy + first + row, t.noisy + second + row, noisy);
      weighted[r] = (rows[r] - noisy) * (share * weight);
    }
    // Blocks may overlap: the order of additions is that of the other instruction sets.
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r)
      add_row(low_half(weighted[r]), t.residual + first + r * t.stride);
    if (single) return;
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r)
      add_row(high_half(weighted[r]), t.residual + second + r * t.stride);
  }
}

/// Inverse 2-D transforms and aggregation of a whole group.
template <bool kWiener, int kPairs, bool kSingle>
HWY_INLINE void write_back(Pair (&pairs)[kPairs], const FilterKernelJob& job,
                           const BlockGroup& group, float energy) {
  constexpr int kBlocks = kSingle ? 1 : 2 * kPairs;
  // Less than the inverse variance 1 / energy: overlapping estimates are not independent
  // (docs/bm3d.md).
  const float weight = 1 / std::sqrt(energy * std::sqrt(energy));
  for (int i = 0; i < kPairs; ++i)
    write_back<kWiener>(pairs[i].row, job.target, group.position[i],
                        group.position[kSingle ? 0 : kPairs + i], job.window, weight, kSingle);
  for (int i = 0; i < kBlocks; ++i) job.target.weight[group.position[i]] += weight;
  if (job.target.passed_noise)
    for (int i = 0; i < kBlocks; ++i)
      job.target.passed_noise[group.position[i]] += weight * energy / (kBlocks * kPatchPixels);
}

/// 2-D transforms of a pair. One block after the other where registers hold half a pair: the rows
/// of both would not stay in them.
template <bool kWiener, class Vector>
HWY_INLINE void load_transformed(const float* first, const float* second, std::ptrdiff_t stride,
                                 Vector (&rows)[kPatch]) {
  if constexpr (kIsTwo<Vector>) {
    Floats8 block[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load(first + r * stride, block[r]);
    forward_2d<kWiener>(block);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(block[r], rows[r].low);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load(second + r * stride, block[r]);
    forward_2d<kWiener>(block);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) copy(block[r], rows[r].high);
  } else {
    Vector both[kPatch];
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) load_row(first + r * stride, second + r * stride, both[r]);
    forward_2d<kWiener>(both);
    HWY_UNROLL(8)
    for (int r = 0; r < kPatch; ++r) rows[r] = both[r];
  }
}

template <bool kWiener, int kPairs, bool kSingle>
HWY_INLINE void transform_group(const float* plane, std::ptrdiff_t stride, const BlockGroup& group,
                                Pair (&pairs)[kPairs]) {
  for (int i = 0; i < kPairs; ++i)
    load_transformed<kWiener>(plane + group.position[i],
                              plane + group.position[kSingle ? 0 : kPairs + i], stride,
                              pairs[i].row);
}

template <int kPairs, bool kSingle>
void hard_group(const FilterKernelJob& job, const BlockGroup& group) {
  Pair pairs[kPairs];
  transform_group<false, kPairs, kSingle>(job.target.noisy, job.target.stride, group, pairs);
  const GroupFilter::Tables& table = *job.tables;
  Floats kept = {};
  for (int r = 0; r < kPatch; ++r) {
    Floats v[kPairs], scale, limit, always;
    load(table.scale[r].data(), scale);
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
      v[i] = choose(keep, v[i] * (scale * (1 / norm)), kZero);
    }
    haar_inverse<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(v[i], pairs[i].row[r]);
  }
  write_back<false, kPairs, kSingle>(pairs, job, group,
                                     sum_lanes(kept, kSingle ? kPatch : 2 * kPatch));
}

/// a / (a + 1) and b / (b + 1) with one division.
HWY_INLINE void two_gains(Floats& a, Floats& b) {
  const Floats below_a = a + 1.0F, below_b = b + 1.0F;
  const Floats inverse = 1.0F / (below_a * below_b);
  a = a * below_b * inverse;
  b = b * below_a * inverse;
}

template <int kPairs, bool kSingle>
void wiener_group(const FilterKernelJob& job, const BlockGroup& group) {
  Pair pairs[kPairs], pilot[kPairs];
  transform_group<true, kPairs, kSingle>(job.target.noisy, job.target.stride, group, pairs);
  transform_group<true, kPairs, kSingle>(job.target.pilot, job.target.stride, group, pilot);
  const GroupFilter::Tables& table = *job.tables;
  Floats energy = {};
  for (int r = 0; r < kPatch; ++r) {
    Floats v[kPairs], gain[kPairs], inverse_noise, mean, scale;
    load(table.power[r].data(), inverse_noise);
    load(table.mean[r].data(), mean);
    load(table.scale[r].data(), scale);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(pilot[i].row[r], gain[i]);
    haar_forward<kPairs, kSingle>(gain);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i)
      gain[i] *= gain[i] * (inverse_noise * (1 / squared_norm<kPairs, kSingle>(i)));
    if constexpr (kPairs == 1) {
      gain[0] = gain[0] / (gain[0] + 1.0F);
    } else {
      HWY_UNROLL(8)
      for (int i = 0; i < kPairs; i += 2) two_gains(gain[i], gain[i + 1]);
    }
    gain[0] = choose(mean > 0.0F, mean, gain[0]);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) energy += gain[i] * gain[i];
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(pairs[i].row[r], v[i]);
    haar_forward<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i)
      v[i] *= gain[i] * (scale * (1 / squared_norm<kPairs, kSingle>(i)));
    haar_inverse<kPairs, kSingle>(v);
    HWY_UNROLL(16)
    for (int i = 0; i < kPairs; ++i) copy(v[i], pairs[i].row[r]);
  }
  write_back<true, kPairs, kSingle>(pairs, job, group,
                                    sum_lanes(energy, kSingle ? kPatch : 2 * kPatch));
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

/// unscaled coefficient * norm = coefficient of the orthonormal DCT (Arai et al.).
std::array<double, kPatch> dct_norms() {
  std::array<double, kPatch> norm{};
  for (int k = 0; k < kPatch; ++k)
    norm[static_cast<std::size_t>(k)] =
        1 / (std::sqrt(8.0) * (k == 0 ? 1 : std::sqrt(2.0) * std::cos(k * std::numbers::pi / 16)));
  return norm;
}

/// The same for the biorthogonal transform, which has sqrt(1/2) per level.
std::array<double, kPatch> biorthogonal_norms() {
  const double finest = std::sqrt(0.5), coarsest = std::sqrt(0.125);
  return {coarsest, coarsest, 0.5, 0.5, finest, finest, finest, finest};
}

/// power[r][lane] = power_of(square of what makes the coefficient orthonormal).
template <class PowerOf>
void fill(GroupFilter::Tables& t, const std::array<double, kPatch>& norm,
          const std::array<double, kPatch>& back, PowerOf power_of) {
  for (std::size_t r = 0; r < kPatch; ++r)
    for (std::size_t lane = 0; lane < GroupFilter::kLanes; ++lane) {
      const double f = norm[r] * norm[lane % kPatch];
      t.power[r][lane] = static_cast<float>(power_of(f * f));
      t.scale[r][lane] = static_cast<float>(back[r] * back[lane % kPatch]);
    }
  t.mean = {};
  t.mean[0][0] = 1;
}

void fill_window(GroupFilter::Table& table) {
  const auto window = kaiser_window();
  for (std::size_t r = 0; r < kPatch; ++r)
    for (std::size_t lane = 0; lane < GroupFilter::kLanes; ++lane)
      table[r][lane] = static_cast<float>(window[r] * window[lane % kPatch]);
}

}  // namespace

GroupFilter GroupFilter::hard(float sigma, float threshold) {
  GroupFilter filter;
  const auto norm = biorthogonal_norms();
  auto back = norm;
  for (double& b : back) b *= b;
  const double limit = double{sigma} * threshold;
  fill(filter.tables_, norm, back, [&](double norm2) { return limit * limit / norm2; });
  fill_window(filter.window_);
  return filter;
}

GroupFilter GroupFilter::wiener(float sigma) {
  GroupFilter filter;
  filter.wiener_ = true;
  std::array<double, kPatch> back{};
  back.fill(1.0 / kPatch);
  const double noise = double{sigma} * sigma;
  fill(filter.tables_, dct_norms(), back, [&](double norm2) { return norm2 / noise; });
  fill_window(filter.window_);
  return filter;
}

void GroupFilter::run(std::span<const BlockGroup> groups, const FilterTarget& target) const {
  const FilterKernelJob job{groups.data(), groups.size(), target, &tables_, window_[0].data()};
  if (wiener_)
    HWY_DYNAMIC_DISPATCH(wiener_groups)(job);
  else
    HWY_DYNAMIC_DISPATCH(hard_groups)(job);
}

}  // namespace malus::internal
#endif
