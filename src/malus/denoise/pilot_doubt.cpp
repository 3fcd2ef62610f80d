#include "malus/denoise/internal/pilot_doubt.h"

#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cmath>

namespace malus::internal {
namespace {

// All measured (docs/denoising-experiments.md, "Doubt of the pilot"). The best multiple of the
// noise falls by this power of e when the ratio of excess and energy rises by one,
constexpr float kSlope = 1.5f;
// between these: texture that wants less is told from smooth slopes too badly to have it.
constexpr float kLeastDoubt = 0.9f, kMostDoubt = 6.0f;
// Of the neighbourhood whose sums decide, in references: one stack's are mostly chance.
constexpr float kDeviation = 1.5f;
constexpr int kRadius = 3;
// The neighbourhood counts for as much as a stack whose weak coefficients hold this much energy
// [noise variances]. Less, and even light takes chance for signal; more, and the pins of a circuit
// board are shrunk like the bare board around them.
constexpr float kPriorEnergy = 300.0f;
// A stack's evidence is of the noise that its gains then let pass: by so much it flatters the
// pilot.
constexpr float kOwnFlattery = 0.2f;

// Combinations of stacks with this share of bright coefficients do not doubt them.
constexpr float kManyBright = 0.05f;

float doubt_by(float ratio) {
  return std::clamp(std::exp(kSlope * (kUsualExcess - ratio)), kLeastDoubt, kMostDoubt);
}

}  // namespace

// One more for the nearest reference.
int doubt_reach(int step) { return (kRadius + 1) * step; }

ReferenceMap doubt_of(const PilotEvidence& evidence) {
  const Image excess = gaussian_means(evidence.excess.values, kDeviation, kRadius);
  const Image energy = gaussian_means(evidence.energy.values, kDeviation, kRadius);
  ReferenceMap doubt = evidence.excess;
  for (std::size_t i = 0; i < energy.size(); ++i) {
    const float held = energy.values()[i];
    const float ratio = held > 0 ? excess.values()[i] / held : kUsualExcess;
    doubt.values.values()[i] = doubt_by(ratio);
  }
  return doubt;
}

float settled_doubt(float doubt, const Evidence& own) {
  const float before = kUsualExcess - std::log(doubt) / kSlope;
  const float apart = own.excess - (before + kOwnFlattery) * own.energy;
  return doubt_by(before + apart / (kPriorEnergy + own.energy));
}

float doubt_of_combinations(float doubt, float bright) {
  return std::pow(doubt, std::max(1 - bright / kManyBright, 0.0f));
}

ReferenceMap halved(ReferenceMap doubt) {
  for (float& value : doubt.values.values()) value = std::sqrt(value);
  return doubt;
}

}  // namespace malus::internal
