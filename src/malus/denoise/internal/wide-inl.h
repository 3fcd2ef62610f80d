// Sixteen floats or whole numbers, in as many registers as the machine has them in. A vector that
// is wider than a register GCC takes apart lane by lane where it is compared, chosen from or
// rearranged, at a fifth of the speed; so here a wide vector is a pair of halves wherever its width
// is no register's. No include guard: included once per instruction set, inside that set's
// namespace and after Highway's header.

template <class Half>
struct Two {
  Half low, high;
};

template <class T>
inline constexpr bool kIsTwo = false;
template <class Half>
inline constexpr bool kIsTwo<Two<Half>> = true;
template <class A, class B>
concept OneIsTwo = kIsTwo<A> || kIsTwo<B>;

#define MALUS_WIDE(T, name)                                                                  \
  using name##4 = T __attribute__((vector_size(16)));                                        \
  using name##8InOne = T __attribute__((vector_size(32)));                                   \
  using name##16InOne = T __attribute__((vector_size(64)));                                  \
  using name##8 =                                                                            \
      std::conditional_t<sizeof(name##8InOne) <= HWY_MAX_BYTES, name##8InOne, Two<name##4>>; \
  using name =                                                                               \
      std::conditional_t<sizeof(name##16InOne) <= HWY_MAX_BYTES, name##16InOne, Two<name##8>>;
MALUS_WIDE(float, Floats)
MALUS_WIDE(std::int32_t, Ints)
#undef MALUS_WIDE
static_assert(sizeof(Floats) == 64 && sizeof(Ints) == 64);

// Halves; a number is the same in both.
template <class T>
HWY_INLINE const T& low(const T& number) {
  return number;
}
template <class T>
HWY_INLINE const T& high(const T& number) {
  return number;
}
template <class Half>
HWY_INLINE const Half& low(const Two<Half>& v) {
  return v.low;
}
template <class Half>
HWY_INLINE const Half& high(const Two<Half>& v) {
  return v.high;
}

#define MALUS_BY_HALVES(op)                                                     \
  template <class A, class B>                                                   \
  requires OneIsTwo<A, B> HWY_INLINE auto operator op(const A& a, const B& b) { \
    return Two{low(a) op low(b), high(a) op high(b)};                           \
  }
MALUS_BY_HALVES(+)
MALUS_BY_HALVES(-)
MALUS_BY_HALVES(*)
MALUS_BY_HALVES(/)
MALUS_BY_HALVES(|)
MALUS_BY_HALVES(>)
MALUS_BY_HALVES(>=)
MALUS_BY_HALVES(<)
MALUS_BY_HALVES(<=)
#undef MALUS_BY_HALVES

#define MALUS_INTO_HALVES(op)                                   \
  template <class Half, class B>                                \
  HWY_INLINE Two<Half>& operator op(Two<Half>& a, const B& b) { \
    a.low op low(b);                                            \
    a.high op high(b);                                          \
    return a;                                                   \
  }
MALUS_INTO_HALVES(+=)
MALUS_INTO_HALVES(-=)
MALUS_INTO_HALVES(*=)
MALUS_INTO_HALVES(&=)
#undef MALUS_INTO_HALVES

/// a * b + c, rounded once where the instruction set can: AVX2 and better can, and agree to the
/// bit.
template <class Vector>
HWY_INLINE Vector fused(const Vector& a, const Vector& b, const Vector& c) {
  if constexpr (kIsTwo<Vector>) {
    return {fused(a.low, b.low, c.low), fused(a.high, b.high, c.high)};
  } else if constexpr (sizeof(Vector) > HWY_MAX_BYTES) {
    return a * b + c;  // no instruction set at all
  } else {
    const hwy::HWY_NAMESPACE::FixedTag<float, sizeof(Vector) / sizeof(float)> tag;
    using Wide = hwy::HWY_NAMESPACE::Vec<decltype(tag)>;
    return hwy::HWY_NAMESPACE::MulAdd(Wide{a}, Wide{b}, Wide{c}).raw;
  }
}

template <class Vector>
HWY_INLINE Vector root(const Vector& v) {
  if constexpr (kIsTwo<Vector>) {
    return {root(v.low), root(v.high)};
  } else if constexpr (sizeof(Vector) > HWY_MAX_BYTES) {
    Vector roots = v;
    for (std::size_t i = 0; i < sizeof(v) / sizeof(float); ++i) roots[i] = std::sqrt(v[i]);
    return roots;
  } else {
    const hwy::HWY_NAMESPACE::FixedTag<float, sizeof(Vector) / sizeof(float)> tag;
    return hwy::HWY_NAMESPACE::Sqrt(hwy::HWY_NAMESPACE::Vec<decltype(tag)>{v}).raw;
  }
}

/// The smaller of a lane and a number.
template <class Vector>
HWY_INLINE Vector smaller(const Vector& v, float number) {
  if constexpr (kIsTwo<Vector>) {
    return {smaller(v.low, number), smaller(v.high, number)};
  } else if constexpr (sizeof(Vector) > HWY_MAX_BYTES) {
    return v < number ? v : number - Vector{};  // no instruction set at all
  } else {
    const hwy::HWY_NAMESPACE::FixedTag<float, sizeof(Vector) / sizeof(float)> tag;
    using Wide = hwy::HWY_NAMESPACE::Vec<decltype(tag)>;
    return hwy::HWY_NAMESPACE::Min(Wide{v}, hwy::HWY_NAMESPACE::Set(tag, number)).raw;
  }
}

/// The number in all lanes.
template <class Vector>
HWY_INLINE Vector all(float number) {
  if constexpr (kIsTwo<Vector>)
    return {all<decltype(Vector::low)>(number), all<decltype(Vector::low)>(number)};
  else
    return number - Vector{};  // which compilers see through, as they do not through 0 + number
}

/// Lane by lane: a where the mask is true, else b.
template <class Mask, class Vector>
HWY_INLINE Vector choose(const Mask& mask, const Vector& a, const Vector& b) {
  if constexpr (kIsTwo<Vector>)
    return {choose(mask.low, a.low, b.low), choose(mask.high, a.high, b.high)};
  else
    return mask ? a : b;
}

/// The vector of two halves, and the halves of one.
template <class Half>
HWY_INLINE auto joined(const Half& a, const Half& b) {
  if constexpr (2 * sizeof(Half) > HWY_MAX_BYTES)
    return Two<Half>{a, b};
  else if constexpr (sizeof(Half) == 16)
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7);
  else
    return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
}
template <int kFirst, class Vector>
HWY_INLINE auto lanes_from(const Vector& v) {
  if constexpr (sizeof(Vector) == 32)
    return __builtin_shufflevector(v, v, kFirst, kFirst + 1, kFirst + 2, kFirst + 3);
  else
    return __builtin_shufflevector(v, v, kFirst, kFirst + 1, kFirst + 2, kFirst + 3, kFirst + 4,
                                   kFirst + 5, kFirst + 6, kFirst + 7);
}
template <class Vector>
HWY_INLINE auto low_half(const Vector& v) {
  if constexpr (kIsTwo<Vector>)
    return v.low;
  else
    return lanes_from<0>(v);
}
template <class Vector>
HWY_INLINE auto high_half(const Vector& v) {
  if constexpr (kIsTwo<Vector>)
    return v.high;
  else
    return lanes_from<sizeof(Vector) / sizeof(float) / 2>(v);
}

template <class Vector>
HWY_INLINE auto lane(const Vector& v, int k) {
  if constexpr (kIsTwo<Vector>) {
    constexpr int kHalf = static_cast<int>(sizeof(v.low) / sizeof(float));
    return k < kHalf ? lane(v.low, k) : lane(v.high, k - kHalf);
  } else {
    return v[k];
  }
}

/// to = from, for copies from memory to memory. Where `from` is a Two, GCC copies it 16 bytes at a
/// time, and a register that is then loaded from two such stores waits until they are in the cache.
template <class Vector>
HWY_INLINE void copy(const Vector& from, Vector& to) {
  if constexpr (kIsTwo<Vector>) {
    copy(from.low, to.low);
    copy(from.high, to.high);
  } else {
    to = from;
  }
}

/// From and to memory of any alignment. Of registers by instructions, not by memcpy, whose argument
/// the compiler keeps in memory: a sum waited there for its own store at every step.
template <class Vector, class T>
HWY_INLINE void load(const T* from, Vector& v) {
  if constexpr (kIsTwo<Vector>) {
    load(from, v.low);
    load(from + sizeof(v.low) / sizeof(T), v.high);
  } else if constexpr (sizeof(Vector) > HWY_MAX_BYTES) {
    std::memcpy(&v, from, sizeof(v));
  } else {
    const hwy::HWY_NAMESPACE::FixedTag<T, sizeof(Vector) / sizeof(T)> tag;
    v = __builtin_bit_cast(Vector, hwy::HWY_NAMESPACE::LoadU(tag, from).raw);
  }
}
template <class Vector, class T>
HWY_INLINE void store(const Vector& v, T* to) {
  if constexpr (kIsTwo<Vector>) {
    store(v.low, to);
    store(v.high, to + sizeof(v.low) / sizeof(T));
  } else if constexpr (sizeof(Vector) > HWY_MAX_BYTES) {
    std::memcpy(to, &v, sizeof(v));
  } else {
    const hwy::HWY_NAMESPACE::FixedTag<T, sizeof(Vector) / sizeof(T)> tag;
    using Wide = hwy::HWY_NAMESPACE::Vec<decltype(tag)>;
    hwy::HWY_NAMESPACE::StoreU(Wide{__builtin_bit_cast(decltype(Wide::raw), v)}, tag, to);
  }
}
