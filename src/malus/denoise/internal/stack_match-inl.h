// Which blocks are most similar to a reference block. No include guard: stack_kernel.cpp includes
// it once per instruction set, inside that set's namespace, after the selection.

/// Pixels between the blocks of a search: a period of the layout, or job.far_step of them.
struct Spacing {
  int rows, cols;
  Spacing(const StackJob& job, int periods)
      : rows(job.period_rows * periods), cols(job.period_cols * periods) {}
};

/// Where a search may find blocks, in pixels of the tile. Beyond the frame tiles hold no more than
/// the near search can reach.
struct Area {
  int top, left, bottom, right;
  static Area tile(const StackJob& job) { return {0, 0, job.rows, job.cols}; }
  static Area frame(const StackJob& job) {
    return {std::max(-job.row0, 0), std::max(-job.col0, 0),
            std::min(job.frame_rows - job.row0, job.rows),
            std::min(job.frame_cols - job.col0, job.cols)};
  }
};

/// How far the search window reaches from a reference, in steps of its spacing.
struct Window {
  int up, down, left, right;
  Window(const StackJob& job, const Spacing& spacing, const Area& area, int block, int row,
         int col) {
    const auto steps = [&](int room, int step) { return std::clamp(room / step, 0, job.search); };
    up = steps(row - area.top, spacing.rows);
    left = steps(col - area.left, spacing.cols);
    down = steps(area.bottom - block - row, spacing.rows);
    right = steps(area.right - block - col, spacing.cols);
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

/// The pixels of a block that the wide search compares: half of 8x8, a quarter of 16x16. Cells
/// differ in theirs, so that every channel is among them.
template <int kBlock>
constexpr bool is_sampled(int r, int c) {
  const int cell_row = r / kCell, cell_col = c / kCell;
  if (kBlock == 2 * kCell) return (r + c + cell_row + cell_col) % 2 == 0;
  return (r + cell_row) % 2 == 0 && (c + cell_col) % 2 == 0;
}
template <int kBlock>
constexpr float kSampledPart = kBlock == 2 * kCell ? 0.5f : 0.25f;

/// Squared distances of as many candidates of each row as a vector holds, times a factor, seven
/// rows at a time.
template <class Vector, class Keys, int kBlock, bool kSampled>
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
        if (kSampled && !is_sampled<kBlock>(r, c)) continue;
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

/// All blocks in the window with their squared distances times a factor; returns the window.
template <int kBlock, bool kSampled>
HWY_INLINE Window measure(const StackJob& job, int row, int col, const Lattices& lattices,
                          const Area& area, float factor, Candidates& found) {
  const Spacing& spacing = lattices.spacing();
  const Window window(job, spacing, area, kBlock, row, col);
  Reference<kBlock> reference;
  reference.pixels = job.guide + row * job.stride + col;
  reference.stride = job.stride;
  for (int i = 0; i < kBlock; ++i) {
    reference.row_part[i] = lattices.row_part(row - window.up * spacing.rows + i);
    reference.col_part[i] = lattices.col_part(col - window.left * spacing.cols + i);
  }
  int first = 0;
  for (; first + 8 < window.slots(); first += 16)
    measure_strip<Floats, Ints, kBlock, kSampled>(reference, lattices, window, first, factor,
                                                  found.keys.data());
  if (first < window.slots())
    measure_strip<Floats8, Ints8, kBlock, kSampled>(reference, lattices, window, first, factor,
                                                    found.keys.data());
  for (int y = 0, slot = 0; y < window.rows(); ++y)
    for (int x = 0; x < window.slots(); ++x, ++slot)
      found.places[static_cast<std::size_t>(slot)] =
          static_cast<std::int32_t>((y - window.up) * spacing.rows * job.stride) +
          (x - window.left) * spacing.cols;
  found.set_count(window.rows() * window.cols(), window.rows() * window.slots());
  return window;
}

/// Distances count for so much in the wide search: a picture's far blocks are alike by chance,
/// those of what repeats are by more than that (docs/repeating-structure.md).
constexpr float kFarFactor = 1.25f;

/// All blocks of the near search; the reference leads.
template <int kBlock>
HWY_INLINE void measure_near(const StackJob& job, int row, int col, const Lattices& near,
                             Candidates& found) {
  const Window window = measure<kBlock, false>(job, row, col, near, Area::tile(job), 1.0f, found);
  found.keys[static_cast<std::size_t>(window.up * window.slots() + window.left)] = kReference;
}

/// All blocks of the wide search that the near one does not hold.
template <int kBlock>
HWY_INLINE void measure_far(const StackJob& job, int row, int col, const Lattices& far,
                            Candidates& found) {
  const Window wide = measure<kBlock, true>(job, row, col, far, Area::frame(job),
                                            kFarFactor / kSampledPart<kBlock>, found);
  const int known = job.search / job.far_step;  // steps of the wide search within the near one
  const int up = std::min(known, wide.up), down = std::min(known, wide.down);
  const int left = std::min(known, wide.left), right = std::min(known, wide.right);
  for (int y = wide.up - up; y <= wide.up + down; ++y)
    std::fill_n(&found.keys[static_cast<std::size_t>(y * wide.slots() + wide.left - left)],
                left + right + 1, kFarthest + 1);
  found.set_count(found.count - (up + down + 1) * (left + right + 1), found.slots);
}

template <int kBlock>
HWY_INLINE float squared_distance(const float* a, const float* b, std::ptrdiff_t stride) {
  Floats8 sum{};
  for (int r = 0; r < kBlock; ++r)
    for (int c = 0; c < kBlock; c += 8) {
      Floats8 difference, other;
      load(a + r * stride + c, difference);
      load(b + r * stride + c, other);
      difference -= other;
      sum = fused(difference, difference, sum);
    }
  float lanes[8], total = 0;
  store(sum, lanes);
  for (const float lane : lanes) total += lane;
  return total;
}

/// Adds the blocks in the frame at the steps after which it repeats.
template <int kBlock>
HWY_INLINE void measure_repeats(const StackJob& job, int row, int col, Candidates& found) {
  const Area area = Area::frame(job);
  const float* reference = job.guide + row * job.stride + col;
  int slots = found.slots;
  for (const RepeatStep& step : job.repeats.at(job.row0 + row, job.col0 + col)) {
    const int top = row + step.rows, left = col + step.cols;
    if (top < area.top || left < area.left || top + kBlock > area.bottom ||
        left + kBlock > area.right)
      continue;
    const auto offset = static_cast<std::int32_t>(step.rows * job.stride) + step.cols;
    const float distance =
        kFarFactor * squared_distance<kBlock>(reference, reference + offset, job.stride);
    found.put(slots++,
              std::bit_cast<std::int32_t>(distance) & std::numeric_limits<std::int32_t>::max(),
              offset);
  }
  found.set_count(found.count + slots - found.slots, slots);
}

/// What the search for one block needs, for all references of a thread.
struct Search {
  Lattices lattices;
  std::optional<Lattices> far;
  Candidates all, wide, near, rest, nearest;
  std::vector<std::ptrdiff_t> matches;  ///< offsets of the blocks' first pixels
  Search(const StackJob& job, const ReferenceBlock& block, int side)
      : lattices(job, {job, 1}, block, side),
        all((2 * job.search + 1) * (2 * job.search + 8)),
        wide(all.most() + kMostRepeatSteps),
        near(2 * all.most()),
        rest(2 * all.most()),
        nearest(2 * all.most()) {
    if (job.far_step > 1) far.emplace(job, Spacing(job, job.far_step), block, side);
  }
};

/// Twice the stack's nearest blocks of both searches, or as many as there are, in the order of the
/// windows: to search.nearest. Returns how many both hold.
template <int kBlock>
HWY_INLINE int find_nearest(const StackJob& job, int row, int col, Search& search) {
  const int wanted = 2 * job.stack;
  measure_near<kBlock>(job, row, col, search.lattices, search.all);
  const int near = std::min(wanted, search.all.count);
  split<false>(search.all, near, search.nearest, search.rest);
  if (!search.far) return search.all.count;
  measure_far<kBlock>(job, row, col, *search.far, search.wide);
  measure_repeats<kBlock>(job, row, col, search.wide);
  // Of equal distances the near block comes first, so far ones must be nearer than all of them.
  std::int32_t limit = kFarthest;
  if (near == wanted)
    limit = *std::max_element(search.nearest.keys.begin(), search.nearest.keys.begin() + near) - 1;
  const int both = split_at<false>(search.wide, limit, search.nearest, search.rest);
  search.nearest.set_count(both, both);
  if (both > near) {
    split<false>(search.nearest, std::min(wanted, both), search.near, search.rest);
    std::swap(search.nearest, search.near);
  }
  return search.all.count + search.wide.count;
}

// A stack ends where twice as many blocks would be this many times as far, and that further than
// what noise in the guide makes of equal blocks [noise variances per pixel]: what repeats has few
// true copies, and the rest of a full stack is unlike them. On a slope, where blocks of one height
// lie along a line, twice as many are 4 times as far. Measured (docs/repeating-structure.md).
constexpr float kUnlike = 4.5f, kLeastDistance = 0.3f;
constexpr int kLeastStack = 8;

/// How many of a stack's blocks, the nearest first, are alike: a power of two.
template <int kBlock>
HWY_INLINE int alike(const std::int32_t* keys, int count) {
  const auto distance = [&](int place) { return std::bit_cast<float>(std::max(keys[place], 0)); };
  for (int n = kLeastStack; n < count; n *= 2)
    if (distance(2 * n - 1) > kUnlike * std::max(distance(n - 1), kLeastDistance * kBlock * kBlock))
      return n;
  return count;
}

/// The blocks most similar to one reference, the nearest first, in search.matches; returns how many
/// (a power of two). As many again follow, the next nearest, where there are enough.
template <int kBlock>
HWY_INLINE int match(const StackJob& job, int row, int col, Search& search) {
  const int there = find_nearest<kBlock>(job, row, col, search);
  int count = 1;
  while (2 * count <= std::min(job.stack, there)) count *= 2;
  const int wide = std::min(2 * count, there);
  if (search.nearest.count > wide) {
    split<false>(search.nearest, wide, search.near, search.rest);
    std::swap(search.nearest, search.near);
  }
  split<true>(search.nearest, count, search.near, search.rest);
  search.matches.resize(static_cast<std::size_t>(wide));
  const std::ptrdiff_t home = row * job.stride + col;
  std::int32_t keys[kMaxStack];
  sort(search.near, home, search.matches.data(), keys);
  const int members = alike<kBlock>(keys, count);
  if (members < count) {
    search.matches.resize(static_cast<std::size_t>(2 * members));
    return members;
  }
  std::transform(search.rest.places.begin(), search.rest.places.begin() + (wide - count),
                 search.matches.begin() + count,
                 [home](std::int32_t place) { return home + place; });
  return count;
}
