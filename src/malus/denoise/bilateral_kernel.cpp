// The inner loop of the joint bilateral filter, as stack_kernel.cpp: the same bits on all machines.
#include "malus/denoise/internal/bilateral_kernel.h"

#include "malus/base/vector_targets.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/bilateral_kernel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

#pragma GCC diagnostic ignored "-Wpsabi"

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#include "malus/denoise/internal/wide-inl.h"

void average_block(const BilateralRow& row, std::ptrdiff_t at) {
  const Floats zero{}, one = all<Floats>(1.0f);
  Floats middle, per_cut, samples, guide;
  load(row.guide + at, middle);
  load(row.per_cut + at, per_cut);
  // Of weights and samples, and of the weights' derivatives: dk/du = -8 u (1 - u²)³.
  Floats weights{}, sum{}, weight_slopes{}, slopes{};
  for (int i = -row.reach; i <= row.reach; ++i)
    for (int k = -row.reach; k <= row.reach; ++k) {
      const std::ptrdiff_t to = at + i * row.step_rows * row.stride + k * row.step_cols;
      load(row.guide + to, guide);
      load(row.samples + to, samples);
      const Floats u = (guide - middle) * per_cut;
      Floats rest = fused(zero - u, u, one);
      rest = choose(rest > zero, rest, zero);
      const Floats cube = rest * rest * rest, weight = cube * rest, weight_slope = cube * u;
      weights += weight;
      sum = fused(weight, samples, sum);
      weight_slopes += weight_slope;
      slopes = fused(weight_slope, samples, slopes);
    }
  const Floats own = one / weights, mean = sum * own;
  store(mean, row.mean + at);
  store(own, row.own + at);
  store(8.0f * per_cut * own * (slopes - mean * weight_slopes), row.slope + at);
}

void average(const BilateralRow& row) {
  for (int block = 0; block < row.blocks; ++block)
    if (row.is_wanted[block]) average_block(row, std::ptrdiff_t{kLanes} * block);
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {
HWY_EXPORT(average);
void average_alike(const BilateralRow& row) { HWY_DYNAMIC_DISPATCH(average)(row); }
}  // namespace malus::internal
#endif
