// Surface normals from polarization (000, 6.3): zenith from DoLP by the Fresnel equations, azimuth
// from AoLP, for a camera far away (orthographic).
//
// Two ambiguities remain in any single polarization picture, and are decided by what the user
// states, never silently:
//   - diffuse light is polarized along the azimuth, reflected light across it: `reflection`;
//   - AoLP is an axis, so azimuth and azimuth + 180 look alike: `azimuth`. `convex` takes the one
//     that points away from the centre of its object (a connected part of the mask), right where
//     the surface falls away from that centre on all sides, as in spheres and upright ellipsoids
//     that lie wholly in the frame, and at convex outlines; up, down, left and right take the one
//     in that half-plane.
#pragma once

#include "malus/base/estimate.h"
#include "malus/base/parameter.h"
#include "malus/polar/stokes.h"

#include <string>

namespace malus {

struct NormalSettings {
  double index = 1.5;
  std::string reflection = "diffuse";
  std::string azimuth = "convex";
  bool above_brewster = false;
  double foreground = 0.05;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    const double infinity = std::numeric_limits<double>::infinity();
    field(self.index, ParameterInfo{"index", "1", "refractive index of the surface", 1.01, 4.0});
    field(
        self.reflection,
        ParameterInfo{
            "model", "", "what polarizes the light", -infinity, infinity, {"diffuse", "specular"}});
    field(self.azimuth,
          ParameterInfo{"azimuth",
                        "",
                        "which of the two opposite azimuths: away from the object's centre, or in "
                        "a half-plane",
                        -infinity,
                        infinity,
                        {"convex", "up", "down", "left", "right"}});
    field(self.above_brewster,
          ParameterInfo{"above_brewster", "", "specular: zeniths above Brewster's angle"});
    field(self.foreground,
          ParameterInfo{"foreground", "1",
                        "without a mask: share of the 99th percentile of S0 that an object pixel "
                        "exceeds",
                        0.0, 1.0});
  }
};

/// Unit vectors: x right, y up, z towards the camera; NaN outside the object and where
/// polarization is undefined.
struct NormalMap {
  Image x, y, z;
};

/// Object pixels are 1, others 0: S0 above the foreground share.
Image foreground_mask(const Image& s0, double share);

/// stokes: one colour or the mean of all. mask: sizes equal; pixels > 0 belong to the object.
/// Throws InputError on settings out of their range or choices.
NormalMap normals_of(const StokesPlanes& stokes, const Image& mask, const NormalSettings& settings);

/// Whether a map has a normal at its element i: finite and longer than 0. Maps of other programs
/// often hold (0, 0, 0) where there is no object.
bool has_normal(const NormalMap& map, std::size_t i);

/// Mean angle between normals where both maps have one, degrees. Undecided where none do.
Estimate<double> mean_angular_error_deg(const NormalMap& a, const NormalMap& b);

/// x, y, z as red, green, blue, (n + 1)/2; undefined pixels show the undefined pattern. 0..255.
Planes render_normals(const NormalMap& normals);

}  // namespace malus
