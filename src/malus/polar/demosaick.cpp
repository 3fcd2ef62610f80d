#include "malus/polar/demosaick.h"

#include "malus/base/parallel.h"
#include "malus/polar/internal/bayer.h"
#include "malus/polar/internal/lattice.h"
#include "malus/polar/internal/residual_angles.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::display_color;
using internal::for_rows;
using internal::Lattice;
using internal::mean_square;
using internal::mirrored;

// The mean of all sites of one colour and angle, each interpolated linearly.
Image bilinear_plane(const Image& mosaic, const SensorLayout& layout, Color color, int angle_deg) {
  const int rows = mosaic.rows(), cols = mosaic.cols();
  Image weighted(rows, cols), weights(rows, cols);
  const auto ramp = [](int distance, int cell) {
    return std::max(0.0f, 1 - static_cast<float>(std::abs(distance)) / static_cast<float>(cell));
  };
  // The same tent for every site: where two sites overlap, the nearer one weighs more.
  Image sites(rows, cols), values(rows, cols);
  for_rows(rows, [&](int r) {
    for (int c = 0; c < cols; ++c) {
      const Site& site = layout.site(layout.channel_at(r, c));
      if (display_color(site.color) != color || site.angle_deg != angle_deg) continue;
      sites(r, c) = 1;
      values(r, c) = mosaic(r, c);
    }
  });
  const auto spread = [&](const Image& image) {
    Image across(rows, cols), both(rows, cols);
    parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
      for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
        for (int c = 0; c < cols; ++c)
          for (int d = 1 - layout.cols(); d < layout.cols(); ++d)
            across(r, c) += ramp(d, layout.cols()) * image(r, mirrored(c + d, cols));
    });
    parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
      for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
        for (int d = 1 - layout.rows(); d < layout.rows(); ++d) {
          const float weight = ramp(d, layout.rows());
          const float* from = across.row(mirrored(r + d, rows));
          for (int c = 0; c < cols; ++c) both(r, c) += weight * from[c];
        }
    });
    return both;
  };
  weighted = spread(values);
  weights = spread(sites);
  for (std::size_t i = 0; i < weighted.size(); ++i) weighted.values()[i] /= weights.values()[i];
  return weighted;
}

std::vector<Color> display_colors(const SensorLayout& layout) {
  std::vector<Color> colors;
  for (Color color : layout.colors())
    if (std::find(colors.begin(), colors.end(), display_color(color)) == colors.end())
      colors.push_back(display_color(color));
  return colors;
}

// One angle's pixels form a Bayer picture of half the size; each of the three planes of the result
// gets its pixels at that angle's places.
void demosaick_colors(const Image& mosaic, const SensorLayout& layout, int row, int col,
                      double epsilon, std::map<Color, Image>& planes) {
  const Lattice lattice{row, col, 2};
  const Image bayer = internal::sampled(mosaic, lattice);
  const auto color_at = [&](int r, int c) {
    return display_color(layout.site(layout.channel_at(row + 2 * r, col + 2 * c)).color);
  };
  for (const auto& [color, image] : internal::bayer_colors(bayer, color_at, epsilon)) {
    Image& plane = planes[color];
    for_rows(image.rows(), [&, &image = image](int r) {
      for (int c = 0; c < image.cols(); ++c) plane(row + 2 * r, col + 2 * c) = image(r, c);
    });
  }
}

// S1 and S2 smoothed by [1 2 1]. On the dark side of an edge that would add the bright side's S1
// and S2 to a small S0: where the same smoothing raises S0, they are lowered by as much. A factor
// of up to kLeft is left alone: in noise it would go with S0's error and lower DoLP's mean.
void smooth_polarization(StokesPlanes& stokes) {
  constexpr float kLeft = 1.25f;
  stokes.s1 = internal::smoothed(stokes.s1);
  stokes.s2 = internal::smoothed(stokes.s2);
  const Image raised = internal::smoothed(stokes.s0);
  for_rows(raised.rows(), [&](int r) {
    for (int c = 0; c < raised.cols(); ++c) {
      const float s0 = stokes.s0(r, c);
      if (!(s0 > 0 && raised(r, c) > kLeft * s0)) continue;
      const float factor = kLeft * s0 / raised(r, c);
      stokes.s1(r, c) *= factor;
      stokes.s2(r, c) *= factor;
    }
  });
}

