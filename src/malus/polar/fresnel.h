// Degree of polarization of light that a smooth dielectric surface reflects (specular) or sends
// back from inside (diffuse), against the angle between surface normal and view. G. Atkinson and
// E. Hancock, "Recovery of surface orientation from diffuse polarization", IEEE TIP 15(6), 2006.
#pragma once

namespace malus {

/// Diffuse: rises from 0 at 0 to its largest value at 90 degrees. zenith_deg 0..90, index > 1.
double diffuse_dolp(double zenith_deg, double index);

/// Specular: 0 at 0, 1 at Brewster's angle atan(index), 0 again at 90 degrees.
double specular_dolp(double zenith_deg, double index);

/// atan(index), degrees.
double brewster_deg(double index);

/// Zenith of a diffuse surface; DoLP beyond the largest possible one gives 90.
double zenith_of_diffuse_deg(double dolp, double index);

/// Specular reflection has two zeniths for one DoLP: one below and one above Brewster's angle.
enum class BrewsterSide { kBelow, kAbove };
double zenith_of_specular_deg(double dolp, double index, BrewsterSide side);

}  // namespace malus
