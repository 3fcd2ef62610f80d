// Which blocks are most similar to a reference block. No include guard: stack_kernel.cpp includes
// it once per instruction set, inside that set's namespace, after the vectors it is written in.
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

/// Pixels between the blocks of a search: a period of the layout, or job.far_step of them.
struct Spacing {
  int rows, cols;
  Spacing(const StackJob& job, int periods)
      : rows(job.period_rows * periods), cols(job.period_cols * periods) {}
};

/// How far the search window reaches from a reference, in steps of its spacing.
struct Window {
  int up, down, left, right;
  Window(const StackJob& job, const Spacing& spacing, int block, int row, int col) {
    const auto steps = [&](int room, int step) { return std::min(job.search, room / step); };
    up = steps(row, spacing.rows);
    left = steps(col, spacing.cols);
    down = steps(job.rows - block - row, spacing.rows);
    right = steps(job.cols - block - col, spacing.cols);
  }
  int rows() const { return up + down + 1; }
  int cols() const { return left + right + 1; }
  /// Of candidates per row: whole vectors, the last of which may be a half.
  int slots() const { return (cols() + 7) / 8 * 8; }
};

/// The guide around some references, pixels that are a search's spacing apart side by side: so are
/// the pixels that one pixel of a reference is compared with.
class Lattices {
 public:
  Lattices(const StackJob& job, const Spacing& spacing, const ReferenceBlock& block, int side)
      : spacing_(spacing),
        row_(std::max(block.row_begin - job.search * spacing.rows, 0)),
        col_(std::max(block.col_begin - job.search * spacing.cols, 0)) {
    const int rows = std::min(block.row_end + side + job.search * spacing.rows, job.rows) - row_;
    const int cols = std::min(block.col_end + side + job.search * spacing.cols, job.cols) - col_;
    pitch_ = (cols + spacing.cols - 1) / spacing.cols;
    size_ = pitch_ * ((rows + spacing.rows - 1) / spacing.rows);
    values_.resize(static_cast<std::size_t>(size_ * spacing.rows * spacing.cols) + kLanes);
    for (int r = 0; r < rows; ++r) {
      const float* from = job.guide + (row_ + r) * job.stride + col_;
      float* to = values_.data() + row_part(row_ + r);
      for (int phase = 0; phase < spacing.cols; ++phase, to += size_)
        for (int c = phase, i = 0; c < cols; c += spacing.cols, ++i) to[i] = from[c];
    }
  }
  /// Where a pixel of the tile is: at values() + row_part(row) + col_part(col).
  std::ptrdiff_t row_part(int row) const {
    const int r = row - row_;
    return r % spacing_.rows * spacing_.cols * size_ + r / spacing_.rows * pitch_;
  }
  std::ptrdiff_t col_part(int col) const {
    return (col - col_) % spacing_.cols * size_ + (col - col_) / spacing_.cols;
  }
  const float* values() const { return values_.data(); }
  std::ptrdiff_t pitch() const { return pitch_; }
  const Spacing& spacing() const { return spacing_; }

 private:
  Spacing spacing_;
  int row_, col_;
  std::ptrdiff_t pitch_, size_;
  std::vector<float> values_;
};

/// One block and where its pixels' lattices begin in the window.
template <int kBlock>
struct Reference {
  const float* pixels;
  std::ptrdiff_t stride, row_part[kBlock], col_part[kBlock];
};

/// Squared distances of as many candidates of each row as a vector holds, times a factor, seven
/// rows at a time.
template <class Vector, class Keys, int kBlock>
HWY_INLINE void measure_strip(const Reference<kBlock>& reference, const Lattices& lattices,
                              const Window& window, int first, float factor, std::int32_t* found) {
  constexpr int kRows = 7, kWidth = sizeof(Vector) / sizeof(float);
  std::int32_t numbers[kWidth];
  std::iota(numbers, numbers + kWidth, first);
  Keys number;
  load(numbers, number);
  const auto there = number < window.cols();
  for (int top = 0; top < window.rows(); top += kRows) {
    std::ptrdiff_t at[kRows];
    Vector sums[kRows] = {};
    for (int i = 0; i < kRows; ++i)
      at[i] = std::min(top + i, window.rows() - 1) * lattices.pitch() + first;
    for (int r = 0; r < kBlock; ++r)
      for (int c = 0; c < kBlock; ++c) {
        const Vector pixel = all<Vector>(reference.pixels[r * reference.stride + c]);
        const float* lattice = lattices.values() + reference.row_part[r] + reference.col_part[c];
        for (int i = 0; i < kRows; ++i) {
          Vector difference;
          load(lattice + at[i], difference);
          difference -= pixel;
          sums[i] = fused(difference, difference, sums[i]);
        }
      }
    for (int i = 0; i < kRows; ++i) {
      if (top + i >= window.rows()) continue;  // the loop's bounds are fixed: sums stay registers
      sums[i] *= all<Vector>(factor);
      Keys keys, none{};
      std::memcpy(&keys, &sums[i], sizeof(keys));
      keys &= std::numeric_limits<std::int32_t>::max();  // what is no number has a sign
      store(choose(there, keys, none + (kFarthest + 1)),
            found + (top + i) * window.slots() + first);
    }
  }
}