// Where the polarization alone changes, what the angles' own errors left of its edges in S0.
void smooth_s0(Image& s0, const Image& takes_part) {
  const Image smooth = internal::smoothed(internal::smoothed(s0));
  for_rows(s0.rows(), [&](int r) {
    for (int c = 0; c < s0.cols(); ++c)
      s0(r, c) = smooth(r, c) + takes_part(r, c) * (s0(r, c) - smooth(r, c));
  });
}

// Of a picture with one colour everywhere, or of a band of it.
StokesPlanes residual_stokes(const Image& plane, const SensorLayout& layout, double epsilon,
                             double square) {
  auto [stokes, s0_takes_part] = internal::residual_angles(plane, layout, epsilon, square);
  if (layout.colored()) {
    smooth_polarization(stokes);
    smooth_s0(stokes.s0, s0_takes_part);
  }
  return std::move(stokes);
}

Image rows_of(const Image& whole, int first, int last) {
  Image band(last - first, whole.cols());
  std::copy(whole.row(first), whole.row(first) + band.size(), band.values().begin());
  return band;
}

// Band by band: what is made on the way to the Stokes parameters is several times their size.
StokesPlanes residual_in_bands(const Image& plane, const SensorLayout& layout, double epsilon,
                               const Progress& progress) {
  constexpr int kBandRows = 256;  // of whole cells; threads share a band
  constexpr int kSmoothing = 2;   // rows that residual_stokes adds
  constexpr int kReach = (internal::kAnglesReach + kSmoothing + 3) / 4 * 4;
  const int rows = plane.rows(), cols = plane.cols();
  const double square = mean_square(plane);
  StokesPlanes stokes{Image(rows, cols), Image(rows, cols), Image(rows, cols)};
  for (int first = 0; first < rows; first += kBandRows) {
    check_stop(progress);
    const int last = std::min(first + kBandRows, rows);
    const int top = std::max(first - kReach, 0), bottom = std::min(last + kReach, rows);
    const StokesPlanes band = residual_stokes(rows_of(plane, top, bottom), layout, epsilon, square);
    for (const auto part : {&StokesPlanes::s0, &StokesPlanes::s1, &StokesPlanes::s2}) {
      const float* from = (band.*part).row(first - top);
      std::copy(from, from + std::ptrdiff_t{last - first} * cols, (stokes.*part).row(first));
    }
  }
  return stokes;
}

StokesPicture residual(Image mosaic, const SensorLayout& layout, const Progress& progress) {
  const double epsilon = internal::kGuideEpsilon * mean_square(mosaic) + 1e-20;
  if (!layout.colored()) return {{""}, {residual_in_bands(mosaic, layout, epsilon, progress)}};
  std::map<Color, Image> planes;
  for (Color color : display_colors(layout)) planes[color] = Image(mosaic.rows(), mosaic.cols());
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) {
      check_stop(progress);
      demosaick_colors(mosaic, layout, r, c, epsilon, planes);
    }
  mosaic = Image();
  StokesPicture picture;
  for (Color color : display_colors(layout)) {
    picture.names.push_back(display_name(color));
    picture.planes.push_back(residual_in_bands(planes[color], layout, epsilon, progress));
    planes[color] = Image();
  }
  return picture;
}

StokesPicture bilinear(const Image& mosaic, const SensorLayout& layout, const Progress& progress) {
  StokesPicture picture;
  for (Color color : display_colors(layout)) {
    std::array<Image, 4> planes;
    for (int a = 0; a < 4; ++a) {
      check_stop(progress);
      planes[static_cast<std::size_t>(a)] = bilinear_plane(mosaic, layout, color, 45 * a);
    }
    picture.names.push_back(display_name(color));
    picture.planes.push_back(stokes_of(AnglePlanes{planes[0], planes[1], planes[2], planes[3]}));
  }
  return picture;
}

// Row by row: green on one diagonal, two other colours on the other.
bool is_bayer_pattern(const std::array<Color, 4>& cell) {
  const auto green = Color::kGreen1;
  const bool main = cell[0] == green && cell[3] == green && cell[1] != green && cell[2] != green &&
                    cell[1] != cell[2];
  const bool other = cell[1] == green && cell[2] == green && cell[0] != green && cell[3] != green &&
                     cell[0] != cell[3];
  return main || other;
}

void check_size(View<const float> mosaic, const SensorLayout& layout, const std::string& source) {
  if (mosaic.rows() < 2 * layout.rows() || mosaic.cols() < 2 * layout.cols())
    throw InputError(source,
                     fmt::format("{} x {} pixels are fewer than two {} x {} cells each way",
                                 mosaic.cols(), mosaic.rows(), layout.cols(), layout.rows()),
                     "use a larger frame, or one value per cell");
}

