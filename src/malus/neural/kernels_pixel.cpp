// What lies between the products: norms, activations, depth-wise convolutions, softmax.
#include "malus/base/vector_targets.h"
#include "malus/neural/internal/kernels.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/neural/kernels_pixel.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <algorithm>
#include <cmath>

#include <hwy/contrib/math/math-inl.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Tag = hn::CappedTag<float, kLane>;
using Vec = hn::Vec<Tag>;
constexpr std::ptrdiff_t kWidth = hn::MaxLanes(Tag());

// erf(z) = z P(z²) / Q(z²) for 0 <= z <= 4, fitted by weighted least squares to the largest error
// of 2.1e-8 (4.0e-7 in float); erf(4) = 1 - 1.5e-8.
constexpr float kErfP[] = {1.128378976e+00F, 1.962496325e-01F, 5.346756743e-02F,
                           4.003675784e-03F, 2.880424165e-04F, 1.974828395e-06F};
constexpr float kErfQ[] = {
    1.0F, 5.072528669e-01F, 1.164767002e-01F, 1.544447994e-02F, 1.216367860e-03F, 3.748089890e-05F};
constexpr float kHalfRoot2 = 0.70710678118654752F;

// x Φ(x) = x/2 + |x|/2 · erf(|x| / √2)
HWY_INLINE Vec gelu_of(Vec x) {
  const Tag d;
  const Vec size = hn::Abs(x);
  const Vec z = hn::Min(hn::Mul(size, hn::Set(d, kHalfRoot2)), hn::Set(d, 4.0F));
  const Vec t = hn::Mul(z, z);
  Vec p = hn::Set(d, kErfP[5]), q = hn::Set(d, kErfQ[5]);
  for (int i = 4; i >= 0; --i) {
    p = hn::MulAdd(p, t, hn::Set(d, kErfP[i]));
    q = hn::MulAdd(q, t, hn::Set(d, kErfQ[i]));
  }
  const Vec half = hn::Set(d, 0.5F);
  return hn::MulAdd(hn::Mul(size, half), hn::Div(hn::Mul(z, p), q), hn::Mul(x, half));
}

void gelu(float* x, std::ptrdiff_t count) {
  const Tag d;
  for (std::ptrdiff_t i = 0; i < count; i += kWidth)
    hn::StoreU(gelu_of(hn::LoadU(d, x + i)), d, x + i);
}

void gate_halves(const float* halves, std::ptrdiff_t rows, std::ptrdiff_t width, bool with_gelu,
                 float* y) {
  const Tag d;
  for (std::ptrdiff_t r = 0; r < rows; ++r, halves += 2 * width, y += width)
    for (std::ptrdiff_t i = 0; i < width; i += kWidth) {
      const Vec a = hn::LoadU(d, halves + i), b = hn::LoadU(d, halves + width + i);
      hn::StoreU(hn::Mul(with_gelu ? gelu_of(a) : a, b), d, y + i);
    }
}

// kVectors vectors of columns: that many streams through the rows, not one after another, which
// would fetch the rows' lines again and again where rows lie a power of two apart.
template <int kVectors>
HWY_INLINE void add_some_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                                 bool squared, float* sums) {
  const Tag d;
  Vec sum[kVectors];
  for (int j = 0; j < kVectors; ++j) sum[j] = hn::LoadU(d, sums + j * kWidth);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (int j = 0; j < kVectors; ++j) {
      const Vec value = hn::LoadU(d, x + r * x_row + j * kWidth);
      sum[j] = squared ? hn::MulAdd(value, value, sum[j]) : hn::Add(sum[j], value);
    }
  for (int j = 0; j < kVectors; ++j) hn::StoreU(sum[j], d, sums + j * kWidth);
}

void add_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows, std::ptrdiff_t columns,
                 bool squared, float* sums) {
  constexpr int kVectors = 8;
  std::ptrdiff_t c = 0;
  for (; c + kVectors * kWidth <= columns; c += kVectors * kWidth)
    add_some_columns<kVectors>(x + c, x_row, rows, squared, sums + c);
  for (; c < columns; c += kWidth) add_some_columns<1>(x + c, x_row, rows, squared, sums + c);
}