/// Adds all blocks in the window with their squared distances times a factor; returns the window.
template <int kBlock>
HWY_INLINE Window measure(const StackJob& job, int row, int col, const Lattices& lattices,
                          float factor, Candidates& found) {
  const Spacing& spacing = lattices.spacing();
  const Window window(job, spacing, kBlock, row, col);
  std::int32_t* const keys = &found.keys[static_cast<std::size_t>(found.slots)];
  Reference<kBlock> reference;
  reference.pixels = job.guide + row * job.stride + col;
  reference.stride = job.stride;
  for (int i = 0; i < kBlock; ++i) {
    reference.row_part[i] = lattices.row_part(row - window.up * spacing.rows + i);
    reference.col_part[i] = lattices.col_part(col - window.left * spacing.cols + i);
  }
  int first = 0;
  for (; first + 8 < window.slots(); first += 16)
    measure_strip<Floats, Ints>(reference, lattices, window, first, factor, keys);
  if (first < window.slots())
    measure_strip<Floats8, Ints8>(reference, lattices, window, first, factor, keys);
  for (int y = 0, slot = found.slots; y < window.rows(); ++y)
    for (int x = 0; x < window.slots(); ++x, ++slot)
      found.places[static_cast<std::size_t>(slot)] =
          static_cast<std::int32_t>((y - window.up) * spacing.rows * job.stride) +
          (x - window.left) * spacing.cols;
  found.set_count(found.count + window.rows() * window.cols(),
                  found.slots + window.rows() * window.slots());
  return window;
}

/// Distances count for so much in the wide search: a picture's far blocks are alike by chance,
/// those of what repeats are by more than that (docs/denoising-experiments.md, "A wider search").
constexpr float kFarFactor = 1.25f;

/// Every block that the two searches hold, once.
template <int kBlock>
HWY_INLINE void measure_all(const StackJob& job, int row, int col, const Lattices& near,
                            const std::optional<Lattices>& far, Candidates& found) {
  found.set_count(0, 0);
  const Window window = measure<kBlock>(job, row, col, near, 1.0f, found);
  found.keys[static_cast<std::size_t>(window.up * window.slots() + window.left)] = kReference;
  if (!far) return;
  const int first = found.slots;
  const Window wide = measure<kBlock>(job, row, col, *far, kFarFactor, found);
  const int known = job.search / job.far_step;  // steps of the wide search within the near one
  const int up = std::min(known, wide.up), down = std::min(known, wide.down);
  const int left = std::min(known, wide.left), right = std::min(known, wide.right);
  for (int y = wide.up - up; y <= wide.up + down; ++y)
    std::fill_n(&found.keys[static_cast<std::size_t>(first + y * wide.slots() + wide.left - left)],
                left + right + 1, kFarthest + 1);
  found.set_count(found.count - (up + down + 1) * (left + right + 1), found.slots);
}

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

/// Moves blocks whose keys are at most `limit` to `near` and, where asked for, the others to
/// `rest`; returns how many are near.
template <bool kWithRest>
HWY_INLINE int split_at(const Candidates& from, std::int32_t limit, Candidates& near,
                        Candidates& rest) {
  std::size_t nearest = 0, others = 0;
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

/// Writes the offsets, the nearest first.
HWY_INLINE void sort(const Candidates& from, std::ptrdiff_t home, std::ptrdiff_t* sorted) {
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
    }
  }
}

/// What the search for one block needs, for all references of a thread.
struct Search {
  Lattices lattices;
  std::optional<Lattices> far;
  Candidates all, near, rest, nearest;
  std::vector<std::ptrdiff_t> matches;  ///< offsets of the blocks' first pixels
  Search(const StackJob& job, const ReferenceBlock& block, int side)
      : lattices(job, {job, 1}, block, side),
        all((job.far_step > 1 ? 2 : 1) * (2 * job.search + 1) * (2 * job.search + 8)),
        near(all.most()),
        rest(all.most()),
        nearest(all.most()) {
    if (job.far_step > 1) far.emplace(job, Spacing(job, job.far_step), block, side);
  }
};

/// The blocks most similar to one reference, the nearest first, in search.matches; returns how many
/// (a power of two). As many again follow, the next nearest in the order of the window, where there
/// are so many.
template <int kBlock>
HWY_INLINE int match(const StackJob& job, int row, int col, Search& search) {
  measure_all<kBlock>(job, row, col, search.lattices, search.far, search.all);
  int count = 1;
  while (2 * count <= std::min(job.stack, search.all.count)) count *= 2;
  const int wide = std::min(2 * count, search.all.count);
  split<false>(search.all, wide, search.near, search.rest);
  split<true>(search.near, count, search.nearest, search.rest);
  search.matches.resize(static_cast<std::size_t>(wide));
  const std::ptrdiff_t home = row * job.stride + col;
  sort(search.nearest, home, search.matches.data());
  std::transform(search.rest.places.begin(), search.rest.places.begin() + (wide - count),
                 search.matches.begin() + count,
                 [home](std::int32_t place) { return home + place; });
  return count;
}
