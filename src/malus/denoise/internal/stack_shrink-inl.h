// How the coefficients of a transformed stack are shrunk: the hard threshold and the empirical
// Wiener filter. No include guard: stack_kernel.cpp includes it once per instruction set, inside
// that set's namespace, after the vectors it is written in.

struct Shrinkage {
  float weight;
  Floats error;  ///< Stein's estimate of the squared error per component, unit noise
};

/// Weight of a stack's estimates: one over the sum of its squared gains, the noise it lets through.
HWY_INLINE float stack_weight(float squared_gains) { return 1.0f / std::max(squared_gains, 1.0f); }

HWY_INLINE Shrinkage shrink_hard(Floats* cells, int total, float threshold) {
  Floats kept{};
  const Floats zero{}, one = zero + 1.0f;
  for (int i = 0; i < total; ++i) {
    const auto keep = cells[i] * cells[i] >= threshold * threshold;
    cells[i] = choose(keep, cells[i], zero);
    kept += choose(keep, one, zero);
  }
  // The root, measured: stacks of a first pass share more of their errors.
  return {std::sqrt(stack_weight(lane_sum(kept))), kept / static_cast<float>(total)};
}

// What a pilot's coefficient tells of the signal's energy (measured: docs/denoising.md).
// The pilot was made of the same samples: this share of a sample went into it as noise.
constexpr float kOwnShare = 0.02f;
// The finest differences along a stack hold little but noise that the pilot has left; so much of
// their energy is in all other coefficients too.
constexpr float kFloorShare = 0.2f;
// But the pilot has no more noise than the samples had: where blocks are not alike, as in bright
// fine texture, their differences are signal.
constexpr float kMostFloor = 1.0f;
// In the strongest components there is more energy than the thresholds have left in the pilot.
constexpr int kStrongComponents = 4;
constexpr float kStrongEnergy = 1.8f;

// The evidence on a pilot (pilot_doubt.h) is of coefficients below this energy in it: the noise of
// bright ones would outweigh all others. So doubt fades out above it.
constexpr float kWeakEnergy = 3.0f;

/// How far the pilot's strongest components are doubted, and its others (settled_doubt).
struct Doubts {
  float strong = 1, weak = 1;
};

HWY_INLINE Floats by_strength(float strong, float weak) {
  float values[kLanes];
  for (int k = 0; k < kLanes; ++k) values[k] = k < kStrongComponents ? strong : weak;
  Floats result;
  load(values, result);
  return result;
}

/// Empirical Wiener filter; `cells` per block, in `count` blocks after the Haar transform. doubts:
/// the noise that the gains of weak coefficients expect. passed, when given: per place along the
/// stack the noise let through.
template <int kCells>
HWY_INLINE Shrinkage shrink_wiener(Floats* cells, const Floats* pilot, int count,
                                   const Doubts& doubts, Floats* passed) {
  const Floats zero{};
  const Floats most = zero + kMostFloor;
  const Floats scale = by_strength(kStrongEnergy, 1.0f);
  const Floats beyond = by_strength(doubts.strong, doubts.weak) - 1.0f;
  Floats floor[kCells] = {};
  const int finest = count > 1 ? count / 2 : count;
  for (int n = finest; n < count; ++n)
    for (int i = 0; i < kCells; ++i) floor[i] += pilot[n * kCells + i] * pilot[n * kCells + i];
  for (int i = 0; i < kCells; ++i) {
    floor[i] *= kFloorShare / static_cast<float>(std::max(count - finest, 1));
    floor[i] = choose(floor[i] < most, floor[i], most);
  }
  Floats squares{}, error{};
  for (int n = 0; n < count; ++n) {
    Floats place{};
    for (int i = 0; i < kCells; ++i) {
      Floats& cell = cells[n * kCells + i];
      const Floats foreign = pilot[n * kCells + i] - kOwnShare * cell;
      Floats energy = scale * foreign * foreign - floor[i];
      energy = choose(energy > zero, energy, zero);
      const Floats bright = foreign * foreign * (1 / kWeakEnergy);
      const Floats gain = energy / (energy + 1.0f + beyond / (1.0f + bright * bright));
      // Noise let through, and signal taken away as the sample itself tells it (Stein, Ann.
      // Statist. 9, 1981): the pilot has lost signal that it does not know of.
      const Floats lost = 1.0f - gain;
      error += gain * gain + lost * lost * (cell * cell - 1.0f);
      cell *= gain;
      squares += gain * gain;
      place += gain * gain;
    }
    if (passed) passed[n] = place / static_cast<float>(kCells);
  }
  return {stack_weight(lane_sum(squares)), error / static_cast<float>(count * kCells)};
}

// In stacks of their like, along axes of their own, samples have a little less noise than one.
constexpr float kMatchedNoise = 0.98f;
// So much more of both per coefficient: where a pilot holds nearly nothing, chance does not decide.
constexpr float kSteadyEnergy = 0.03f, kSteadyExcess = kUsualExcess * kSteadyEnergy;
// Stacks whose pilot holds less than this per coefficient count less: the even ground around things
// would decide for them.
constexpr float kEvenEnergy = 0.05f, kLeastEnergy = 1e-3f;

/// What samples and pilot hold in the weak coefficients of a stack: of its strongest components,
/// and of the others. bright: of the strongest components' coefficients, the share that is not
/// weak.
struct StackEvidence {
  Evidence strong, others;
  float bright = 0;
};

/// `total` cells of a transformed stack.
HWY_INLINE StackEvidence weigh_pilot(const Floats* cells, const Floats* pilot, int total) {
  const Floats zero{}, weak = zero + kWeakEnergy;
  const Floats one = zero + 1.0f;
  Floats samples{}, held{}, weak_ones{};
  for (int i = 0; i < total; ++i) {
    const Floats square = pilot[i] * pilot[i];
    const auto is_weak = square < weak;
    samples += choose(is_weak, cells[i] * cells[i] - (kMatchedNoise - kSteadyExcess), zero);
    held += choose(is_weak, square + kSteadyEnergy, zero);
    weak_ones += choose(is_weak, one, zero);
  }
  StackEvidence result;
  for (int k = 0; k < kLanes; ++k) {
    Evidence& to = k < kStrongComponents ? result.strong : result.others;
    to.excess += lane(samples, k);
    to.energy += lane(held, k);
    if (k < kStrongComponents)
      result.bright += 1.0f / kStrongComponents -
                       lane(weak_ones, k) / static_cast<float>(total * kStrongComponents);
  }
  return result;
}

/// How much the evidence of one stack counts in that of its neighbourhood.
HWY_INLINE float weight_around(const Evidence& strong, int total) {
  const float mean = std::max(
      strong.energy / static_cast<float>(total * kStrongComponents) - kSteadyEnergy, kLeastEnergy);
  return mean / (mean + kEvenEnergy);
}
