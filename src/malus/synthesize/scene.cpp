#include "malus/synthesize/scene.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/random.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/polar/color_map.h"
#include "malus/polar/fresnel.h"
#include "malus/synthesize/internal/site_light.h"

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
    throw InputError(setting_name("color_matrix"),
                     fmt::format("has {}", counted(std::ssize(m), "number")), "give nine");
  const double a = m[4] * m[8] - m[5] * m[7], b = m[5] * m[6] - m[3] * m[8],
               c = m[3] * m[7] - m[4] * m[6];
  const double determinant = m[0] * a + m[1] * b + m[2] * c;
  if (!(std::abs(determinant) > 1e-9))
    throw InputError(setting_name("color_matrix"), "cannot be inverted", "check its numbers");
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
using Field = std::vector<Hill>;

// Of one row of a field: its heights, its slopes to the right (d height / d column) and down.
struct FieldRow {
  std::vector<double> height, right, down;
};

// A Gaussian hill is the product of a function of the row and one of the column, so that a pixel
// costs a few products per hill and no exponential.
class FieldRows {
 public:
  FieldRows(const Field& hills, int cols) : hills_(hills), cols_(static_cast<std::size_t>(cols)) {
    for (const Hill& h : hills_)
      for (int c = 0; c < cols; ++c) {
        const double away = c - h.col;
        across_.push_back(shape(away, h));
        falling_.push_back(-across_.back() * away / (h.radius * h.radius));
      }
  }

  FieldRow row(int r) const {
    FieldRow out{std::vector<double>(cols_), std::vector<double>(cols_),
                 std::vector<double>(cols_)};
    for (std::size_t i = 0; i < hills_.size(); ++i) {
      const Hill& h = hills_[i];
      const double away = r - h.row, height = h.height * shape(away, h),
                   down = -height * away / (h.radius * h.radius);
      const double *across = across_.data() + i * cols_, *falling = falling_.data() + i * cols_;
      for (std::size_t c = 0; c < cols_; ++c) {
        out.height[c] += height * across[c];
        out.right[c] += height * falling[c];
        out.down[c] += down * across[c];
      }
    }
    return out;
  }

 private:
  static double shape(double away, const Hill& h) {
    return std::exp(-0.5 * away * away / (h.radius * h.radius));
  }
  const Field& hills_;
  std::size_t cols_;
  std::vector<double> across_, falling_;  ///< [hill][column]
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
    field.push_back(hill);
  }
  return field;
}

// The largest slope and the largest height over a coarse grid: enough to scale a field.
struct Extremes {
  double slope = 1e-12, height = 1e-12;
};
Extremes extremes_of(const FieldRows& field, int rows, int cols) {
  Extremes most;
  for (int r = 0; r < rows; r += 1 + rows / 64) {
    const FieldRow row = field.row(r);
    for (int c = 0; c < cols; c += 1 + cols / 64) {
      const auto i = static_cast<std::size_t>(c);
      most.slope = std::max(most.slope, std::hypot(row.right[i], row.down[i]));
      most.height = std::max(most.height, row.height[i]);
    }
  }
  return most;
}

struct Surface {
  double zenith_deg;
  double right, up;  ///< cosine and sine of the azimuth, counter-clockwise from the right
};

Surface surface_of(double right, double down, double scale, double steepest_slope) {
  const double length = std::sqrt(right * right + down * down);
  const double slope = std::min(scale * length, steepest_slope);
  // The normal leans away from the rise; rows count downwards.
  const double unit = length > 0 ? 1.0 / length : 0.0;
  return {std::atan(slope) * 180.0 / std::numbers::pi, -right * unit, down * unit};
}

// Red, green and blue among a picture's channels, or its one of light.
std::vector<int> light_channels(const Planes& picture, const std::vector<std::string>& names) {
  if (picture.channels() < 3) return {0};
  std::vector<int> wanted{0, 1, 2};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto found = std::find(names.begin(), names.end(), std::string(1, "RGB"[k]));
    if (found != names.end()) wanted[k] = static_cast<int>(found - names.begin());
  }
  return wanted;
}

}  // namespace

const std::vector<std::string>& picture_tones() {
  static const std::vector<std::string> tones{"auto", "srgb", "linear"};
  return tones;
}

bool is_srgb(const std::string& tone, int bits) {
  return tone == "srgb" || (tone == "auto" && bits > 0);
}