void scale_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                   std::ptrdiff_t columns, const float* factors, float* y, std::ptrdiff_t y_row) {
  const Tag d;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < columns; c += kWidth)
      hn::StoreU(hn::Mul(hn::LoadU(d, x + r * x_row + c), hn::LoadU(d, factors + c)), d,
                 y + r * y_row + c);
}

void add_scaled(float* y, const float* x, float scale, std::ptrdiff_t count) {
  const Tag d;
  const Vec factor = hn::Set(d, scale);
  for (std::ptrdiff_t i = 0; i < count; i += kWidth)
    hn::StoreU(hn::MulAdd(factor, hn::LoadU(d, x + i), hn::LoadU(d, y + i)), d, y + i);
}

// Deviations from the mean, without channels that only fill up the last vector.
HWY_INLINE Vec centred_part(const RowNorm& norm, Vec x, Vec mean, std::ptrdiff_t channels_left) {
  const Tag d;
  const Vec centred = hn::Sub(x, mean);
  if (HWY_LIKELY(channels_left - norm.filling >= kWidth)) return centred;
  return hn::IfThenElseZero(hn::FirstN(d, static_cast<std::size_t>(std::max<std::ptrdiff_t>(
                                              channels_left - norm.filling, 0))),
                            centred);
}

// kRows rows at a time: their sums across vectors wait for one another, not for the next row.
template <int kRows>
HWY_INLINE void normalize_some(const RowNorm& norm, const float* x, std::ptrdiff_t x_row,
                               std::ptrdiff_t channels, float* y) {
  const Tag d;
  const float per_channel = 1.0F / static_cast<float>(channels - norm.filling);
  Vec sum[kRows], squares[kRows], mean[kRows], inverse[kRows];
  for (int r = 0; r < kRows; ++r) sum[r] = squares[r] = hn::Zero(d);
  for (std::ptrdiff_t c = 0; c < channels; c += kWidth)
    for (int r = 0; r < kRows; ++r) sum[r] = hn::Add(sum[r], hn::LoadU(d, x + r * x_row + c));
  for (int r = 0; r < kRows; ++r)
    mean[r] = hn::Mul(hn::SumOfLanes(d, sum[r]), hn::Set(d, per_channel));
  for (std::ptrdiff_t c = 0; c < channels; c += kWidth)
    for (int r = 0; r < kRows; ++r) {
      const Vec centred =
          centred_part(norm, hn::LoadU(d, x + r * x_row + c), mean[r], channels - c);
      squares[r] = hn::MulAdd(centred, centred, squares[r]);
    }
  for (int r = 0; r < kRows; ++r) {
    const Vec variance = hn::Mul(hn::SumOfLanes(d, squares[r]), hn::Set(d, per_channel));
    inverse[r] = hn::Div(hn::Set(d, 1.0F), hn::Sqrt(hn::Add(variance, hn::Set(d, norm.epsilon))));
    if (norm.bias_free) mean[r] = hn::Zero(d);
  }
  for (std::ptrdiff_t c = 0; c < channels; c += kWidth) {
    const Vec weight = hn::LoadU(d, norm.weight + c),
              bias = norm.bias == nullptr ? hn::Zero(d) : hn::LoadU(d, norm.bias + c);
    for (int r = 0; r < kRows; ++r) {
      const Vec centred = hn::Sub(hn::LoadU(d, x + r * x_row + c), mean[r]);
      hn::StoreU(hn::Add(hn::Mul(hn::Mul(centred, inverse[r]), weight), bias), d,
                 y + r * channels + c);
    }
  }
}

