// How far the guided passes believe their pilot, place by place. They take a coefficient's energy
// from it. But beside the strong coefficients of crisp print and bars the pilot's weak ones are the
// noise that these let pass, and in the fine texture of photographs the thresholds have taken
// signal away. The samples tell: what they hold in the weak coefficients beyond their noise, over
// what the pilot holds there, is about one in most photographs, none in print, and two in fine
// texture (measured: docs/denoising-experiments.md, "Doubt of the pilot").
#pragma once

#include "malus/denoise/internal/stack_stage.h"

namespace malus::internal {

/// So much energy the samples hold beyond their noise over the pilot's where it is believed as it
/// is.
inline constexpr float kUsualExcess = 1.1f;

/// A place's doubt depends on no reference further away than this [mosaic pixels]; step: between
/// the references of the evidence.
int doubt_reach(int step);

/// What multiplies the noise that a guided pass's gains expect: above 1 where the pilot holds
/// noise. Places without evidence have 1.
ReferenceMap doubt_of(const PilotEvidence& evidence);

/// Of weak coefficients [sums of noise variances]: what the samples hold beyond their noise, and
/// what the pilot holds.
struct Evidence {
  float excess = 0, energy = 0;
};

/// A place's doubt after the evidence of one stack there: rare detail has its own stacks, and its
/// neighbourhood tells nothing of it. doubt: above 0.
float settled_doubt(float doubt, const Evidence& own);

/// Of a later pass that combines the stack's blocks. There the doubt is of all that the pilot
/// holds: where many coefficients are bright, as in lamps on dark ground, it would shrink these.
/// bright: their share in the stack.
float doubt_of_combinations(float doubt, float bright);

/// Half as much, as ratios count: for a plan's last pass, whose pilot has been over another pass or
/// whose result no other one mends.
ReferenceMap halved(ReferenceMap doubt);

}  // namespace malus::internal
