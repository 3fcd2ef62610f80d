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
constexpr float kDiagonal = kLanes / kPilotShare;  // D of a pilot that is believed as it is
// One set of weights lets noise through in all 16 values, also in those that hold no signal: in
// even areas all but one. So every value has a gain besides, q² / (q² + 1), q its energy in the
// pilot over this share of the noise: measured too. Wiener's q / (q + 1) takes more of fine detail.
constexpr float kNoiseShare = 0.8f;
constexpr float kLeastNoise = 1e-6f;  // where neither signal nor noise is left
// Energies are squares: floats round their sums at a millionth. From this many times the diagonal
// on that is felt.
constexpr float kMostOfFloats = 5e4f;

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
  for (int i = 0; i < kQuarters; ++i) copy(swapped[i], block[i]);
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
                                float diagonal, const Floats& gain, int quarter, Floats* passed) {
  const Floats squares = gain * gain;
  float shares[kQuarters] = {};  // of a component, mean over the block's four cells
  for (int i = 0; i < kLanes; ++i) shares[i % kQuarters] += lane(squares, i) / kQuarters;
  Floats solved[kMaxStack];
  for (int n = 0; n < count; ++n) copy(pilot[n * kQuarters], solved[n]);
  rotate(solved, count, negative);
  for (int n = 0; n < count; ++n) {
    const Floats rest = pilot[n * kQuarters] + diagonal * solved[n];
    const float weights = std::max(-lane_sum(rest * solved[n]), 0.0f);
    float* to = reinterpret_cast<float*>(passed + n) + kQuarters * quarter;
    for (int k = 0; k < kQuarters; ++k) to[k] = weights * shares[k];
  }
}

/// How a quarter's blocks are combined.
struct QuarterWeights {
  CellMatrix to_step;     ///< what takes the pilot to P - X, transposed
  float squared_weights;  ///< ||K||^2: K has the eigenvalues of I - D M that are not zero
};

/// negative: -M. shift: R P^T - D I, transposed.
HWY_INLINE void derive_weights(const CellMatrix& negative, const CellMatrix& shift, float diagonal,
                               QuarterWeights& weights) {
  Floats step[kLanes], squares{}, trace{};
  for (std::size_t i = 0; i < kLanes; ++i) {
    step[i] = row_of(negative, i);
    squares = fused(step[i], step[i], squares);
    trace = fused(step[i], row_of(kIdentity, i), trace);
  }
  weights.squared_weights = std::max(
      kLanes + 2 * diagonal * lane_sum(trace) + diagonal * diagonal * lane_sum(squares), 0.0f);
  rotate(step, kLanes, shift);
  for (std::size_t i = 0; i < kLanes; ++i) store(step[i], weights.to_step[i].data());
}

using DoubleMatrix = std::array<std::array<double, kLanes>, kLanes>;
constexpr int kDoubleBytes =
    std::clamp<int>(HWY_MAX_BYTES, 16, 64);  // some sets have no fixed width
using Doubles = double __attribute__((vector_size(kDoubleBytes)));
constexpr int kDoublesPerVector = sizeof(Doubles) / sizeof(double);
constexpr int kDoubleParts = kLanes / kDoublesPerVector;

/// Blocks of one quarter in double precision.
struct DoubleBlocks {
  alignas(64) double values[kMaxStack][kLanes];

  DoubleBlocks(const Floats* blocks, int count) {
    for (int n = 0; n < count; ++n)
      for (int k = 0; k < kLanes; ++k)
        values[n][k] = static_cast<double>(lanes_of(blocks[n * kQuarters])[k]);
  }
};

/// diagonal * I + sum over n of a[n] b[n]^T; two rows at a time, whose sums stay in registers.
HWY_INLINE void products(const DoubleBlocks& a, const DoubleBlocks& b, int count, double diagonal,
                         DoubleMatrix& matrix) {
  constexpr int kRows = 2;
  matrix = {};
  for (std::size_t i = 0; i < kLanes; ++i) matrix[i][i] = diagonal;
  for (int row = 0; row < kLanes; row += kRows) {
    Doubles sums[kRows][kDoubleParts];
    std::memcpy(&sums, matrix[static_cast<std::size_t>(row)].data(), sizeof(sums));
    for (int n = 0; n < count; ++n)
      for (int part = 0; part < kDoubleParts; ++part) {
        Doubles values;
        std::memcpy(&values, &b.values[n][part * kDoublesPerVector], sizeof(values));
        for (int i = 0; i < kRows; ++i) sums[i][part] += a.values[n][row + i] * values;
      }
    std::memcpy(matrix[static_cast<std::size_t>(row)].data(), &sums, sizeof(sums));
  }
}

HWY_INLINE void invert(DoubleMatrix& m) {
  for (std::size_t k = 0; k < kLanes; ++k) {
    const double pivot = 1.0 / m[k][k];
    std::array<double, kLanes> row = m[k];
    for (double& value : row) value *= -pivot;
    row[k] = pivot;
    for (std::size_t i = 0; i < kLanes; ++i) {
      if (i == k) continue;
      const double factor = m[i][k];
      m[i][k] = 0;
      for (std::size_t j = 0; j < kLanes; ++j) m[i][j] += factor * row[j];
    }
    for (std::size_t j = 0; j < kLanes; ++j) m[k][j] = -row[j];
  }
}

