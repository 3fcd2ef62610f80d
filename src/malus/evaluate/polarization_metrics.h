// How near DoLP and AoLP are to a reference's, over all pixels and colours (000 Table 1: four
// DoLP and AoLP channels of a packed colour mosaic).
//
// Where they are defined: a pixel counts when the reference has S0 > 0 and all values are finite.
// DoLP is held to [0, 1] on both sides, as light's is; a test pixel with S0 <= 0 counts as DoLP 0,
// so that losing the signal is never rewarded. AoLP of the test is ½ atan2(S2, S1) whatever its S0;
// reference pixels with S1 = S2 = 0 have no angle and are left out of the AoLP metrics.
#pragma once

#include "malus/base/estimate.h"
#include "malus/polar/stokes.h"

#include <cstdint>
#include <span>

namespace malus {

struct PolarizationError {
  double dolp_squared_sum = 0;
  std::int64_t dolp_count = 0;
  double aolp_squared_sum = 0;  ///< of the linear difference of AoLP/180
  std::int64_t aolp_count = 0;
  double circular_squared_sum_deg2 = 0;  ///< weighted by the reference's DoLP
  double circular_weight = 0;
};

/// Of the pixels of both.
PolarizationError sum_of(const PolarizationError& a, const PolarizationError& b);

/// Distance of two axes on the circle of 180 degrees: 0..90; 179 against 1 is 2.
double axis_distance_deg(double a_deg, double b_deg);

/// Colours in the same order on both sides.
PolarizationError polarization_error(std::span<const StokesPlanes> reference,
                                     std::span<const StokesPlanes> test);

Estimate<double> dolp_psnr_db(const PolarizationError& error);  ///< peak 1
/// The paper's way: PSNR of AoLP/180° as a plain number, peak 1. Punishes 179° against 1°.
Estimate<double> aolp_psnr_db(const PolarizationError& error);
/// Root mean square of axis_distance_deg, weighted by the reference's DoLP.
Estimate<double> aolp_circular_deg(const PolarizationError& error);

}  // namespace malus
