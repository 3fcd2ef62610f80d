// Products of float32 values, for many rows of few values times packed weights.
#include "malus/base/vector_targets.h"
#include "malus/neural/internal/kernels.h"

#include <algorithm>
#include <array>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/neural/kernels_product.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

struct Arithmetic {
  using Tag = hn::CappedTag<float, kLane>;
  using Value = float;
  using Vec = hn::Vec<Tag>;
  using Factor = Vec;
  static constexpr std::ptrdiff_t kWidth = hn::MaxLanes(Tag()), kDepth = 1;

  static HWY_INLINE Vec zero() { return hn::Zero(Tag()); }
  static HWY_INLINE Vec fill(float value) { return hn::Set(Tag(), value); }
  static HWY_INLINE Vec load(const float* from) { return hn::LoadU(Tag(), from); }
  static HWY_INLINE void store(Vec value, float* to) { hn::StoreU(value, Tag(), to); }
  static HWY_INLINE Vec add(Vec a, Vec b) { return hn::Add(a, b); }
  static HWY_INLINE Vec multiply(Vec a, Vec b) { return hn::Mul(a, b); }
  static HWY_INLINE Vec max(Vec a, Vec b) { return hn::Max(a, b); }
  static HWY_INLINE Factor factors(const float* from) { return load(from); }
  static HWY_INLINE Factor spread(const float* from) { return fill(*from); }
  static HWY_INLINE Vec multiply_add(Factor a, Factor b, Vec sum) { return hn::MulAdd(a, b, sum); }
};
#include "malus/neural/internal/product-inl.h"

void multiply_floats(const MatrixProduct& p) { multiply_parts(p, p.a, p.b); }
std::ptrdiff_t panel_of_floats(std::ptrdiff_t cols) { return panel_cols_of(cols); }
std::ptrdiff_t gate_panel_of_floats() { return kTileCols; }

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(multiply_floats);
HWY_EXPORT(panel_of_floats);
HWY_EXPORT(gate_panel_of_floats);
void multiply(const MatrixProduct& product) {
  if (product.pairs != nullptr)
    multiply_rounded(product);
  else
    HWY_DYNAMIC_DISPATCH(multiply_floats)(product);
}

void pack_columns(const float* b, std::ptrdiff_t inner, std::ptrdiff_t cols,
                  std::ptrdiff_t inner_stride, std::ptrdiff_t col_stride, float* to,
                  std::ptrdiff_t panel_cols) {
  if (panel_cols == 0) panel_cols = HWY_DYNAMIC_DISPATCH(panel_of_floats)(cols);
  for (std::ptrdiff_t panel = 0; panel < cols; panel += panel_cols) {
    const std::ptrdiff_t count = std::min(panel_cols, cols - panel), width = whole_lanes(count);
    for (std::ptrdiff_t k = 0; k < inner; ++k, to += width)
      for (std::ptrdiff_t n = 0; n < width; ++n)
        to[n] = n < count ? b[k * inner_stride + (panel + n) * col_stride] : 0.0F;
  }
}

void scale_packed_rows(const float* packed, std::ptrdiff_t inner, std::ptrdiff_t cols,
                       const float* factors, float* to) {
  const std::ptrdiff_t panel_cols = HWY_DYNAMIC_DISPATCH(panel_of_floats)(cols);
  for (std::ptrdiff_t panel = 0; panel < cols; panel += panel_cols) {
    const std::ptrdiff_t width = whole_lanes(std::min(panel_cols, cols - panel));
    for (std::ptrdiff_t k = 0; k < inner; ++k, packed += width, to += width)
      for (std::ptrdiff_t n = 0; n < width; ++n) to[n] = packed[n] * factors[k];
  }
}

std::ptrdiff_t gate_panel(bool rounded) {
  return rounded ? 4 * kLane : HWY_DYNAMIC_DISPATCH(gate_panel_of_floats)();
}

}  // namespace malus::internal
#endif