void normalize_rows(const RowNorm& norm, const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                    std::ptrdiff_t channels, float* y) {
  std::ptrdiff_t r = 0;
  for (; r + 4 <= rows; r += 4)
    normalize_some<4>(norm, x + r * x_row, x_row, channels, y + r * channels);
  for (; r < rows; ++r) normalize_some<1>(norm, x + r * x_row, x_row, channels, y + r * channels);
}

// Sums across the lanes of kWidth vectors, one to a lane: every step adds neighbours of two vectors
// and joins them.
HWY_INLINE Vec sums_of_lanes(Vec (&v)[kWidth]) {
#if HWY_TARGET != HWY_SCALAR
  const Tag d;
  for (std::ptrdiff_t n = kWidth / 2; n > 0; n /= 2)
    for (std::ptrdiff_t i = 0; i < n; ++i)
      v[i] = hn::Add(hn::ConcatEven(d, v[2 * i + 1], v[2 * i]),
                     hn::ConcatOdd(d, v[2 * i + 1], v[2 * i]));
#endif
  return v[0];
}

// kWidth rows at a time, the last ones again where there are fewer.
void inverse_deviations(const RowNorm& norm, const float* x, std::ptrdiff_t x_row,
                        std::ptrdiff_t rows, std::ptrdiff_t channels, float* y) {
  const Tag d;
  const Vec per_channel = hn::Set(d, 1.0F / static_cast<float>(channels - norm.filling)),
            epsilon = hn::Set(d, norm.epsilon), one = hn::Set(d, 1.0F);
  HWY_ALIGN float mean[kWidth];
  for (std::ptrdiff_t r = 0; r < rows; r += kWidth) {
    const float* row[kWidth];
    for (std::ptrdiff_t i = 0; i < kWidth; ++i) row[i] = x + std::min(r + i, rows - 1) * x_row;
    Vec sum[kWidth];
    for (std::ptrdiff_t i = 0; i < kWidth; ++i) sum[i] = hn::LoadU(d, row[i]);
    for (std::ptrdiff_t c = kWidth; c < channels; c += kWidth)
      for (std::ptrdiff_t i = 0; i < kWidth; ++i)
        sum[i] = hn::Add(sum[i], hn::LoadU(d, row[i] + c));
    hn::Store(hn::Mul(sums_of_lanes(sum), per_channel), d, mean);
    for (std::ptrdiff_t i = 0; i < kWidth; ++i) sum[i] = hn::Zero(d);
    for (std::ptrdiff_t c = 0; c < channels; c += kWidth)
      for (std::ptrdiff_t i = 0; i < kWidth; ++i) {
        const Vec centred =
            centred_part(norm, hn::LoadU(d, row[i] + c), hn::Set(d, mean[i]), channels - c);
        sum[i] = hn::MulAdd(centred, centred, sum[i]);
      }
    const Vec variance = hn::Mul(sums_of_lanes(sum), per_channel);
    hn::StoreU(hn::Div(one, hn::Sqrt(hn::Add(variance, epsilon))), d, y + r);
  }
}

// kPixels pixels: what three rows give to them. Channels are taken in the order of memory: one
// vector of them for all pixels first would read half lines, and of few sets of the cache.
template <int kPixels>
HWY_INLINE void depthwise_pixels(const float* const rows[3], const float* weight, const float* bias,
                                 std::ptrdiff_t at, std::ptrdiff_t channels, float* y) {
  const Tag d;
  for (std::ptrdiff_t c = 0; c < channels; c += kWidth) {
    const Vec start = bias == nullptr ? hn::Zero(d) : hn::LoadU(d, bias + c);
    Vec sum[kPixels];
    for (int i = 0; i < kPixels; ++i) sum[i] = start;
    for (int r = 0; r < 3; ++r) {
      const float* from = rows[r] + at + c;
      Vec tap[3];
      for (int t = 0; t < 3; ++t) tap[t] = hn::LoadU(d, weight + (3 * r + t) * channels + c);
      for (int i = 0; i < kPixels + 2; ++i) {
        const Vec value = hn::LoadU(d, from + i * channels);
        for (int t = 0; t < 3; ++t)
          if (i >= t && i - t < kPixels) sum[i - t] = hn::MulAdd(value, tap[t], sum[i - t]);
      }
    }
    for (int i = 0; i < kPixels; ++i) hn::StoreU(sum[i], d, y + at + c + i * channels);
  }
}

