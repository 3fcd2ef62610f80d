// Winograd's minimal filtering of 3x3 windows by tiles of 4x4 results (Lavin and Gray, "Fast
// algorithms for convolutional neural networks", CVPR 2016, 4.3: F(4x4, 3x3)).
#include "malus/base/vector_targets.h"
#include "malus/neural/internal/kernels.h"

#include <algorithm>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/neural/kernels_winograd.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kLane>;
using Vec = hn::Vec<Tag>;
constexpr std::ptrdiff_t kWidth = hn::MaxLanes(Tag());

// Bᵀ d along one axis.
HWY_INLINE void input_axis(const Vec (&in)[6], Vec (&out)[6]) {
  const Tag d;
  const Vec two = hn::Set(d, 2.0F), four = hn::Set(d, 4.0F), five = hn::Set(d, 5.0F);
  const Vec odd = hn::Sub(in[3], in[1]), even = hn::Sub(in[4], in[2]);
  out[0] = hn::Add(hn::NegMulAdd(five, in[2], hn::Mul(four, in[0])), in[4]);
  out[1] = hn::NegMulAdd(four, hn::Add(in[1], in[2]), hn::Add(in[3], in[4]));
  out[2] = hn::MulAdd(four, hn::Sub(in[1], in[2]), hn::Sub(in[4], in[3]));
  out[3] = hn::MulAdd(two, odd, even);
  out[4] = hn::NegMulAdd(two, odd, even);
  out[5] = hn::Add(hn::NegMulAdd(five, in[3], hn::Mul(four, in[1])), in[5]);
}

// Aᵀ m along one axis.
HWY_INLINE void output_axis(const Vec (&in)[6], Vec (&out)[4]) {
  const Tag d;
  const Vec sum = hn::Add(in[1], in[2]), difference = hn::Sub(in[1], in[2]);
  const Vec far_sum = hn::Add(in[3], in[4]), far_difference = hn::Sub(in[3], in[4]);
  out[0] = hn::Add(in[0], hn::Add(sum, far_sum));
  out[1] = hn::MulAdd(hn::Set(d, 2.0F), far_difference, difference);
  out[2] = hn::MulAdd(hn::Set(d, 4.0F), far_sum, sum);
  out[3] = hn::Add(hn::MulAdd(hn::Set(d, 8.0F), far_difference, difference), in[5]);
}

void winograd_input(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t channels, float* v,
                    std::ptrdiff_t v_element) {
  const Tag d;
  for (std::ptrdiff_t k = 0; k < channels; k += kWidth) {
    Vec half[6][6];
    for (int c = 0; c < 6; ++c) {
      Vec column[6], changed[6];
      for (int r = 0; r < 6; ++r) column[r] = hn::LoadU(d, x + r * x_row + c * channels + k);
      input_axis(column, changed);
      for (int r = 0; r < 6; ++r) half[r][c] = changed[r];
    }
    for (int r = 0; r < 6; ++r) {
      Vec changed[6];
      input_axis(half[r], changed);
      for (int c = 0; c < 6; ++c) hn::StoreU(changed[c], d, v + (6 * r + c) * v_element + k);
    }
  }
}

void winograd_output(const WinogradOutput& o) {
  const Tag d;
  const Vec leak = hn::Set(d, o.leak);
  for (std::ptrdiff_t k = 0; k < o.channels; k += kWidth) {
    Vec half[4][6];
    for (int c = 0; c < 6; ++c) {
      Vec column[6], changed[4];
      for (int r = 0; r < 6; ++r) column[r] = hn::LoadU(d, o.m + (6 * r + c) * o.m_element + k);
      output_axis(column, changed);
      for (int r = 0; r < 4; ++r) half[r][c] = changed[r];
    }
    const Vec bias = o.bias == nullptr ? hn::Zero(d) : hn::LoadU(d, o.bias + k);
    for (std::ptrdiff_t r = 0; r < o.rows; ++r) {
      Vec changed[4];
      output_axis(half[r], changed);
      for (std::ptrdiff_t c = 0; c < o.cols; ++c) {
        Vec value = hn::Add(changed[c], bias);
        if (o.leak < 1) value = hn::Max(value, hn::Mul(leak, value));
        hn::StoreU(value, d, o.y + r * o.y_row + c * o.channels + k);
      }
    }
  }
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(winograd_input);
HWY_EXPORT(winograd_output);

void winograd_input(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t channels, float* v,
                    std::ptrdiff_t v_element) {
  HWY_DYNAMIC_DISPATCH(winograd_input)(x, x_row, channels, v, v_element);
}
void winograd_output(const WinogradOutput& output) {
  HWY_DYNAMIC_DISPATCH(winograd_output)(output);
}

}  // namespace malus::internal
#endif