Planes linear_light(const Planes& picture, const std::vector<std::string>& names, double white,
                    bool srgb) {
  constexpr float kBrightest = 65504.0f;
  const std::vector<int> wanted = light_channels(picture, names);
  Planes linear(static_cast<int>(wanted.size()), picture.rows(), picture.cols());
  const float scale = static_cast<float>(1.0 / white);
  for (std::size_t k = 0; k < wanted.size(); ++k) {
    const auto& from = picture[wanted[k]].values();
    auto& to = linear[static_cast<int>(k)].values();
    for (std::size_t i = 0; i < to.size(); ++i) {
      const float v = from[i] * scale;
      to[i] = v >= 0 && std::isfinite(from[i]) ? std::min(v, kBrightest) : 0.0f;
    }
  }
  if (srgb)
    for (Image& plane : linear)
      for (float& v : plane.values())
        v = static_cast<float>(srgb_to_linear(static_cast<double>(v)));
  return linear;
}

std::int64_t nonfinite_light(const Planes& picture, const std::vector<std::string>& names) {
  const std::vector<int> channels = light_channels(picture, names);
  std::int64_t count = 0;
  for (std::size_t i = 0; i < picture[0].size(); ++i)
    count += std::any_of(channels.begin(), channels.end(),
                         [&](int k) { return !std::isfinite(picture[k].values()[i]); });
  return count;
}

Planes whole_cells(const Planes& planes, const SensorLayout& layout, const std::string& source) {
  const int rows = planes.rows() / layout.rows() * layout.rows();
  const int cols = planes.cols() / layout.cols() * layout.cols();
  if (rows == 0 || cols == 0)
    throw InputError(
        source, fmt::format("is smaller than one cell of {} x {}", layout.rows(), layout.cols()),
        "use a larger picture");
  Planes cropped(planes.channels(), rows, cols);
  for (int k = 0; k < planes.channels(); ++k)
    for (int r = 0; r < rows; ++r) std::copy_n(planes[k].row(r), cols, cropped[k].row(r));
  return cropped;
}

void require_usable(const CameraResponse& response) {
  const auto& balance = response.white_balance;
  if (!balance.empty() && balance.size() != 3)
    throw InputError(setting_name("white_balance"),
                     fmt::format("has {}", counted(std::ssize(balance), "number")), "give three");
  if (!response.color_matrix.empty()) inverse_of(response.color_matrix);
}

Planes camera_rgb_of(const Planes& linear_rgb, const CameraResponse& response) {
  MALUS_REQUIRE(linear_rgb.channels() == 3 || linear_rgb.channels() == 1);
  require_usable(response);
  const auto& balance = response.white_balance;
  Matrix m{1, 0, 0, 0, 1, 0, 0, 0, 1};
  if (!response.color_matrix.empty()) m = inverse_of(response.color_matrix);
  const double scale = response.white_dn * response.exposure;
  Planes camera = linear_rgb;
  if (linear_rgb.channels() == 1) {
    for (float& v : camera[0].values()) v = static_cast<float>(scale * static_cast<double>(v));
    return camera;
  }
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
  RandomSequence random(seed, number, Draw::kScene, kStreamPolarization);
  const Field relief = random_field(random, rows, cols, settings.bumps, true);
  const Field shine = random_field(random, rows, cols, 8, false);
  const double limit = std::tan(settings.relief_deg * std::numbers::pi / 180.0);
  const FieldRows slopes(relief, cols), shines(shine, cols);
  const double scale = limit / extremes_of(slopes, rows, cols).slope;
  const double brightest = extremes_of(shines, rows, cols).height;
  double light = 0;  // of the mirrored surroundings: the picture's mean
  for (const Image& plane : camera_rgb)
    for (const float v : plane.values()) light += static_cast<double>(v);
  light /= std::max(1.0, static_cast<double>(rows) * cols * camera_rgb.channels());

  PolarScene scene{unpolarized(camera_rgb), Image(rows, cols), Image(rows, cols),
                   Image(rows, cols)};
  parallel_for(0, rows, 8, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r) {
      const FieldRow slope = slopes.row(r), bright = shines.row(r);
      for (int c = 0; c < cols; ++c) {
        const auto i = static_cast<std::size_t>(c);
        const Surface s = surface_of(slope.right[i], slope.down[i], scale, limit);
        const double share = settings.gloss * std::clamp(bright.height[i] / brightest, 0.0, 1.0);
        const double diffuse = diffuse_dolp(s.zenith_deg, settings.index);
        const double mirrored = -specular_dolp(s.zenith_deg, settings.index);  // across the azimuth
        // Cosine and sine of twice the azimuth.
        const double along = s.right * s.right - s.up * s.up, across = 2.0 * s.right * s.up;
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
        scene.normal_x(r, c) = static_cast<float>(std::sin(zenith) * s.right);
        scene.normal_y(r, c) = static_cast<float>(std::sin(zenith) * s.up);
        scene.normal_z(r, c) = static_cast<float>(std::cos(zenith));
      }
    }
  });
  return scene;
}

