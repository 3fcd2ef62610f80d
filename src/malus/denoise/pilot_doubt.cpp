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
    doubt.values.values()[i] =
        std::clamp(std::exp(kSlope * (kUsualExcess - ratio)), kLeastDoubt, kMostDoubt);
  }
  return doubt;
}

ReferenceMap halved(ReferenceMap doubt) {
  for (float& value : doubt.values.values()) value = std::sqrt(value);
  return doubt;
}

}  // namespace malus::internal
