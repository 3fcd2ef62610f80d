// The nearest of many candidates, by counting instead of sorting. No include guard:
// stack_kernel.cpp includes it once per instruction set, inside that set's namespace, after the
// vectors it is written in.
//
// Distances are compared as whole numbers: bits of floats that are not negative have their order.

constexpr std::int32_t kReference = -1;  ///< the reference's own key: it always leads
constexpr std::int32_t kFarthest = std::numeric_limits<std::int32_t>::max() - 1;

/// Blocks in the order of the search window; keys are readable to the end of their last vector and
/// there, and where a slot holds no block, greater than any distance.
struct Candidates {
  std::vector<std::int32_t> keys, places;  ///< places: offsets from the reference
  int slots = 0, count = 0;                ///< count: blocks

  explicit Candidates(int most)
      : keys(static_cast<std::size_t>(most + 2 * kLanes)), places(keys.size()) {}
  int most() const { return static_cast<int>(keys.size()) - 2 * kLanes; }
  void put(int at, std::int32_t key, std::int32_t place) {
    keys[static_cast<std::size_t>(at)] = key;
    places[static_cast<std::size_t>(at)] = place;
  }
  void set_count(int n, int all_slots) {
    count = n;
    slots = all_slots;
    std::fill_n(keys.begin() + all_slots, kLanes, kFarthest + 1);
  }
};

/// Sums of lanes 4 apart: a quarter of the vector.
template <class Vector>
HWY_INLINE auto quarter_sums(const Vector& v) {
  if constexpr (sizeof(v) == sizeof(Floats4))
    return v;
  else
    return quarter_sums(low_half(v) + high_half(v));
}

/// How many keys are at most `limit`.
HWY_INLINE int count_up_to(const Candidates& from, std::int32_t limit) {
  Ints sum{};
  for (int i = 0; i < from.slots; i += kLanes) {
    Ints keys;
    load(&from.keys[static_cast<std::size_t>(i)], keys);
    sum -= keys <= limit;  // true is -1
  }
  const Ints4 quarter = quarter_sums(sum);
  return quarter[0] + quarter[1] + quarter[2] + quarter[3];
}

/// Adds blocks whose keys are at most `limit` to `near`, which has no empty slots, and moves, where
/// asked for, the others to `rest`; returns how many are near.
template <bool kWithRest>
HWY_INLINE int split_at(const Candidates& from, std::int32_t limit, Candidates& near,
                        Candidates& rest) {
  std::size_t nearest = static_cast<std::size_t>(near.count), others = 0;
  if constexpr (HWY_MAX_BYTES == sizeof(Ints)) {
    namespace hn = hwy::HWY_NAMESPACE;
    const hn::CappedTag<std::int32_t, kLanes> tag;
    for (std::size_t i = 0; i < static_cast<std::size_t>(from.slots); i += hn::Lanes(tag)) {
      const auto keys = hn::LoadU(tag, &from.keys[i]), places = hn::LoadU(tag, &from.places[i]);
      const auto leave = hn::Gt(keys, hn::Set(tag, limit)), take = hn::Not(leave);
      hn::StoreU(hn::Compress(keys, take), tag, &near.keys[nearest]);
      hn::StoreU(hn::Compress(places, take), tag, &near.places[nearest]);
      const std::size_t taken = hn::CountTrue(tag, take);
      if constexpr (kWithRest) {
        hn::StoreU(hn::Compress(keys, leave), tag, &rest.keys[others]);
        hn::StoreU(hn::Compress(places, leave), tag, &rest.places[others]);
      }
      nearest += taken;
      others += hn::Lanes(tag) - taken;
    }
  } else {  // one by one is faster than what replaces an instruction for it
    for (std::size_t i = 0; i < static_cast<std::size_t>(from.slots); ++i) {
      const bool take = from.keys[i] <= limit;
      near.keys[nearest] = from.keys[i];
      near.places[nearest] = from.places[i];
      nearest += take;
      if constexpr (kWithRest) {
        rest.keys[others] = from.keys[i];
        rest.places[others] = from.places[i];
        others += !take;
      }
    }
  }
  return static_cast<int>(nearest);
}

/// Moves the `wanted` nearest to `near` and, where asked for, the others to `rest`, both in the
/// order of the window; the others only of candidates without empty slots. Of equal distances the
/// earlier block is the nearer.
template <bool kWithRest>
HWY_INLINE void split(const Candidates& from, int wanted, Candidates& near, Candidates& rest) {
  // Fewer than wanted keys are up to low, `below`; at least as many are up to high.
  std::int32_t low = kReference - 1, high = kFarthest;
  int below = 0, up_to = from.count;
  near.set_count(0, 0);
  while (low + 1 < high && up_to != wanted) {
    const std::int32_t middle = std::midpoint(low, high);  // does not overflow
    const int many = count_up_to(from, middle);
    (many < wanted ? low : high) = middle;
    (many < wanted ? below : up_to) = many;
  }
  int nearest = 0;
  if (up_to == wanted) {
    nearest = split_at<kWithRest>(from, high, near, rest);
  } else {
    int room = wanted - below, others = 0;  // room: for those at high, all equally far
    for (std::size_t i = 0; i < static_cast<std::size_t>(from.slots); ++i) {
      const std::int32_t key = from.keys[i];
      if (key <= low || (key == high && room-- > 0))
        near.put(nearest++, key, from.places[i]);
      else if constexpr (kWithRest)
        rest.put(others++, key, from.places[i]);
    }
  }
  near.set_count(nearest, nearest);
  if constexpr (kWithRest) rest.set_count(from.count - nearest, from.count - nearest);
}

/// Writes offsets and keys, the nearest first.
HWY_INLINE void sort(const Candidates& from, std::ptrdiff_t home, std::ptrdiff_t* sorted,
                     std::int32_t* sorted_keys) {
  constexpr std::ptrdiff_t kFree = std::numeric_limits<std::ptrdiff_t>::min();
  std::fill_n(sorted, from.count, kFree);
  for (int first = 0; first < from.count; first += kLanes) {
    Ints keys, rank{};
    load(&from.keys[static_cast<std::size_t>(first)], keys);
    for (int k = 0; k < from.count; ++k) rank -= from.keys[static_cast<std::size_t>(k)] < keys;
    for (int i = 0; i < std::min(kLanes, from.count - first); ++i) {
      int place = lane(rank, i);
      while (sorted[place] != kFree) ++place;  // of equal ones the earlier leads
      sorted[place] = home + from.places[static_cast<std::size_t>(first + i)];
      sorted_keys[place] = from.keys[static_cast<std::size_t>(first + i)];
    }
  }
}