void depthwise_row(const float* const rows[3], const float* weight, const float* bias,
                   std::ptrdiff_t cols, std::ptrdiff_t channels, float* y) {
  constexpr int kPixels = kWidth == kLane ? 8 : 4;
  std::ptrdiff_t pixel = 0;
  for (; pixel + kPixels <= cols; pixel += kPixels)
    depthwise_pixels<kPixels>(rows, weight, bias, pixel * channels, channels, y);
  for (; pixel < cols; ++pixel)
    depthwise_pixels<1>(rows, weight, bias, pixel * channels, channels, y);
}

// The same of two halves of channels, which are multiplied.
template <int kPixels>
HWY_INLINE void depthwise_gate_pixels(const float* const rows[3], const float* weight,
                                      const float* bias, std::ptrdiff_t pixel, std::ptrdiff_t width,
                                      float* y, std::ptrdiff_t y_row, float* sums) {
  const Tag d;
  const std::ptrdiff_t channels = 2 * width, at = pixel * channels;
  for (std::ptrdiff_t c = 0; c < width; c += kWidth) {
    Vec half[2][kPixels];
    for (int h = 0; h < 2; ++h)
      for (int i = 0; i < kPixels; ++i)
        half[h][i] = bias == nullptr ? hn::Zero(d) : hn::LoadU(d, bias + h * width + c);
    for (int r = 0; r < 3; ++r)
      for (int h = 0; h < 2; ++h) {
        const float* from = rows[r] + at + h * width + c;
        Vec tap[3];
        for (int t = 0; t < 3; ++t)
          tap[t] = hn::LoadU(d, weight + (3 * r + t) * channels + h * width + c);
        for (int i = 0; i < kPixels + 2; ++i) {
          const Vec value = hn::LoadU(d, from + i * channels);
          for (int t = 0; t < 3; ++t)
            if (i >= t && i - t < kPixels)
              half[h][i - t] = hn::MulAdd(value, tap[t], half[h][i - t]);
        }
      }
    Vec sum = hn::LoadU(d, sums + c);
    for (int i = 0; i < kPixels; ++i) {
      const Vec gated = hn::Mul(half[0][i], half[1][i]);
      hn::StoreU(gated, d, y + (pixel + i) * width + c);
      __builtin_prefetch(y + y_row + (pixel + i) * width + c, 1, 2);  // the row that comes next
      sum = hn::Add(sum, gated);
    }
    hn::StoreU(sum, d, sums + c);
  }
}

void depthwise_gate_row(const float* const rows[3], const float* weight, const float* bias,
                        std::ptrdiff_t cols, std::ptrdiff_t width, float* y, float* sums) {
  constexpr int kPixels = kWidth == kLane ? 8 : 4;
  std::ptrdiff_t pixel = 0;
  for (; pixel + kPixels <= cols; pixel += kPixels)
    depthwise_gate_pixels<kPixels>(rows, weight, bias, pixel, width, y, cols * width, sums);
  for (; pixel < cols; ++pixel)
    depthwise_gate_pixels<1>(rows, weight, bias, pixel, width, y, cols * width, sums);
}