// What was filled to spare its neighbours is not known itself; of a whole channel, nothing is.
void forget_filled(View<const float> mosaic, const SensorLayout& layout, StokesPicture& picture) {
  std::vector<bool> seen(static_cast<std::size_t>(layout.channels()));
  bool all_usable = true;
  for (int r = 0; r < mosaic.rows(); ++r)
    for (int c = 0; c < mosaic.cols(); ++c)
      if (internal::is_usable(mosaic(r, c)))
        seen[static_cast<std::size_t>(layout.channel_at(r, c))] = true;
      else
        all_usable = false;
  if (all_usable) return;
  const bool all_seen = std::find(seen.begin(), seen.end(), false) == seen.end();
  for (StokesPlanes& stokes : picture.planes)
    for (Image* plane : {&stokes.s0, &stokes.s1, &stokes.s2})
      for (int r = 0; r < mosaic.rows(); ++r)
        for (int c = 0; c < mosaic.cols(); ++c)
          if (!all_seen || !internal::is_usable(mosaic(r, c)))
            (*plane)(r, c) = std::numeric_limits<float>::quiet_NaN();
}

}  // namespace

bool supports_residual(const SensorLayout& layout) {
  if (!layout.polarized() || layout.rows() != layout.cols()) return false;
  if (layout.rows() == 2) return !layout.colored();
  if (layout.rows() != 4) return false;
  std::array<Color, 4> blocks;
  for (int b = 0; b < 4; ++b) {
    const int row = b / 2 * 2, col = b % 2 * 2;
    blocks[static_cast<std::size_t>(b)] =
        display_color(layout.site(layout.channel_at(row, col)).color);
    for (int p = 0; p < 4; ++p) {
      const Site& site = layout.site(layout.channel_at(row + p / 2, col + p % 2));
      if (display_color(site.color) != blocks[static_cast<std::size_t>(b)] ||
          site.angle_deg != layout.site(layout.channel_at(p / 2, p % 2)).angle_deg)
        return false;
    }
  }
  if (!layout.colored()) return true;
  return is_bayer_pattern(blocks);
}

StokesPicture demosaick(View<const float> mosaic, const SensorLayout& layout, Demosaicking method,
                        const std::string& source, const Progress& progress) {
  require_polarized(layout, source);
  check_size(mosaic, layout, source);
  if (method == Demosaicking::kResidual && !supports_residual(layout))
    throw InputError(
        source,
        fmt::format("residual interpolation needs 2x2 blocks of one colour with four angles, which "
                    "the layout {} does not have",
                    layout.name()),
        "use bilinear interpolation where there is a choice, or one value per cell");
  Image usable = internal::filled(mosaic, layout);
  StokesPicture picture = method == Demosaicking::kBilinear
                              ? bilinear(usable, layout, progress)
                              : residual(std::move(usable), layout, progress);
  forget_filled(mosaic, layout, picture);
  return picture;
}

bool is_bayer(const SensorLayout& layout) {
  if (layout.polarized() || layout.rows() != 2 || layout.cols() != 2) return false;
  std::array<Color, 4> sites;
  for (int k = 0; k < 4; ++k) {
    const Site& site = layout.site(layout.channel_at(k / 2, k % 2));
    if (site.angle_deg || site.color == Color::kMono) return false;
    sites[static_cast<std::size_t>(k)] = display_color(site.color);
  }
  return is_bayer_pattern(sites);
}

Planes demosaick_bayer(View<const float> mosaic, const SensorLayout& layout) {
  if (!is_bayer(layout))
    throw InputError(fmt::format("layout {}", layout.name()), "is no Bayer pattern",
                     "give a mosaic of a Bayer sensor");
  check_size(mosaic, layout, "demosaicking");
  const Image finite = internal::filled(mosaic, layout);
  auto colors = internal::bayer_colors(
      finite,
      [&](int r, int c) { return display_color(layout.site(layout.channel_at(r, c)).color); },
      internal::kGuideEpsilon * mean_square(finite) + 1e-20);
  Planes rgb(3, 0, 0);
  int next = 0;
  for (const Color color : {Color::kRed, Color::kGreen1, Color::kBlue})
    rgb[next++] = std::move(colors[color]);
  return rgb;
}

}  // namespace malus
