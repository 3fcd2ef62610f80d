// The inner dimension of a product in parts whose weights stay in a cache while all rows pass by.
// The including file defines, in its own namespace, kDepth, the values that are taken at a time,
// and kInnerBlock, the most of a part; no include guard, as product-inl.h.

// A part of the inner dimension: values [k0, k1) of each tap in [tap0, tap1).
struct InnerPart {
  std::ptrdiff_t tap0, tap1, k0, k1;
  bool first, last;
};

constexpr std::ptrdiff_t whole_depth(std::ptrdiff_t inner) {
  return (inner + kDepth - 1) / kDepth * kDepth;
}

// Calls use(part) for parts of the inner dimension, in order.
template <class Use>
HWY_INLINE void for_inner_parts(const MatrixProduct& p, const Use& use) {
  const std::ptrdiff_t taps = std::max<std::ptrdiff_t>(std::ssize(p.taps), 1);
  if (p.gate) return use(InnerPart{0, taps, 0, p.inner, true, true});
  if (p.inner > kInnerBlock / 2) {
    const std::ptrdiff_t parts = (p.inner + kInnerBlock - 1) / kInnerBlock,
                         size = whole_depth((p.inner + parts - 1) / parts);
    for (std::ptrdiff_t tap = 0; tap < taps; ++tap)
      for (std::ptrdiff_t k = 0; k < p.inner; k += size)
        use(InnerPart{tap, tap + 1, k, std::min(k + size, p.inner), tap == 0 && k == 0,
                      tap + 1 == taps && k + size >= p.inner});
    return;
  }
  const std::ptrdiff_t group = std::max<std::ptrdiff_t>(kInnerBlock / p.inner, 1);
  for (std::ptrdiff_t tap = 0; tap < taps; tap += group)
    use(InnerPart{tap, std::min(tap + group, taps), 0, p.inner, tap == 0, tap + group >= taps});
}

// Into the second-level cache.
HWY_INLINE void fetch(const float* from, std::ptrdiff_t values) {
  constexpr std::ptrdiff_t kLine = 16;
  for (std::ptrdiff_t i = 0; i < values; i += kLine) __builtin_prefetch(from + i, 0, 2);
}
