// Clean material: pictures to raw mosaics as a noiseless camera would see them (001, S4), and
// polarized scenes made from pictures (normals of a random relief, diffuse and specular Fresnel
// reflection), with their Stokes parameters known.
#pragma once

#include "malus/base/parameter.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/polar/stokes.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

struct CameraResponse {
  double white_dn = 4000, exposure = 1;
  std::vector<double> color_matrix, white_balance;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.white_dn,
          ParameterInfo{"full_scale", "DN", "signal above black of a white pixel at exposure 1", 1,
                        1e6});
    field(self.exposure, ParameterInfo{"exposure", "1", "multiplies the light", 1e-6, 1e6});
    field(
        self.color_matrix,
        ParameterInfo{"color_matrix", "1",
                      "camera RGB to linear sRGB, nine numbers row by row, as raw developers use "
                      "it; its inverse is applied. Empty: the picture's colours are the camera's"});
    field(self.white_balance,
          ParameterInfo{"white_balance", "1",
                        "gains of red, green, blue that the developer would apply; divided out",
                        0.01, 100});
  }
};

struct SceneSettings {
  double index = 1.5, relief_deg = 70, gloss = 0.4;
  int bumps = 24;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.index, ParameterInfo{"index", "1", "refractive index of the surfaces", 1.01, 4});
    field(self.relief_deg,
          ParameterInfo{"relief", "deg", "steepest angle between surface and view", 0, 89});
    field(self.gloss, ParameterInfo{"gloss", "1", "largest share of mirrored light", 0, 1});
    field(self.bumps,
          ParameterInfo{"bumps", "1", "number of hills of the random relief", 1, 10000});
  }
};

/// Polarized light behind a transparent film under stress, as phone cases and blisters look before
/// a screen.
struct FilmSettings {
  double polarized = 0.9;       ///< DoLP of the light behind the film, 0..1
  double angle_deg = 0;         ///< its AoLP [deg]
  double retardance_waves = 1;  ///< the film's largest, in wavelengths of green light, >= 0
  double turn_deg = 90;         ///< the slow axis' largest turn over the picture [deg]
  int bumps = 12;               ///< hills of the random stress and of the random axis, >= 1
};

/// What is known of a picture's tone curve: "auto", sRGB of integers and none of floats; "srgb";
/// "linear".
const std::vector<std::string>& picture_tones();
/// Whether it is sRGB. bits: of the picture's integers, 0 of floats. Contract: one of those.
bool is_srgb(const std::string& tone, int bits);

/// The light of a picture: its channels named R, G, B (else the first three; the first alone of
/// fewer than three), divided by white, the sRGB curve undone where srgb says so. What is NaN,
/// infinite or negative is dark, and nothing is brighter than a half float.
Planes linear_light(const Planes& picture, const std::vector<std::string>& names, double white,
                    bool srgb);

/// How many pixels are NaN or infinite in one of these channels.
std::int64_t nonfinite_light(const Planes& picture, const std::vector<std::string>& names);

/// The planes without rows and columns that do not fill a cell of the layout. Throws InputError,
/// which names `source`, where they do not fill one.
Planes whole_cells(const Planes& planes, const SensorLayout& layout, const std::string& source);

/// Throws InputError on a matrix that is not 3 x 3 or cannot be inverted, or a balance not of
/// three.
void require_usable(const CameraResponse& response);
/// Linear sRGB -> camera RGB in DN above black: matrix and white balance undone, scaled to white.
/// Throws as require_usable.
Planes camera_rgb_of(const Planes& linear_rgb, const CameraResponse& response);

/// Unpolarized light: S0 = light, S1 = S2 = 0; so a polarizer passes half.
std::vector<StokesPlanes> unpolarized(const Planes& camera_rgb);

/// A scene of the picture's colours on a random relief, one StokesPlanes per plane of camera_rgb.
/// Diffuse light is polarized along the normal's azimuth, mirrored light across it, by as much as
/// the Fresnel equations say (polar/fresnel.h); the share of mirrored light varies over the
/// picture. The scene is a function of (seed, number).
struct PolarScene {
  std::vector<StokesPlanes> stokes;
  Image normal_x, normal_y, normal_z;  ///< x right, y up, z towards the camera
};
PolarScene polarized_scene(const Planes& camera_rgb, const SceneSettings& settings,
                           std::uint64_t seed, std::uint32_t number);

/// The picture seen through such a film, one StokesPlanes per plane of camera_rgb (three, or one of
/// green light). Every pixel is a linear retarder (Mueller matrix of a rotated retarder, Goldstein,
/// Polarized Light): Stokes along its axis stays, across it is multiplied by cos(phase), the rest
/// is circular and lost to polarizers. Phases are as 1 / wavelength, so that DoLP and AoLP differ
/// from colour to colour. A function of (seed, number).
std::vector<StokesPlanes> film_scene(const Planes& camera_rgb, const FilmSettings& settings,
                                     std::uint64_t seed, std::uint32_t number);

/// What the sensor's sites see of three (R, G, B) or one plane of Stokes parameters: the mosaic in
/// DN above black, of the planes' size. Sites without a polarizer see S0, sites without a colour
/// filter the mean of the three. Where S1 and S2 are
/// empty, the light is unpolarized.
Image mosaic_of(const std::vector<StokesPlanes>& stokes, const SensorLayout& layout);

}  // namespace malus
