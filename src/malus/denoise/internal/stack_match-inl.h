// Which blocks are most similar to a reference block. No include guard: stack_kernel.cpp includes
// it once per instruction set, inside that set's namespace, after the vectors it is written in.
//
// Distances are compared as whole numbers: bits of floats that are not negative have their order.

constexpr std::int32_t kReference = -1;  ///< the reference's own key: it always leads
constexpr std::int32_t kFarthest = std::numeric_limits<std::int32_t>::max() - 1;

/// Blocks in the order of the search window; keys are readable to the end of their last vector and
/// there greater than any distance.
struct Candidates {
  std::vector<std::int32_t> keys;
  std::vector<std::ptrdiff_t> offsets;
  int count = 0;

  explicit Candidates(int most)
      : keys(static_cast<std::size_t>(most + 2 * kLanes)), offsets(keys.size()) {}
  int most() const { return static_cast<int>(keys.size()) - 2 * kLanes; }
  void put(int at, std::int32_t key, std::ptrdiff_t offset) {
    keys[static_cast<std::size_t>(at)] = key;
    offsets[static_cast<std::size_t>(at)] = offset;
  }
  void set_count(int n) {
    count = n;
    std::fill_n(keys.begin() + n, kLanes, kFarthest + 1);
  }
};

/// A block's rows, two of 8 pixels or parts of one of 16 to a vector.
template <int kBlock>
HWY_INLINE Floats load_part(const float* block, std::ptrdiff_t stride, int part) {
  if constexpr (kBlock == 8) {
    Floats8 top, bottom;
    load(block + 2 * part * stride, top);
    load(block + (2 * part + 1) * stride, bottom);
    return joined(top, bottom);
  } else {
    constexpr int kParts = kBlock / kLanes;
    Floats values;
    load(block + part / kParts * stride + part % kParts * kLanes, values);
    return values;
  }
}

/// Sums of lanes 4 apart: a quarter of the vector.
template <class Vector>
HWY_INLINE auto quarter_sums(const Vector& v) {
  if constexpr (sizeof(v) == sizeof(Floats4))
    return v;
  else
    return quarter_sums(low_half(v) + high_half(v));
}

/// The sums of four vectors.
HWY_INLINE Floats4 four_sums(const Floats (&v)[4]) {
  const Floats4 a = quarter_sums(v[0]), b = quarter_sums(v[1]), c = quarter_sums(v[2]),
                d = quarter_sums(v[3]);
  const Floats4 ab = __builtin_shufflevector(a, b, 0, 4, 1, 5) +
                     __builtin_shufflevector(a, b, 2, 6, 3, 7),
                cd = __builtin_shufflevector(c, d, 0, 4, 1, 5) +
                     __builtin_shufflevector(c, d, 2, 6, 3, 7);
  return __builtin_shufflevector(ab, cd, 0, 1, 4, 5) + __builtin_shufflevector(ab, cd, 2, 3, 6, 7);
}

/// Squared distances of all blocks in the window, four blocks at a time.
template <int kBlock>
HWY_INLINE void measure(const StackJob& job, int row, int col, Candidates& found) {
  constexpr int kParts = kBlock * kBlock / kLanes;
  const auto steps = [&](int room, int period) { return std::min(job.search, room / period); };
  const int up = steps(row, job.period_rows), left = steps(col, job.period_cols),
            down = steps(job.rows - kBlock - row, job.period_rows),
            right = steps(job.cols - kBlock - col, job.period_cols), across = left + right + 1;
  const std::ptrdiff_t home = row * job.stride + col;
  Floats reference[kParts];
  for (int p = 0; p < kParts; ++p)
    reference[p] = load_part<kBlock>(job.guide + home, job.stride, p);
  int count = 0;
  for (int y = -up; y <= down; ++y) {
    const std::ptrdiff_t first = home + y * job.period_rows * job.stride - left * job.period_cols;
    for (int x = 0; x < across; x += 4, count += 4) {
      Floats squares[4] = {};
      for (int i = 0; i < 4; ++i) {
        const std::ptrdiff_t offset = first + std::min(x + i, across - 1) * job.period_cols;
        for (int p = 0; p < kParts; ++p) {
          const Floats d = load_part<kBlock>(job.guide + offset, job.stride, p) - reference[p];
          squares[i] += d * d;
        }
        found.offsets[static_cast<std::size_t>(count + i)] = offset;
      }
      const Floats4 sums = four_sums(squares);
      Ints4 keys;
      std::memcpy(&keys, &sums, sizeof(keys));
      keys &= std::numeric_limits<std::int32_t>::max();  // what is no number has a sign
      store(keys, &found.keys[static_cast<std::size_t>(count)]);
    }
    count -= (4 - across % 4) % 4;  // the last block again
  }
  found.keys[static_cast<std::size_t>(up * across + left)] = kReference;
  found.set_count(count);
}

