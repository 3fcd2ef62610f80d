// How far the mean signal bends away from the exposure: what static nonlinearity does to K.
#pragma once

#include "malus/calibrate/internal/photon_transfer.h"

#include <vector>

namespace malus {

/// b of x = s (1 - b s), in 1/DN: x the measured signal, s that of a linear sensor with the same
/// slope without light. Shot noise then has the variance K s (1 - 2 b s)², to first order
/// K (x - 3 b x²). From a parabola through the mean against the exposure of the levels that are
/// not refused, its constant left free (exposures may have an offset). 0 unless five levels or more
/// have known and different exposures, the lamp's and the sensor's scatter about the parabola
/// leaves a chance below 3e-4 for its bend (Student), and it is a thousandth of the brightest level
/// or more. Infinite where the parabola does not rise without light.
double response_bend_per_dn(const std::vector<TransferLevel>& levels);

/// Whether a bend by the means is more than a response can have: x = s (1 - b s) turns back where
/// b x is a quarter. The exposures do not tell the levels' light then.
bool is_beyond_bends(double bend_per_dn, const std::vector<TransferLevel>& levels);

/// Chance that Student's |t| with this many degrees of freedom (one or more) is beyond t >= 0.
/// Abramowitz and Stegun 26.7.3, 26.7.4.
double student_chance(double t, int freedom);

}  // namespace malus
