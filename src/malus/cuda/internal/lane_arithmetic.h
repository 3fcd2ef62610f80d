// The operations of formation-inl.h for a GPU thread that draws two pixels in step: their
// chains of multiply-adds and table reads do not wait for each other, and the rare branches are
// asked for once. Device code only.
#pragma once

#include "malus/synthesize/formation.h"

#include <cstdint>

namespace malus::cuda {

/// Values of a thread's two pixels; all operations are element by element.
template <class T>
struct Lanes {
  T v[2];
};

template <class F>
__device__ __forceinline__ auto each_lane(const F& value_of) {
  return Lanes<decltype(value_of(0))>{{value_of(0), value_of(1)}};
}

#define MALUS_LANE_OPERATOR(symbol)                                                       \
  template <class T>                                                                      \
  __device__ __forceinline__ auto operator symbol(const Lanes<T>& a, const Lanes<T>& b) { \
    return each_lane([&](int i) { return a.v[i] symbol b.v[i]; });                        \
  }
MALUS_LANE_OPERATOR(+)
MALUS_LANE_OPERATOR(-)
MALUS_LANE_OPERATOR(*)
MALUS_LANE_OPERATOR(&)
MALUS_LANE_OPERATOR(<)
MALUS_LANE_OPERATOR(>)
#undef MALUS_LANE_OPERATOR

/// sqrt(a) and 1 / a as IEEE 754 rounds them: what nvcc makes of sqrtf and of 1.0f / a for most
/// arguments, without its test and branch for the others. Rounding is right by the device's own
/// approximations, which nvcc relies on in the same way: with the worst error that PTX allows
/// them, a few mantissas would be off by one unit in the last place. On an H100 no finite float
/// from 5 on is (rounding.h counts them, and a test asks the device that it runs on).
/// a >= 2^-100 here.
__device__ __forceinline__ float rounded_sqrt(float a) {
  float inverse;
  asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(inverse) : "f"(a));
  const float root = a * inverse;
  return fmaf(fmaf(-root, root, a), 0.5f * inverse, root);
}

/// a from 2^-126 to 2^126; above that the approximation flushes to zero, and so does this.
__device__ __forceinline__ float rounded_reciprocal(float a) {
  float guess;
  asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(guess) : "f"(a));
  return fmaf(guess, fmaf(-a, guess, 1.0f), guess);
}

struct LaneArithmetic {
  using Real = Lanes<float>;
  using Word = Lanes<std::uint32_t>;
  using Truth = Lanes<bool>;

#define MALUS_LANES __device__ __forceinline__ static
  MALUS_LANES Real real(float x) {
    return each_lane([&](int) { return x; });
  }
  MALUS_LANES Word word(std::uint32_t x) {
    return each_lane([&](int) { return x; });
  }
  MALUS_LANES Real real_of(const Word& w) {
    return each_lane([&](int i) { return static_cast<float>(w.v[i]); });
  }
  MALUS_LANES Real tail_position(const Word& w) {
    return each_lane([&](int i) { return static_cast<float>(w.v[i] & 0x7FFFFFFFu) + 0.5f; });
  }
  MALUS_LANES Word cell_of(const Real& x) {
    return each_lane([&](int i) { return __float_as_uint(x.v[i]) >> kTailShift; });
  }
  MALUS_LANES Real multiply_add(const Real& a, const Real& b, const Real& c) {
    return each_lane([&](int i) { return fmaf(a.v[i], b.v[i], c.v[i]); });
  }
  MALUS_LANES Real sqrt(const Real& a) {
    return each_lane([&](int i) { return sqrtf(a.v[i]); });
  }
  MALUS_LANES void root_and_reciprocal(const Real& m, Real& root, Real& reciprocal) {
    root = each_lane([&](int i) { return rounded_sqrt(m.v[i]); });
    reciprocal = each_lane([&](int i) { return rounded_reciprocal(m.v[i]); });
  }
  MALUS_LANES Real floor(const Real& a) {
    return each_lane([&](int i) { return floorf(a.v[i]); });
  }
  MALUS_LANES Real max(const Real& a, const Real& b) {
    return each_lane([&](int i) { return fmaxf(a.v[i], b.v[i]); });
  }
  MALUS_LANES Real select(const Truth& t, const Real& a, const Real& b) {
    return each_lane([&](int i) { return t.v[i] ? a.v[i] : b.v[i]; });
  }
  MALUS_LANES Truth finite(const Real& a) {
    return each_lane([&](int i) { return fabsf(a.v[i]) <= 3.4028234e38f; });
  }
  MALUS_LANES bool none(const Truth& t) { return !t.v[0] && !t.v[1]; }
  MALUS_LANES bool all(const Truth& t) { return t.v[0] && t.v[1]; }
  MALUS_LANES Truth both(const Truth& a, const Truth& b) {
    return each_lane([&](int i) { return a.v[i] && b.v[i]; });
  }
  MALUS_LANES Real add_where(const Truth& t, const Real& a, const Real& b) {
    return each_lane([&](int i) { return t.v[i] ? a.v[i] + b.v[i] : a.v[i]; });
  }
  MALUS_LANES Real flip_sign_unless_top_bit(const Real& a, const Word& w) {
    return each_lane(
        [&](int i) { return __uint_as_float(__float_as_uint(a.v[i]) ^ (~w.v[i] & 0x80000000u)); });
  }
  MALUS_LANES Real select_top_bit(const Word& w, const Real& a, const Real& b) {
    return each_lane([&](int i) { return w.v[i] & 0x80000000u ? a.v[i] : b.v[i]; });
  }
  MALUS_LANES Real scale_down(const Real& a, const Real& n) {
    return each_lane([&](int i) {
      return __uint_as_float(__float_as_uint(a.v[i]) - (static_cast<std::uint32_t>(n.v[i]) << 23));
    });
  }
  MALUS_LANES Truth deep_upper_tail(const Word& w) {
    return each_lane([&](int i) { return w.v[i] - 0x80000000u < kShotTailWords; });
  }
  MALUS_LANES void look_up(const TailLine* lines, const Word& index, Real& a, Real& b) {
#pragma unroll
    for (int i = 0; i < 2; ++i) {
      // One load of eight bytes through the read-only cache; device memory is aligned well enough.
      const float2 line = __ldg(reinterpret_cast<const float2*>(lines) + index.v[i]);
      a.v[i] = line.x;
      b.v[i] = line.y;
    }
  }
  MALUS_LANES Real shot_upper_tail_where(const Truth& t, const Real& mean, const Word& w,
                                         const Real& count) {
    Real result = count;
    // Once in the code for both lanes: it is long, and hardly ever runs.
#pragma unroll 1
    for (int lane = 0; lane < 2; ++lane) {
      if (!(lane == 0 ? t.v[0] : t.v[1])) continue;
      const float m = lane == 0 ? mean.v[0] : mean.v[1];
      const float tail = shot_upper_tail(m, lane == 0 ? w.v[0] : w.v[1]);
      result = each_lane([&](int i) { return i == lane ? tail : result.v[i]; });
    }
    return result;
  }
#undef MALUS_LANES
};

#define MALUS_FORMATION __device__ __forceinline__
#include "malus/synthesize/formation-inl.h"
#undef MALUS_FORMATION

}  // namespace malus::cuda
