// The linear combinations of a stack's blocks. No include guard: stack_kernel.cpp includes it once
// per instruction set, inside that set's namespace, after the vectors it is written in.
//
// Every block is estimated by a linear combination of all blocks of its stack; weights are those of
// least expected squared error, had the clean stack the pilot's second moments (NL-Ridge:
// Herbreteau and Kervrann, "Towards a unified view of unsupervised non-local methods for image
// denoising", ICIP 2022). With one column per block, P the pilot, Y the samples of unit noise, d
// rows each:
//   X = Y K,  K = P^T M P,  M = (P P^T + D I)^-1,  D = d / kPilotShare.
// Weights for all components together would follow the brightness alone, so every four components
// have their own: d = 16 values, the four components of a block's four cells, are one vector.
// Written with R = Y - P as X = P - (D I - R P^T) M P it stays exact where samples are bright.

constexpr int kQuarters = 4;  ///< components share their weights by fours
// The pilot's energy is this share signal, the rest noise that it has kept: measured
// (docs/denoising-experiments.md, "Combinations").
constexpr float kPilotShare = 0.7f;
// One set of weights lets noise through in all 16 values, also in those that hold no signal: in
// even areas all but one. So every value has a gain besides, q² / (q² + 1), q its energy in the
// pilot over this share of the noise: measured too. Wiener's q / (q + 1) takes more of fine detail.
constexpr float kNoiseShare = 0.8f;
constexpr float kLeastNoise = 1e-6f;  // where neither signal nor noise is left

/// Four components of a block's four cells as one vector.
HWY_INLINE Floats quarter_of(const Floats* cells, int quarter) {
  Floats4 part[kQuarters];
  for (int i = 0; i < kQuarters; ++i)
    load(reinterpret_cast<const float*>(cells + i) + kQuarters * quarter, part[i]);
  return joined(joined(part[0], part[1]), joined(part[2], part[3]));
}

HWY_INLINE void set_quarter(const Floats& values, int quarter, Floats* cells) {
  const auto top = low_half(values), bottom = high_half(values);
  const Floats4 part[kQuarters] = {low_half(top), high_half(top), low_half(bottom),
                                   high_half(bottom)};
  for (int i = 0; i < kQuarters; ++i)
    store(part[i], reinterpret_cast<float*>(cells + i) + kQuarters * quarter);
}

/// m -> its inverse (Gauss and Jordan, in place). m is symmetric; its pivots are at least `least`,
/// which rounding may not see.
HWY_INLINE void invert(CellMatrix& m, float least) {
  for (std::size_t k = 0; k < kLanes; ++k) {
    const float pivot = 1.0f / std::max(m[k][k], least);
    m[k][k] = 1.0f;
    Floats row;
    load(m[k].data(), row);
    row *= pivot;
    store(row, m[k].data());
    for (std::size_t i = 0; i < kLanes; ++i) {
      if (i == k) continue;
      const float factor = m[i][k];
      m[i][k] = 0;
      Floats other;
      load(m[i].data(), other);
      other -= factor * row;
      store(other, m[i].data());
    }
  }
}

/// Combines one quarter of all blocks. Returns the sum of its squared weights, ||K||^2.
HWY_INLINE float combine_quarter(Floats* cells, const Floats* pilot, int count, int quarter) {
  constexpr float kDiagonal = kLanes / kPilotShare;
  Floats p[kMaxStack], r[kMaxStack];
  for (int n = 0; n < count; ++n) {
    p[n] = quarter_of(pilot + n * kQuarters, quarter);
    r[n] = quarter_of(cells + n * kQuarters, quarter) - p[n];
  }
  CellMatrix inverse = products(p, p, count), shift = products(p, r, count);
  for (std::size_t i = 0; i < kLanes; ++i) {
    inverse[i][i] += kDiagonal;
    for (float& value : shift[i]) value = -value;
    shift[i][i] += kDiagonal;
  }
  invert(inverse, kDiagonal);
  Floats step[kLanes], squares{};
  float trace = 0;
  for (std::size_t i = 0; i < kLanes; ++i) {
    load(inverse[i].data(), step[i]);
    squares += step[i] * step[i];
    trace += inverse[i][i];
  }
  rotate(step, kLanes, shift);
  CellMatrix to_step;
  for (std::size_t i = 0; i < kLanes; ++i) store(step[i], to_step[i].data());
  // K has the eigenvalues of I - D M that are not zero.
  const float squared_weights =
      std::max(kLanes - 2 * kDiagonal * trace + kDiagonal * kDiagonal * lane_sum(squares), 0.0f);
  Floats moved[kMaxStack], energy{};
  for (int n = 0; n < count; ++n) energy += p[n] * p[n];
  const Floats ratio = energy / (kNoiseShare * squared_weights + kLeastNoise);
  const Floats gain = ratio * ratio / (ratio * ratio + 1.0f);
  std::copy_n(p, count, moved);
  rotate(moved, count, to_step);
  for (int n = 0; n < count; ++n)
    set_quarter(gain * (p[n] - moved[n]), quarter, cells + n * kQuarters);
  return squared_weights * lane_sum(gain * gain) / kLanes;
}

/// The expected squared error as the Wiener filter with the same pilot would have it: K itself,
/// made of a pilot that knows these samples, tells far too little (docs/denoising.md,
/// "Uncertainty"). Blocks in their transform; `spare` has room for both stacks.
HWY_INLINE Floats wiener_error(const Floats* cells, const Floats* pilot, int count, Floats* spare) {
  const int total = count * kQuarters;
  Floats* spare_pilot = spare + total;
  std::copy_n(cells, total, spare);
  std::copy_n(pilot, total, spare_pilot);
  for (int i = 0; i < kQuarters; ++i) {
    haar(spare + i, count, kQuarters);
    haar(spare_pilot + i, count, kQuarters);
  }
  return shrink_wiener<kQuarters>(spare, spare_pilot, count).error;
}

/// Blocks of 2x2 cells after the rotation. K does not change with the blocks' transform, but a
/// bright block's cells are nearly equal: their products as floats would not tell how they differ.
HWY_INLINE Shrinkage combine_blocks(const StackJob& job, int count, Floats* cells, Floats* pilot,
                                    Floats* spare) {
  transform_blocks<2>(cells, count, job, false);
  transform_blocks<2>(pilot, count, job, false);
  Shrinkage result{};
  if (job.error) result.error = wiener_error(cells, pilot, count, spare);
  float squares = 0;  // each of the kLanes values of a quarter has the same weights
  for (int quarter = 0; quarter < kQuarters; ++quarter)
    squares += kLanes * combine_quarter(cells, pilot, count, quarter);
  result.weight = stack_weight(squares);
  transform_blocks<2>(cells, count, job, true);
  return result;
}
