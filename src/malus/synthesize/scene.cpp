#include "malus/synthesize/scene.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/polar/fresnel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace malus {
namespace {

using Matrix = std::array<double, 9>;

Matrix inverse_of(const std::vector<double>& m) {
  if (m.size() != 9)
    throw InputError("color_matrix", fmt::format("has {} numbers", m.size()), "give nine");
  const double a = m[4] * m[8] - m[5] * m[7], b = m[5] * m[6] - m[3] * m[8],
               c = m[3] * m[7] - m[4] * m[6];
  const double determinant = m[0] * a + m[1] * b + m[2] * c;
  if (!(std::abs(determinant) > 1e-9))
    throw InputError("color_matrix", "cannot be inverted", "check its numbers");
  Matrix inverse{a, m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                 b, m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                 c, m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
  for (double& v : inverse) v /= determinant;
  return inverse;
}

// A smooth random field: hills of Gaussian shape; its slope is known in closed form.
struct Hill {
  double row, col, radius, height;
};
struct Field {
  std::vector<Hill> hills;
  double height(double row, double col) const {
    double sum = 0;
    for (const Hill& h : hills) sum += h.height * shape(h, row, col);
    return sum;
  }
  // d height / d column, d height / d row
  std::pair<double, double> slope(double row, double col) const {
    double x = 0, y = 0;
    for (const Hill& h : hills) {
      const double g = h.height * shape(h, row, col) / (h.radius * h.radius);
      x -= g * (col - h.col);
      y -= g * (row - h.row);
    }
    return {x, y};
  }

 private:
  static double shape(const Hill& h, double row, double col) {
    const double dr = row - h.row, dc = col - h.col;
    return std::exp(-0.5 * (dr * dr + dc * dc) / (h.radius * h.radius));
  }
};

Field random_field(RandomSequence& random, int rows, int cols, int hills, bool signed_heights) {
  Field field;
  const double size = std::max(rows, cols);
  for (int i = 0; i < hills; ++i) {
    Hill hill;
    hill.row = random.uniform() * rows;
    hill.col = random.uniform() * cols;
    hill.radius = size * 0.03 * std::pow(8.0, random.uniform());
    hill.height = hill.radius * (0.3 + random.uniform());
    if (signed_heights && random.uniform() < 0.3) hill.height = -hill.height;
    field.hills.push_back(hill);
  }
  return field;
}

// The largest slope over a coarse grid: enough to scale the relief.
double steepest(const Field& field, int rows, int cols) {
  double largest = 1e-12;
  for (int r = 0; r < rows; r += 1 + rows / 64)
    for (int c = 0; c < cols; c += 1 + cols / 64) {
      const auto [x, y] = field.slope(r, c);
      largest = std::max(largest, std::hypot(x, y));
    }
  return largest;
}

struct Surface {
  double zenith_deg, azimuth;  ///< azimuth in radians, counter-clockwise from the right
};

Surface surface_at(const Field& relief, double scale, double steepest_slope, int row, int col) {
  auto [x, y] = relief.slope(row, col);
  const double slope = std::min(scale * std::hypot(x, y), steepest_slope);
  // The normal leans away from the rise; rows count downwards.
  return {std::atan(slope) * 180.0 / std::numbers::pi, std::atan2(y, -x)};
}

}  // namespace

double srgb_to_linear(double value) {
  return value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
}

void srgb_to_linear(Planes& rgb) {
  for (Image& plane : rgb)
    for (float& v : plane.values()) v = static_cast<float>(srgb_to_linear(static_cast<double>(v)));
}

Planes linear_light(const Planes& picture, const std::vector<std::string>& names, double white,
                    bool srgb) {
  constexpr float kBrightest = 65504.0f;
  std::vector<int> wanted{0};
  if (picture.channels() >= 3) {
    wanted = {0, 1, 2};
    for (std::size_t k = 0; k < 3; ++k) {
      const auto found = std::find(names.begin(), names.end(), std::string(1, "RGB"[k]));
      if (found != names.end()) wanted[k] = static_cast<int>(found - names.begin());
    }
  }
  Planes linear(static_cast<int>(wanted.size()), picture.rows(), picture.cols());
  const float scale = static_cast<float>(1.0 / white);
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    const auto& from = picture[wanted[k]].values();
    auto& to = linear[static_cast<int>(k)].values();
    for (std::size_t i = 0; i < to.size(); ++i) {
      const float v = from[i] * scale;
      to[i] = v >= 0 ? std::min(v, kBrightest) : 0.0f;
    }
  }
  if (srgb) srgb_to_linear(linear);
  return linear;
}

