// Linear Stokes parameters from the four polarizer angles (docs/polarization.md).
// Angles are degrees of the polarizer's axis, counter-clockwise, modulo 180.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// Stokes parameters of one pixel, in the unit of the intensities.
struct Stokes {
  double s0 = 0, s1 = 0, s2 = 0;
};

/// S0 = (I0+I45+I90+I135)/2, S1 = I0-I90, S2 = I45-I135.
inline Stokes stokes_of(double i0, double i45, double i90, double i135) {
  return {0.5 * (i0 + i45 + i90 + i135), i0 - i90, i45 - i135};
}

/// Intensity behind an ideal polarizer: Malus's law, (S0 + S1 cos 2θ + S2 sin 2θ)/2.
inline double intensity_behind(const Stokes& s, double angle_deg) {
  const double twice = angle_deg * std::numbers::pi / 90.0;
  return 0.5 * (s.s0 + s.s1 * std::cos(twice) + s.s2 * std::sin(twice));
}

/// Degree of linear polarization; NaN where S0 <= 0 or not a number: there it is undefined. Noise
/// can bring it above 1.
inline double dolp_of(const Stokes& s) {
  if (!(s.s0 > 0)) return std::numeric_limits<double>::quiet_NaN();
  return std::hypot(s.s1, s.s2) / s.s0;
}

/// Angle of linear polarization in [0, 180) degrees; NaN where S0 <= 0 (no light) or is infinite,
/// as of a pixel that is no number, or S1 = S2 = 0 (no direction).
inline double aolp_deg_of(const Stokes& s) {
  if (!(s.s0 > 0) || !std::isfinite(s.s0) || (s.s1 == 0 && s.s2 == 0))
    return std::numeric_limits<double>::quiet_NaN();
  const double angle = 90.0 / std::numbers::pi * std::atan2(s.s2, s.s1);
  const double wrapped = angle < 0 ? angle + 180.0 : angle;
  return wrapped >= 180.0 ? 0.0 : wrapped;
}

/// Intensity planes behind the four polarizers, one colour, equal sizes.
struct AnglePlanes {
  View<const float> i0, i45, i90, i135;
};

/// The same, owned.
struct AngleImages {
  Image i0, i45, i90, i135;
  operator AnglePlanes() const { return {i0, i45, i90, i135}; }  // NOLINT: implicit by design
};

/// Stokes planes of one colour, equal sizes; plain data.
struct StokesPlanes {
  Image s0, s1, s2;
};

StokesPlanes stokes_of(const AnglePlanes& angles);
Image dolp_of(const StokesPlanes& stokes);  ///< as dolp_of(Stokes)
Image aolp_deg_of(
    const StokesPlanes& stokes);  ///< as aolp_deg_of(Stokes); never 180 after rounding

/// Packed planes in DN above black (image/pack.h) -> one StokesPlanes per colour, in the order of
/// layout.colors(). A colour with several sites of one angle takes their mean. Throws InputError
/// when the layout lacks an angle.
std::vector<StokesPlanes> stokes_per_color(const Planes& packed, const SensorLayout& layout);

/// Mean over all channels with this colour and angle, and how many there are (0: an empty image).
struct SiteMean {
  Image image;
  int sites = 0;
};
SiteMean mean_of_sites(const Planes& packed, const SensorLayout& layout, Color color,
                       int angle_deg);

/// Stokes parameters for viewing: one per display channel, "R", "G", "B" for colour sensors (G the
/// mean of the two greens), "" for mono.
struct StokesPicture {
  std::vector<std::string> names;
  std::vector<StokesPlanes> planes;
};

/// "R", "G" for both greens, "B", "" for mono.
std::string display_name(Color color);

/// From one StokesPlanes per colour, as stokes_per_color gives them. Colours other than R, G, B or
/// mono alone keep their own names.
StokesPicture merge_greens(std::vector<StokesPlanes> per_color, const SensorLayout& layout);

/// The mean of all colours' Stokes vectors: what S1, S2, DoLP and AoLP pictures of colour sensors
/// show. Contract: not empty, equal sizes.
StokesPlanes mean_stokes(std::span<const StokesPlanes> planes);

/// Throws InputError naming the layout and the subject (a file name) unless the layout is
/// polarized.
void require_polarized(const SensorLayout& layout, std::string_view subject);

}  // namespace malus
