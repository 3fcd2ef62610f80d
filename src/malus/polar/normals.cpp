#include "malus/polar/normals.h"

#include "malus/base/parallel.h"
#include "malus/base/settings_check.h"
#include "malus/polar/color_map.h"
#include "malus/polar/fresnel.h"
#include "malus/polar/internal/percentile.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace malus {
namespace {

const float kNaN = std::numeric_limits<float>::quiet_NaN();

// DoLP to zenith in steps so fine that linear interpolation is exact to 0.02 degrees but at the
// ends, where the inverse has a vertical tangent and the exact one takes over.
class ZenithTable {
 public:
  explicit ZenithTable(const NormalSettings& settings) : settings_(settings) {
    zenith_deg_.reserve(kSteps + 1);
    for (int i = 0; i <= kSteps; ++i)
      zenith_deg_.push_back(exact_deg(static_cast<double>(i) / kSteps));
  }
  double operator()(double dolp) const {
    const double position = std::clamp(dolp, 0.0, 1.0) * kSteps;
    const auto i = std::min(static_cast<std::size_t>(position), zenith_deg_.size() - 2);
    const double low = zenith_deg_[i], high = zenith_deg_[i + 1];
    if (std::abs(high - low) > kLargestStepDeg) return exact_deg(dolp);
    return low + (position - static_cast<double>(i)) * (high - low);
  }

 private:
  static constexpr int kSteps = 4096;
  static constexpr double kLargestStepDeg = 0.2;

  double exact_deg(double dolp) const {
    if (settings_.reflection == "diffuse") return zenith_of_diffuse_deg(dolp, settings_.index);
    return zenith_of_specular_deg(
        dolp, settings_.index,
        settings_.above_brewster ? BrewsterSide::kAbove : BrewsterSide::kBelow);
  }

  NormalSettings settings_;
  std::vector<double> zenith_deg_;
};

struct Direction {
  double x = 0, y = 0;  // y up
};

struct Centre {
  double row = 0, col = 0;
};

// Object number of every pixel, -1 outside, and each object's centre. Pixels that touch, also at a
// corner, are one object.
struct Objects {
  Plane<int> number;
  std::vector<Centre> centres;
};

Objects objects_of(const Image& mask) {
  Objects objects{Plane<int>(mask.rows(), mask.cols(), -1), {}};
  std::vector<std::pair<int, int>> open;
  for (int row = 0; row < mask.rows(); ++row)
    for (int col = 0; col < mask.cols(); ++col) {
      if (!(mask(row, col) > 0) || objects.number(row, col) >= 0) continue;
      const int number = static_cast<int>(objects.centres.size());
      double rows = 0, cols = 0, count = 0;
      objects.number(row, col) = number;
      open.emplace_back(row, col);
      while (!open.empty()) {
        const auto [r, c] = open.back();
        open.pop_back();
        rows += r, cols += c, ++count;
        for (int i = std::max(r - 1, 0); i <= std::min(r + 1, mask.rows() - 1); ++i)
          for (int j = std::max(c - 1, 0); j <= std::min(c + 1, mask.cols() - 1); ++j)
            if (mask(i, j) > 0 && objects.number(i, j) < 0) {
              objects.number(i, j) = number;
              open.emplace_back(i, j);
            }
      }
      objects.centres.push_back({rows / count, cols / count});
    }
  return objects;
}

// The direction that the azimuth may not point against.
Direction preferred(const std::string& azimuth, const Centre& centre, int row, int col) {
  if (azimuth == "up") return {0, 1};
  if (azimuth == "down") return {0, -1};
  if (azimuth == "left") return {-1, 0};
  if (azimuth == "right") return {1, 0};
  return {col - centre.col, centre.row - row};
}

}  // namespace

Image foreground_mask(const Image& s0, double share) {
  Image mask(s0.rows(), s0.cols());
  if (std::ranges::none_of(s0.values(), [](float v) { return std::isfinite(v); })) return mask;
  const double threshold = share * internal::percentile(s0.values(), 99);
  for (std::size_t i = 0; i < mask.size(); ++i)
    mask.values()[i] = s0.values()[i] > threshold ? 1.0f : 0.0f;
  return mask;
}

