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
constexpr float kDiagonal = kLanes / kPilotShare;  // D
// One set of weights lets noise through in all 16 values, also in those that hold no signal: in
// even areas all but one. So every value has a gain besides, q² / (q² + 1), q its energy in the
// pilot over this share of the noise: measured too. Wiener's q / (q + 1) takes more of fine detail.
constexpr float kNoiseShare = 0.8f;
constexpr float kLeastNoise = 1e-6f;  // where neither signal nor noise is left

/// Four components of a block's four cells as one vector.
HWY_INLINE Floats quarter_of(const Floats* cells, int quarter) {
  Floats4 part[kQuarters];
  for (int i = 0; i < kQuarters; ++i) load(lanes_of(cells[i]) + kQuarters * quarter, part[i]);
  return joined(joined(part[0], part[1]), joined(part[2], part[3]));
}

/// Cells of a block to its quarters, or back.
HWY_INLINE void swap_cells_and_quarters(Floats* block) {
  Floats swapped[kQuarters];
  for (int i = 0; i < kQuarters; ++i) swapped[i] = quarter_of(block, i);
  std::copy_n(swapped, kQuarters, block);
}

/// m -> minus its inverse, for matrices that are symmetric and whose pivots are at least `least`,
/// which rounding may not see. All at once, since every step waits for the one before. (The sweep
/// operator: Goodnight, "A tutorial on the SWEEP operator", Am. Stat. 33(3), 1979.)
HWY_INLINE void invert(CellMatrix (&matrices)[kQuarters], float least) {
  const Floats zero{};
  for (std::size_t k = 0; k < kLanes; ++k)
    for (CellMatrix& m : matrices) {
      const float pivot = 1.0f / std::max(m[k][k], least);
      const auto here = row_of(kIdentity, k) > zero;
      const Floats row = choose(here, all<Floats>(pivot), row_of(m, k) * -pivot);
      for (std::size_t i = 0; i < kLanes; ++i) {
        const Floats others = choose(here, zero, row_of(m, i));
        store(fused(all<Floats>(m[i][k]), row, others), m[i].data());
      }
      store(zero - row, m[k].data());
    }
}

/// Noise that a quarter lets through into every block. Block n has column n of K for its weights,
/// whose squares add up to p M p - p M D M p with its pilot p. negative: -M.
HWY_INLINE void noise_of_blocks(const Floats* pilot, int count, const CellMatrix& negative,
                                const Floats& gain, int quarter, Floats* passed) {
  const Floats squares = gain * gain;
  float shares[kQuarters] = {};  // of a component, mean over the block's four cells
  for (int i = 0; i < kLanes; ++i) shares[i % kQuarters] += lane(squares, i) / kQuarters;
  Floats solved[kMaxStack];
  for (int n = 0; n < count; ++n) solved[n] = pilot[n * kQuarters];
  rotate(solved, count, negative);
  for (int n = 0; n < count; ++n) {
    const Floats rest = pilot[n * kQuarters] + kDiagonal * solved[n];
    const float weights = std::max(-lane_sum(rest * solved[n]), 0.0f);
    float* to = reinterpret_cast<float*>(passed + n) + kQuarters * quarter;
    for (int k = 0; k < kQuarters; ++k) to[k] = weights * shares[k];
  }
}

/// Combines one quarter of all blocks. negative: -M; shift: R P^T - D I, transposed. Returns the
/// sum of its squared weights, ||K||^2. passed, when given: the noise let through into every block.
HWY_INLINE float combine_quarter(Floats* cells, const Floats* pilot, int count,
                                 const CellMatrix& negative, const CellMatrix& shift, int quarter,
                                 Floats* passed) {
  Floats step[kLanes], squares{}, trace{};
  for (std::size_t i = 0; i < kLanes; ++i) {
    step[i] = row_of(negative, i);
    squares = fused(step[i], step[i], squares);
    trace = fused(step[i], row_of(kIdentity, i), trace);
  }
  // K has the eigenvalues of I - D M that are not zero.
  const float squared_weights = std::max(
      kLanes + 2 * kDiagonal * lane_sum(trace) + kDiagonal * kDiagonal * lane_sum(squares), 0.0f);
  rotate(step, kLanes, shift);
  CellMatrix to_step;
  for (std::size_t i = 0; i < kLanes; ++i) store(step[i], to_step[i].data());
  Floats moved[kMaxStack], energy{};
  for (int n = 0; n < count; ++n) {
    moved[n] = pilot[n * kQuarters];
    energy = fused(moved[n], moved[n], energy);
  }
  const Floats ratio = energy / (kNoiseShare * squared_weights + kLeastNoise);
  const Floats gain = ratio * ratio / (ratio * ratio + 1.0f);
  rotate(moved, count, to_step);
  for (int n = 0; n < count; ++n) cells[n * kQuarters] = gain * (pilot[n * kQuarters] - moved[n]);
  if (passed) noise_of_blocks(pilot, count, negative, gain, quarter, passed);
  return squared_weights * lane_sum(gain * gain) / kLanes;
}

/// Combines all blocks; the pilot is lost. passed: as above, all components. Returns the sum of the
/// squared weights of all values.
HWY_INLINE float combine_quarters(Floats* cells, Floats* pilot, int count, Floats* passed) {
  for (int i = 0; i < count * kQuarters; i += kQuarters) {
    swap_cells_and_quarters(cells + i);
    swap_cells_and_quarters(pilot + i);
  }
  for (int i = 0; i < count * kQuarters; ++i) cells[i] -= pilot[i];
  CellMatrix negative[kQuarters], shift[kQuarters];
  for (int i = 0; i < kQuarters; ++i) {
    products(pilot + i, pilot + i, count, kQuarters, kDiagonal, negative[i]);
    products(pilot + i, cells + i, count, kQuarters, -kDiagonal, shift[i]);
  }
  invert(negative, kDiagonal);
  float squares = 0;  // each of the kLanes values of a quarter has the same weights
  for (int i = 0; i < kQuarters; ++i)
    squares +=
        kLanes * combine_quarter(cells + i, pilot + i, count, negative[i], shift[i], i, passed);
  for (int i = 0; i < count * kQuarters; i += kQuarters) swap_cells_and_quarters(cells + i);
  return squares;
}

/// Blocks of 2x2 cells after the rotation. K does not change with the blocks' transform, but a
/// bright block's cells are nearly equal: their products as floats would not tell how they differ.
HWY_INLINE Shrinkage combine_blocks(const StackJob& job, int count, Floats* cells, Floats* pilot,
                                    Floats* passed) {
  transform_blocks<2>(cells, count, job, false);
  transform_blocks<2>(pilot, count, job, false);
  Shrinkage result{};
  result.weight = stack_weight(combine_quarters(cells, pilot, count, passed));
  transform_blocks<2>(cells, count, job, true);
  return result;
}
