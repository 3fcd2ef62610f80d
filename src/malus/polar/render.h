// Stokes parameters as pictures for people: three planes, 0..255, as displayed.
#pragma once

#include "malus/base/parameter.h"
#include "malus/polar/stokes.h"

#include <span>
#include <vector>

namespace malus {

struct RenderSettings {
  double dolp_max = 1.0;
  double white_percentile = 99.5;
  double brightness = 1.0;
  bool white_balance = true;
  bool aolp_by_dolp = false;
  bool legend = true;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.dolp_max,
          ParameterInfo{"dolp_max", "1", "DoLP shown in the brightest colour", 0.001, 1.0});
    field(self.white_percentile,
          ParameterInfo{"white_percentile", "%", "share of S0 below white in its picture", 1.0,
                        100.0});
    field(self.brightness,
          ParameterInfo{"brightness", "1", "brightens the S0 picture", 0.001, 1000.0});
    field(self.white_balance,
          ParameterInfo{"white_balance", "", "scale R and B of the S0 picture to the mean of G"});
    field(self.aolp_by_dolp,
          ParameterInfo{"aolp_by_dolp", "", "darken the AoLP picture where DoLP is low"});
    field(self.legend, ParameterInfo{"legend", "", "draw the colour wheel and the scales"});
  }
};

/// Tone-mapped S0: linear light scaled so that the white percentile is white, then sRGB. R, G, B
/// in colour, anything else as grey. Pixels that are not finite show the undefined pattern.
Planes render_s0(const StokesPicture& picture, const RenderSettings& settings);

/// S1 and S2 on one two-sided scale: the 99.5th percentile of |S1| and |S2| together.
struct SignedPictures {
  Planes s1, s2;
  double scale_dn = 0;  ///< value of the outermost colour
};
SignedPictures render_s1_s2(const StokesPlanes& stokes, const RenderSettings& settings);

/// Values from 0 to highest in rising brightness; the bar shows the scale.
Planes render_rising(const Image& values, double highest, bool legend);
/// Values from 0 on one scale, whose end is the 99.5th percentile of all of them together.
std::vector<Planes> render_on_one_scale(std::span<const Image> images, bool legend);
Planes render_dolp(const Image& dolp, const RenderSettings& settings);
/// dolp: for aolp_by_dolp; sizes equal.
Planes render_aolp(const Image& aolp_deg, const Image& dolp, const RenderSettings& settings);

}  // namespace malus
