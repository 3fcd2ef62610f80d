#include "malus/polar/stokes.h"

#include "malus/base/parallel.h"
#include "malus/base/wording.h"

#include <array>

#include <fmt/format.h>

namespace malus {
namespace {

bool same_size(View<const float> a, View<const float> b) {
  return a.rows() == b.rows() && a.cols() == b.cols();
}

// Applies value(Stokes) to every pixel.
template <class Function>
Image map_stokes(const StokesPlanes& stokes, Function value) {
  Image out(stokes.s0.rows(), stokes.s0.cols());
  parallel_for(0, out.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      const float *s0 = stokes.s0.row(r), *s1 = stokes.s1.row(r), *s2 = stokes.s2.row(r);
      float* to = out.row(r);
      for (int c = 0; c < out.cols(); ++c)
        to[c] = static_cast<float>(value(Stokes{s0[c], s1[c], s2[c]}));
    }
  });
  return out;
}

Image mean_of(const Image& a, const Image& b) {
  Image mean(a.rows(), a.cols());
  for (std::size_t i = 0; i < mean.size(); ++i)
    mean.values()[i] = 0.5f * (a.values()[i] + b.values()[i]);
  return mean;
}

Image mean_image(std::span<const StokesPlanes> planes, Image StokesPlanes::*member) {
  Image mean = planes[0].*member;
  for (std::size_t p = 1; p < planes.size(); ++p)
    for (std::size_t i = 0; i < mean.size(); ++i)
      mean.values()[i] += (planes[p].*member).values()[i];
  for (float& v : mean.values()) v /= static_cast<float>(planes.size());
  return mean;
}

}  // namespace

StokesPlanes stokes_of(const AnglePlanes& angles) {
  MALUS_REQUIRE(same_size(angles.i0, angles.i45) && same_size(angles.i0, angles.i90) &&
                same_size(angles.i0, angles.i135));
  const int rows = angles.i0.rows(), cols = angles.i0.cols();
  StokesPlanes stokes{Image(rows, cols), Image(rows, cols), Image(rows, cols)};
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      const float *i0 = angles.i0.row(r), *i45 = angles.i45.row(r);
      const float *i90 = angles.i90.row(r), *i135 = angles.i135.row(r);
      float *s0 = stokes.s0.row(r), *s1 = stokes.s1.row(r), *s2 = stokes.s2.row(r);
      for (int c = 0; c < cols; ++c) {
        const Stokes s = stokes_of(i0[c], i45[c], i90[c], i135[c]);
        s0[c] = static_cast<float>(s.s0);
        s1[c] = static_cast<float>(s.s1);
        s2[c] = static_cast<float>(s.s2);
      }
    }
  });
  return stokes;
}

Image dolp_of(const StokesPlanes& stokes) {
  return map_stokes(stokes, [](const Stokes& s) { return dolp_of(s); });
}

Image aolp_deg_of(const StokesPlanes& stokes) {
  return map_stokes(stokes, [](const Stokes& s) {
    const double angle = aolp_deg_of(s);
    return static_cast<float>(angle) >= 180.0f ? 0.0 : angle;  // 179.999999 rounds to 180 in float
  });
}

void require_polarized(const SensorLayout& layout, std::string_view subject) {
  if (layout.polarized()) return;
  throw InputError(
      subject,
      fmt::format("its layout \"{}\" has no four polarizer angles 0, 45, 90, 135", layout.name()),
      fmt::format("name a polarization layout, such as {} or {}", setting("layout", "polar-mono"),
                  setting("layout", "polar-bayer-rggb")));
}

SiteMean mean_of_sites(const Planes& packed, const SensorLayout& layout, Color color,
                       int angle_deg) {
  std::vector<const Image*> sites;
  for (int k = 0; k < layout.channels(); ++k)
    if (layout.site(k) == Site{color, angle_deg}) sites.push_back(&packed[k]);
  if (sites.empty()) return {};
  if (sites.size() == 1) return {*sites[0], 1};
  SiteMean mean{Image(packed.rows(), packed.cols()), static_cast<int>(sites.size())};
  for (std::size_t i = 0; i < mean.image.size(); ++i) {
    double sum = 0;
    for (const Image* site : sites) sum += site->values()[i];
    mean.image.values()[i] = static_cast<float>(sum / mean.sites);
  }
  return mean;
}

std::vector<StokesPlanes> stokes_per_color(const Planes& packed, const SensorLayout& layout) {
  require_polarized(layout, "Stokes parameters");
  MALUS_REQUIRE(packed.channels() == layout.channels());
  std::vector<StokesPlanes> all;
  for (Color color : layout.colors()) {
    std::array<Image, 4> angles;
    for (int a = 0; a < 4; ++a)
      angles[static_cast<std::size_t>(a)] = mean_of_sites(packed, layout, color, 45 * a).image;
    all.push_back(stokes_of(AnglePlanes{angles[0], angles[1], angles[2], angles[3]}));
  }
  return all;
}

std::string display_name(Color color) {
  if (color == Color::kMono) return "";
  if (color == Color::kGreen1 || color == Color::kGreen2) return "G";
  return std::string(color_name(color));
}

StokesPicture merge_greens(std::vector<StokesPlanes> per_color, const SensorLayout& layout) {
  const std::vector<Color> colors = layout.colors();
  MALUS_REQUIRE(per_color.size() == colors.size());
  StokesPicture picture;
  for (std::size_t i = 0; i < colors.size(); ++i) {
    StokesPlanes& own = per_color[i];
    if (colors[i] == Color::kGreen2 && !picture.names.empty() && picture.names.back() == "G") {
      StokesPlanes& green = picture.planes.back();
      green = {mean_of(green.s0, own.s0), mean_of(green.s1, own.s1), mean_of(green.s2, own.s2)};
      continue;
    }
    picture.names.push_back(display_name(colors[i]));
    picture.planes.push_back(std::move(own));
  }
  return picture;
}

StokesPlanes mean_stokes(std::span<const StokesPlanes> planes) {
  MALUS_REQUIRE(!planes.empty());
  return {mean_image(planes, &StokesPlanes::s0), mean_image(planes, &StokesPlanes::s1),
          mean_image(planes, &StokesPlanes::s2)};
}

}  // namespace malus
