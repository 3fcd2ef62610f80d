// What the angle of a noisy vector tells of the true one's.
#pragma once

#include "malus/polar/uncertainty.h"

namespace malus::internal {

/// Mean squared difference [deg²], on AoLP's circle of 180 degrees, between the true AoLP and that
/// of a vector (S1, S2) of `signal` deviations, the same in all directions: 180²/12 at 0, the first
/// order (90/pi/signal)² far above. It is the mean over the truths that such a vector may have.
/// kMeasured: every length of them is as likely as any other, every direction too (Vaillancourt,
/// PASP 118, 1340, 2006; Quinn, A&A 538, A65, 2012, uniform in the degree of polarization).
/// kDenoised: they lie about the estimate as its error says, so the angle has the density of
/// Naghizadeh-Khouei and Clarke (A&A 274, 968, 1993).
double aolp_error_deg2(double signal, Intensities intensities);

}  // namespace malus::internal