Planes camera_rgb_of(const Planes& linear_rgb, const CameraResponse& response) {
  MALUS_REQUIRE(linear_rgb.channels() == 3 || linear_rgb.channels() == 1);
  const auto& balance = response.white_balance;
  if (!balance.empty() && balance.size() != 3)
    throw InputError("white_balance", fmt::format("has {} numbers", balance.size()), "give three");
  const double scale = response.white_dn * response.exposure;
  Planes camera = linear_rgb;
  if (linear_rgb.channels() == 1) {
    for (float& v : camera[0].values()) v = static_cast<float>(scale * static_cast<double>(v));
    return camera;
  }
  Matrix m{1, 0, 0, 0, 1, 0, 0, 0, 1};
  if (!response.color_matrix.empty()) m = inverse_of(response.color_matrix);
  for (std::size_t i = 0; i < 9; ++i) m[i] *= scale / (balance.empty() ? 1.0 : balance[i / 3]);
  for (std::size_t i = 0; i < camera[0].size(); ++i) {
    const double r = static_cast<double>(linear_rgb[0].values()[i]);
    const double g = static_cast<double>(linear_rgb[1].values()[i]);
    const double b = static_cast<double>(linear_rgb[2].values()[i]);
    // Colours outside the camera's gamut would be negative light.
    for (std::size_t k = 0; k < 3; ++k)
      camera[static_cast<int>(k)].values()[i] =
          static_cast<float>(std::max(0.0, m[3 * k] * r + m[3 * k + 1] * g + m[3 * k + 2] * b));
  }
  return camera;
}

std::vector<StokesPlanes> unpolarized(const Planes& camera_rgb) {
  std::vector<StokesPlanes> stokes;
  for (const Image& plane : camera_rgb)
    stokes.push_back({plane, Image(plane.rows(), plane.cols()), Image(plane.rows(), plane.cols())});
  return stokes;
}

PolarScene polarized_scene(const Planes& camera_rgb, const SceneSettings& settings,
                           std::uint64_t seed, std::uint32_t number) {
  const int rows = camera_rgb.rows(), cols = camera_rgb.cols();
  RandomSequence random(seed, number, Draw::kScene, 1);
  const Field relief = random_field(random, rows, cols, settings.bumps, true);
  const Field shine = random_field(random, rows, cols, 8, false);
  const double limit = std::tan(settings.relief_deg * std::numbers::pi / 180.0);
  const double scale = limit / steepest(relief, rows, cols);
  double brightest = 1e-12, light = 0;  // of the mirrored surroundings: the picture's mean
  for (int r = 0; r < rows; r += 1 + rows / 64)
    for (int c = 0; c < cols; c += 1 + cols / 64)
      brightest = std::max(brightest, shine.height(r, c));
  for (const Image& plane : camera_rgb)
    for (const float v : plane.values()) light += static_cast<double>(v);
  light /= std::max(1.0, static_cast<double>(rows) * cols * camera_rgb.channels());

  PolarScene scene{unpolarized(camera_rgb), Image(rows, cols), Image(rows, cols),
                   Image(rows, cols)};
  parallel_for(0, rows, 8, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (int c = 0; c < cols; ++c) {
        const Surface s = surface_at(relief, scale, limit, r, c);
        const double share = settings.gloss * std::clamp(shine.height(r, c) / brightest, 0.0, 1.0);
        const double diffuse = diffuse_dolp(s.zenith_deg, settings.index);
        const double mirrored = -specular_dolp(s.zenith_deg, settings.index);  // across the azimuth
        const double along = std::cos(2.0 * s.azimuth), across = std::sin(2.0 * s.azimuth);
        for (std::size_t k = 0; k < scene.stokes.size(); ++k) {
          StokesPlanes& planes = scene.stokes[k];
          const double own = (1.0 - share) * static_cast<double>(planes.s0(r, c));
          const double other = share * light;
          const double polarized = own * diffuse + other * mirrored;
          planes.s0(r, c) = static_cast<float>(own + other);
          planes.s1(r, c) = static_cast<float>(polarized * along);
          planes.s2(r, c) = static_cast<float>(polarized * across);
        }
        const double zenith = s.zenith_deg * std::numbers::pi / 180.0;
        scene.normal_x(r, c) = static_cast<float>(std::sin(zenith) * std::cos(s.azimuth));
        scene.normal_y(r, c) = static_cast<float>(std::sin(zenith) * std::sin(s.azimuth));
        scene.normal_z(r, c) = static_cast<float>(std::cos(zenith));
      }
  });
  return scene;
}

Image mosaic_of(const std::vector<StokesPlanes>& stokes, const SensorLayout& layout) {
  MALUS_REQUIRE(stokes.size() == 3 || stokes.size() == 1);
  const int rows = stokes[0].s0.rows(), cols = stokes[0].s0.cols();
  const auto plane_of = [&](Color color) -> std::size_t {
    if (stokes.size() == 1 || color == Color::kRed) return 0;
    if (color == Color::kBlue) return 2;
    return 1;  // both greens, and mono: the eye's channel
  };
  Image mosaic(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const Site& site = layout.site(layout.channel_at(r, c));
      const StokesPlanes& s = stokes[plane_of(site.color)];
      mosaic(r, c) = !site.angle_deg
                         ? s.s0(r, c)
                         : static_cast<float>(intensity_behind(
                               {static_cast<double>(s.s0(r, c)), static_cast<double>(s.s1(r, c)),
                                static_cast<double>(s.s2(r, c))},
                               *site.angle_deg));
    }
  return mosaic;
}

}  // namespace malus