void softmax_rows(float* x, std::ptrdiff_t rows, std::ptrdiff_t cols, float scale,
                  const float* bias, const float* labels) {
  const Tag d;
  constexpr float kApart = -100.0F;
  const Vec factor = hn::Set(d, scale);
  for (std::ptrdiff_t r = 0; r < rows; ++r, x += cols) {
    Vec most = hn::Set(d, -3.0e38F);
    for (std::ptrdiff_t c = 0; c < cols; c += kWidth) {
      Vec value = hn::Mul(hn::LoadU(d, x + c), factor);
      if (bias != nullptr) value = hn::Add(value, hn::LoadU(d, bias + r * cols + c));
      if (labels != nullptr)
        value = hn::Add(value,
                        hn::IfThenElseZero(hn::Ne(hn::LoadU(d, labels + c), hn::Set(d, labels[r])),
                                           hn::Set(d, kApart)));
      hn::StoreU(value, d, x + c);
      most = hn::Max(most, value);
    }
    most = hn::MaxOfLanes(d, most);
    Vec sum = hn::Zero(d);
    for (std::ptrdiff_t c = 0; c < cols; c += kWidth) {
      const Vec value = hn::Exp(d, hn::Sub(hn::LoadU(d, x + c), most));
      hn::StoreU(value, d, x + c);
      sum = hn::Add(sum, value);
    }
    const Vec inverse = hn::Set(d, 1.0F / hn::GetLane(hn::SumOfLanes(d, sum)));
    for (std::ptrdiff_t c = 0; c < cols; c += kWidth)
      hn::StoreU(hn::Mul(hn::LoadU(d, x + c), inverse), d, x + c);
  }
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(gelu);
HWY_EXPORT(gate_halves);
HWY_EXPORT(add_columns);
HWY_EXPORT(scale_columns);
HWY_EXPORT(add_scaled);
HWY_EXPORT(normalize_rows);
HWY_EXPORT(inverse_deviations);
HWY_EXPORT(depthwise_row);
HWY_EXPORT(depthwise_gate_row);
HWY_EXPORT(softmax_rows);

void gelu(float* x, std::ptrdiff_t count) { HWY_DYNAMIC_DISPATCH(gelu)(x, count); }
void gate_halves(const float* halves, std::ptrdiff_t rows, std::ptrdiff_t width, bool with_gelu,
                 float* y) {
  HWY_DYNAMIC_DISPATCH(gate_halves)(halves, rows, width, with_gelu, y);
}
void add_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows, std::ptrdiff_t columns,
                 bool squared, float* sums) {
  HWY_DYNAMIC_DISPATCH(add_columns)(x, x_row, rows, columns, squared, sums);
}
void scale_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                   std::ptrdiff_t columns, const float* factors, float* y, std::ptrdiff_t y_row) {
  HWY_DYNAMIC_DISPATCH(scale_columns)(x, x_row, rows, columns, factors, y, y_row);
}
void add_scaled(float* y, const float* x, float scale, std::ptrdiff_t count) {
  HWY_DYNAMIC_DISPATCH(add_scaled)(y, x, scale, count);
}
void normalize_rows(const RowNorm& norm, const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                    std::ptrdiff_t channels, float* y) {
  HWY_DYNAMIC_DISPATCH(normalize_rows)(norm, x, x_row, rows, channels, y);
}
void inverse_deviations(const RowNorm& norm, const float* x, std::ptrdiff_t x_row,
                        std::ptrdiff_t rows, std::ptrdiff_t channels, float* y) {
  HWY_DYNAMIC_DISPATCH(inverse_deviations)(norm, x, x_row, rows, channels, y);
}
void depthwise_gate_row(const float* const rows[3], const float* weight, const float* bias,
                        std::ptrdiff_t cols, std::ptrdiff_t width, float* y, float* sums) {
  HWY_DYNAMIC_DISPATCH(depthwise_gate_row)(rows, weight, bias, cols, width, y, sums);
}
void depthwise_row(const float* const rows[3], const float* weight, const float* bias,
                   std::ptrdiff_t cols, std::ptrdiff_t channels, float* y) {
  HWY_DYNAMIC_DISPATCH(depthwise_row)(rows, weight, bias, cols, channels, y);
}
void softmax_rows(float* x, std::ptrdiff_t rows, std::ptrdiff_t cols, float scale,
                  const float* bias, const float* labels) {
  HWY_DYNAMIC_DISPATCH(softmax_rows)(x, rows, cols, scale, bias, labels);
}

}  // namespace malus::internal
#endif