/// How many keys are at most `limit`.
HWY_INLINE int count_up_to(const Candidates& from, std::int32_t limit) {
  Ints sum{};
  for (int i = 0; i < from.count; i += kLanes) {
    Ints keys;
    load(&from.keys[static_cast<std::size_t>(i)], keys);
    sum -= keys <= limit;  // true is -1
  }
  const Ints4 quarter = quarter_sums(sum);
  return quarter[0] + quarter[1] + quarter[2] + quarter[3];
}

/// Moves the `wanted` nearest to `near` and, where asked for, the others to `rest`, both in the
/// order of the window. Of equal distances the earlier block is the nearer.
template <bool kWithRest>
HWY_INLINE void split(const Candidates& from, int wanted, Candidates& near, Candidates& rest) {
  // Fewer than wanted keys are up to low, `below`; at least as many are up to high.
  std::int32_t low = kReference - 1, high = kFarthest;
  int below = 0, up_to = from.count;
  while (low + 1 < high && up_to != wanted) {
    const std::int32_t middle = std::midpoint(low, high);  // does not overflow
    const int many = count_up_to(from, middle);
    (many < wanted ? low : high) = middle;
    (many < wanted ? below : up_to) = many;
  }
  int room = wanted - below, nearest = 0, others = 0;  // room: for those above low
  for (std::size_t i = 0; i < static_cast<std::size_t>(from.count); ++i) {
    const std::int32_t key = from.keys[i];
    const bool last = key > low && key <= high, take = key <= low || (last && room > 0);
    room -= last;
    near.put(nearest, key, from.offsets[i]);
    nearest += take;
    if constexpr (kWithRest) {
      rest.put(others, key, from.offsets[i]);
      others += !take;
    }
  }
  near.set_count(nearest);
  rest.set_count(others);
}

/// Writes the offsets, the nearest first.
HWY_INLINE void sort(const Candidates& from, std::ptrdiff_t* sorted) {
  constexpr std::ptrdiff_t kFree = std::numeric_limits<std::ptrdiff_t>::min();
  std::fill_n(sorted, from.count, kFree);
  for (int first = 0; first < from.count; first += kLanes) {
    Ints keys, rank{};
    load(&from.keys[static_cast<std::size_t>(first)], keys);
    for (int k = 0; k < from.count; ++k) rank -= from.keys[static_cast<std::size_t>(k)] < keys;
    for (int i = 0; i < std::min(kLanes, from.count - first); ++i) {
      int place = lane(rank, i);
      while (sorted[place] != kFree) ++place;  // of equal ones the earlier leads
      sorted[place] = from.offsets[static_cast<std::size_t>(first + i)];
    }
  }
}

/// What the search for one block needs, for all references of a thread.
struct Search {
  Candidates all, near, rest, nearest;
  std::vector<std::ptrdiff_t> matches;  ///< offsets of the blocks' first pixels
  explicit Search(const StackJob& job)
      : all((2 * job.search + 1) * (2 * job.search + 1)),
        near(all.most()),
        rest(all.most()),
        nearest(all.most()) {}
};

/// The blocks most similar to one reference, the nearest first, in search.matches; returns how many
/// (a power of two). As many again follow, the next nearest in the order of the window, where there
/// are so many.
template <int kBlock>
HWY_INLINE int match(const StackJob& job, int row, int col, Search& search) {
  measure<kBlock>(job, row, col, search.all);
  int count = 1;
  while (2 * count <= std::min(job.stack, search.all.count)) count *= 2;
  const int wide = std::min(2 * count, search.all.count);
  split<false>(search.all, wide, search.near, search.rest);
  split<true>(search.near, count, search.nearest, search.rest);
  search.matches.resize(static_cast<std::size_t>(wide));
  sort(search.nearest, search.matches.data());
  std::copy_n(search.rest.offsets.begin(), wide - count, search.matches.begin() + count);
  return count;
}