/// The same in double precision. residual: R. negative: becomes -M.
HWY_INLINE void solve_in_doubles(const Floats* pilot, const Floats* residual, int count,
                                 float diagonal, CellMatrix& negative, QuarterWeights& weights) {
  DoubleMatrix inverse, shift;  // the inverse is negative too
  const DoubleBlocks p(pilot, count), r(residual, count);
  products(p, p, count, diagonal, inverse);
  products(p, r, count, -diagonal, shift);
  invert(inverse);
  double squares = 0;
  for (std::size_t i = 0; i < kLanes; ++i) {
    std::array<double, kLanes> step{};
    for (std::size_t j = 0; j < kLanes; ++j)
      for (std::size_t k = 0; k < kLanes; ++k) step[k] += inverse[i][j] * shift[j][k];
    for (std::size_t k = 0; k < kLanes; ++k) {
      const double kept = (i == k ? 1.0 : 0.0) + diagonal * inverse[i][k];
      squares += kept * kept;
      negative[i][k] = static_cast<float>(inverse[i][k]);
      weights.to_step[i][k] = static_cast<float>(step[k]);
    }
  }
  weights.squared_weights = static_cast<float>(squares);
}

/// Whether floats would not tell the diagonal from how products of bright values are rounded. One
/// bright value does no harm, as in even blocks; two that go together do, as across an edge.
HWY_INLINE bool needs_doubles(const CellMatrix& products, float diagonal) {
  float most = 0, second = 0;
  for (std::size_t i = 0; i < kLanes; ++i) {
    second = std::max(second, std::min(most, products[i][i]));
    most = std::max(most, products[i][i]);
  }
  return second > kMostOfFloats * diagonal;
}

/// Combines one quarter of all blocks. Returns the sum of its squared weights. passed, when given:
/// the noise let through into every block.
HWY_INLINE float combine_quarter(Floats* cells, const Floats* pilot, int count,
                                 const CellMatrix& negative, float diagonal,
                                 const QuarterWeights& weights, int quarter, Floats* passed) {
  Floats moved[kMaxStack], energy{};
  for (int n = 0; n < count; ++n) {
    copy(pilot[n * kQuarters], moved[n]);
    energy = fused(moved[n], moved[n], energy);
  }
  const Floats ratio = energy / (kNoiseShare * weights.squared_weights + kLeastNoise);
  const Floats gain = ratio * ratio / (ratio * ratio + 1.0f);
  rotate(moved, count, weights.to_step);
  for (int n = 0; n < count; ++n) cells[n * kQuarters] = gain * (pilot[n * kQuarters] - moved[n]);
  if (passed) noise_of_blocks(pilot, count, negative, diagonal, gain, quarter, passed);
  return weights.squared_weights * lane_sum(gain * gain) / kLanes;
}

/// Combines all blocks; the pilot is lost. passed: as above, all components. Returns the sum of the
/// squared weights of all values.
HWY_INLINE float combine_quarters(Floats* cells, Floats* pilot, int count, float diagonal,
                                  Floats* passed) {
  for (int i = 0; i < count * kQuarters; i += kQuarters) {
    swap_cells_and_quarters(cells + i);
    swap_cells_and_quarters(pilot + i);
  }
  for (int i = 0; i < count * kQuarters; ++i) cells[i] -= pilot[i];
  CellMatrix negative[kQuarters], shift[kQuarters];
  bool in_doubles[kQuarters];
  for (int i = 0; i < kQuarters; ++i) {
    products(pilot + i, pilot + i, count, kQuarters, diagonal, negative[i]);
    in_doubles[i] = needs_doubles(negative[i], diagonal);
    if (!in_doubles[i]) products(pilot + i, cells + i, count, kQuarters, -diagonal, shift[i]);
  }
  invert(negative, diagonal);
  float squares = 0;  // each of the kLanes values of a quarter has the same weights
  for (int i = 0; i < kQuarters; ++i) {
    QuarterWeights weights;
    if (in_doubles[i])
      solve_in_doubles(pilot + i, cells + i, count, diagonal, negative[i], weights);
    else
      derive_weights(negative[i], shift[i], diagonal, weights);
    squares += kLanes * combine_quarter(cells + i, pilot + i, count, negative[i], diagonal, weights,
                                        i, passed);
  }
  for (int i = 0; i < count * kQuarters; i += kQuarters) swap_cells_and_quarters(cells + i);
  return squares;
}

/// Blocks of 2x2 cells after the rotation. K does not change with the blocks' transform, but a
/// bright block's cells are nearly equal: their products as floats would not tell how they differ.
HWY_INLINE Shrinkage combine_blocks(const StackJob& job, int count, Floats* cells, Floats* pilot,
                                    float doubt, Floats* passed) {
  transform_blocks<2>(cells, count, job, false);
  transform_blocks<2>(pilot, count, job, false);
  Shrinkage result{};
  result.weight = stack_weight(combine_quarters(cells, pilot, count, kDiagonal * doubt, passed));
  transform_blocks<2>(cells, count, job, true);
  return result;
}
