// Principal axes of sixteen stacks at once, each in a lane of its own. No include guard:
// stack_kernel.cpp includes it once per instruction set, inside that set's namespace, after the
// vectors it is written in.
//
// Jacobi's method: which step comes next does not depend on the numbers, so lanes need not wait for
// each other. Eigen's solver, one matrix after the other, took a fifth of the filter's time, three
// times what this takes.

constexpr int kSweeps = 5;  // with three the denoised picture changes

/// A symmetric matrix per lane, of which the upper triangle counts, and axes[k][i].
struct LaneMatrices {
  Floats values[kLanes][kLanes];
  Floats axes[kLanes][kLanes];

  Floats& at(int i, int k) { return values[std::min(i, k)][std::max(i, k)]; }
};

/// Turns axes p and q such that they have nothing in common.
struct Turn {
  int p, q;
  Floats c, s, minus_s;

  HWY_INLINE void apply(Floats& at_p, Floats& at_q) const {
    const Floats before = at_p;
    at_p = fused(c, before, minus_s * at_q);
    at_q = fused(s, before, c * at_q);
  }
};

HWY_INLINE Turn turn_between(LaneMatrices& m, int p, int q) {
  constexpr float kLeast = 1e-30f;  // of nothing to turn at all
  const Floats zero{}, one = zero + 1.0f;
  Floats &at_p = m.at(p, p), &at_q = m.at(q, q), &common = m.at(p, q);
  const Floats twice = common + common, difference = at_q - at_p;
  const auto falls = difference < zero;
  const Floats length = choose(falls, zero - difference, difference);
  const Floats sum = length + root(fused(difference, difference, twice * twice)) + kLeast;
  const Floats tangent = choose(falls, zero - twice, twice) / sum;
  const Floats c = one / root(fused(tangent, tangent, one));
  at_p -= tangent * common;
  at_q += tangent * common;
  common = zero;
  return {p, q, c, c * tangent, zero - c * tangent};
}

/// Eight pairs that have no axis in common; in 15 rounds every axis meets every other.
HWY_INLINE void play_round(LaneMatrices& m, int round) {
  constexpr int kPairs = kLanes / 2, kOthers = kLanes - 1;
  Turn turns[kPairs];
  turns[0] = turn_between(m, kOthers, round);
  for (int i = 1; i < kPairs; ++i)
    turns[i] = turn_between(m, (round + i) % kOthers, (round + kOthers - i) % kOthers);
  for (int i = 0; i < kPairs; ++i)
    for (int k = i + 1; k < kPairs; ++k) {
      const Turn &a = turns[i], &b = turns[k];
      Floats &pp = m.at(a.p, b.p), &pq = m.at(a.p, b.q), &qp = m.at(a.q, b.p), &qq = m.at(a.q, b.q);
      a.apply(pp, qp);
      a.apply(pq, qq);
      b.apply(pp, pq);
      b.apply(qp, qq);
    }
  for (const Turn& turn : turns)
    for (int i = 0; i < kLanes; ++i) turn.apply(m.axes[turn.p][i], m.axes[turn.q][i]);
}

/// Components of stacks from the upper triangles of their moments, at most kLanes, as
/// principal_axes gives them.
HWY_INLINE void axes_of(const CellMatrix* moments, int count, CellMatrix* axes) {
  LaneMatrices m;
  for (std::size_t i = 0; i < kLanes; ++i)
    for (std::size_t k = 0; k < kLanes; ++k) {
      float lanes[kLanes] = {};
      for (int n = 0; n < count; ++n) lanes[n] = moments[n][i][k];
      load(lanes, m.values[i][k]);
      m.axes[i][k] = Floats{} + kIdentity[i][k];
    }
  for (int sweep = 0; sweep < kSweeps; ++sweep)
    for (int round = 0; round < kLanes - 1; ++round) play_round(m, round);
  for (int n = 0; n < count; ++n) {
    std::array<std::pair<float, std::size_t>, kLanes> order;
    for (std::size_t k = 0; k < kLanes; ++k) order[k] = {-lanes_of(m.values[k][k])[n], k};
    std::sort(order.begin(), order.end());
    for (std::size_t k = 0; k < kLanes; ++k)
      for (std::size_t i = 0; i < kLanes; ++i)
        axes[n][i][k] = lanes_of(m.axes[order[k].second][i])[n];
  }
}