std::vector<StokesPlanes> film_scene(const Planes& camera_rgb, const FilmSettings& settings,
                                     std::uint64_t seed, std::uint32_t number) {
  constexpr std::array<double, 3> kWavelength_nm{610, 540, 465};
  const int rows = camera_rgb.rows(), cols = camera_rgb.cols();
  RandomSequence random(seed, number, Draw::kScene, kStreamFilm);
  const Field stress = random_field(random, rows, cols, settings.bumps, false);
  const Field axis = random_field(random, rows, cols, settings.bumps, false);
  const FieldRows stresses(stress, cols), axes(axis, cols);
  const double waves = settings.retardance_waves / extremes_of(stresses, rows, cols).height;
  std::array<double, 3> phase_per_stress{};  // of each colour; one plane is green
  for (std::size_t k = 0; k < 3; ++k)
    phase_per_stress[k] = 2 * std::numbers::pi * waves * kWavelength_nm[1] /
                          kWavelength_nm[camera_rgb.channels() == 3 ? k : 1];
  const double turn =
      2 * settings.turn_deg * std::numbers::pi / 180.0 / extremes_of(axes, rows, cols).height;
  const double angle = 2 * settings.angle_deg * std::numbers::pi / 180.0;
  const double q = settings.polarized * std::cos(angle), u = settings.polarized * std::sin(angle);
  std::vector<StokesPlanes> scene = unpolarized(camera_rgb);
  parallel_for(0, rows, 8, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r) {
      const FieldRow heights = stresses.row(r), turns = axes.row(r);
      for (int c = 0; c < cols; ++c) {
        const auto i = static_cast<std::size_t>(c);
        // Along and across the slow axis: the first keeps its size, the second loses by the phase.
        const double cosine = std::cos(turn * turns.height[i]),
                     sine = std::sin(turn * turns.height[i]);
        const double along = q * cosine + u * sine, across = u * cosine - q * sine;
        for (std::size_t k = 0; k < scene.size(); ++k) {
          const double left = across * std::cos(phase_per_stress[k] * heights.height[i]);
          const auto s0 = static_cast<double>(scene[k].s0(r, c));
          scene[k].s1(r, c) = static_cast<float>(s0 * (along * cosine - left * sine));
          scene[k].s2(r, c) = static_cast<float>(s0 * (along * sine + left * cosine));
        }
      }
    }
  });
  return scene;
}

Image mosaic_of(const std::vector<StokesPlanes>& stokes, const SensorLayout& layout) {
  MALUS_REQUIRE(stokes.size() == 3 || stokes.size() == 1);
  const int rows = stokes[0].s0.rows(), cols = stokes[0].s0.cols();
  const auto seen = [&](Image StokesPlanes::*part, Color color, int r, int c) {
    return light_behind_filter(color, static_cast<int>(stokes.size()), [&](std::size_t k) {
      const Image& image = stokes[k].*part;
      return image.empty() ? 0.0 : static_cast<double>(image(r, c));
    });
  };
  Image mosaic(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const Site& site = layout.site(layout.channel_at(r, c));
      const auto at = [&](Image StokesPlanes::*part) { return seen(part, site.color, r, c); };
      const double s0 = at(&StokesPlanes::s0);
      mosaic(r, c) = static_cast<float>(
          !site.angle_deg ? s0
                          : intensity_behind({s0, at(&StokesPlanes::s1), at(&StokesPlanes::s2)},
                                             *site.angle_deg));
    }
  return mosaic;
}

}  // namespace malus