NormalMap normals_of(const StokesPlanes& stokes, const Image& mask,
                     const NormalSettings& settings) {
  require_settings(settings);
  const int rows = stokes.s0.rows(), cols = stokes.s0.cols();
  MALUS_REQUIRE(mask.rows() == rows && mask.cols() == cols);
  const ZenithTable zenith_of(settings);
  const Objects objects = objects_of(mask);
  // Reflected light is polarized across the plane of incidence, light from inside along it.
  constexpr double kFacing = 0.01;  // zenith [rad]
  const double turn_deg = settings.reflection == "diffuse" ? 0 : 90;
  NormalMap normals{Image(rows, cols, kNaN), Image(rows, cols, kNaN), Image(rows, cols, kNaN)};
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int c = 0; c < cols; ++c) {
        const Stokes s{stokes.s0(r, c), stokes.s1(r, c), stokes.s2(r, c)};
        const double dolp = dolp_of(s), aolp_deg = aolp_deg_of(s);
        if (!(mask(r, c) > 0) || !std::isfinite(dolp)) continue;
        const double zenith = zenith_of(dolp) * std::numbers::pi / 180;
        // Unpolarized light has no azimuth. It needs none where the surface faces the camera; on
        // the far branch of reflections it is that of a surface seen edge-on, which could lie
        // anywhere.
        if (std::isnan(aolp_deg) && zenith > kFacing) continue;
        const double azimuth =
            std::isnan(aolp_deg) ? 0 : (aolp_deg + turn_deg) * std::numbers::pi / 180;
        double x = std::sin(zenith) * std::cos(azimuth), y = std::sin(zenith) * std::sin(azimuth);
        const Centre& centre = objects.centres[static_cast<std::size_t>(objects.number(r, c))];
        const Direction away = preferred(settings.azimuth, centre, r, c);
        if (x * away.x + y * away.y < 0) x = -x, y = -y;
        normals.x(r, c) = static_cast<float>(x);
        normals.y(r, c) = static_cast<float>(y);
        normals.z(r, c) = static_cast<float>(std::cos(zenith));
      }
  });
  return normals;
}

bool has_normal(const NormalMap& map, std::size_t i) {
  const float x = map.x.values()[i], y = map.y.values()[i], z = map.z.values()[i];
  return std::isfinite(x) && std::isfinite(y) && std::isfinite(z) && (x != 0 || y != 0 || z != 0);
}

Estimate<double> mean_angular_error_deg(const NormalMap& a, const NormalMap& b) {
  MALUS_REQUIRE(a.x.rows() == b.x.rows() && a.x.cols() == b.x.cols());
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < a.x.size(); ++i) {
    if (!has_normal(a, i) || !has_normal(b, i)) continue;
    const double ax = a.x.values()[i], ay = a.y.values()[i], az = a.z.values()[i];
    const double bx = b.x.values()[i], by = b.y.values()[i], bz = b.z.values()[i];
    // The angle from both products keeps its digits near 0 and 180 degrees.
    const double cross = std::hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx);
    sum += std::atan2(cross, ax * bx + ay * by + az * bz) * 180 / std::numbers::pi;
    ++count;
  }
  if (count == 0) return Undecided{"no pixel has a normal in both maps"};
  return sum / count;
}

Planes render_normals(const NormalMap& normals) {
  Planes picture(3, normals.x.rows(), normals.x.cols());
  for (int r = 0; r < normals.x.rows(); ++r)
    for (int c = 0; c < normals.x.cols(); ++c) {
      const bool defined = std::isfinite(normals.z(r, c));
      const auto shade = [](float v) { return 127.5f * (v + 1); };
      const Rgb color =
          defined ? Rgb{shade(normals.x(r, c)), shade(normals.y(r, c)), shade(normals.z(r, c))}
                  : undefined_color(r, c);
      picture[0](r, c) = color.r;
      picture[1](r, c) = color.g;
      picture[2](r, c) = color.b;
    }
  return picture;
}

}  // namespace malus
