#include "malus/polar/render.h"

#include "malus/base/parallel.h"
#include "malus/image/finite_pixels.h"
#include "malus/polar/color_map.h"
#include "malus/polar/internal/percentile.h"
#include "malus/polar/legend.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// color(row, col) for every pixel.
template <class Function>
Planes paint(int rows, int cols, Function color) {
  Planes picture(3, rows, cols);
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int c = 0; c < cols; ++c) {
        const Rgb rgb = color(r, c);
        picture[0](r, c) = rgb.r;
        picture[1](r, c) = rgb.g;
        picture[2](r, c) = rgb.b;
      }
  });
  return picture;
}

// Of the values that share a scale, how many lie on it.
constexpr double kScalePercentile = 99.5;

// Grey-world gains for R, G, B: the mean of G for all, within reason for nearly black channels.
std::array<double, 3> balance(const StokesPicture& picture) {
  constexpr double kLargest = 8;
  std::array<double, 3> gains = {1, 1, 1};
  const double green = finite_mean(picture.planes[1].s0.view());
  for (std::size_t i : {std::size_t{0}, std::size_t{2}}) {
    const double mean = finite_mean(picture.planes[i].s0.view());
    if (green > 0 && mean > 0) gains[i] = std::clamp(green / mean, 1 / kLargest, kLargest);
  }
  return gains;
}

Planes paint_signed(const Image& values, double scale, bool legend) {
  Planes picture = paint(values.rows(), values.cols(), [&](int r, int c) {
    const double v = values(r, c);
    if (!std::isfinite(v)) return undefined_color(r, c);
    return two_sided_color(scale > 0 ? v / scale : 0);
  });
  if (legend)
    draw_bar(picture, [](double fraction) { return two_sided_color(2 * fraction - 1); },
             {fmt::format("-{:.3g}", scale), "0", fmt::format("{:.3g}", scale)});
  return picture;
}

}  // namespace

Planes render_s0(const StokesPicture& picture, const RenderSettings& settings) {
  const bool color = picture.names == std::vector<std::string>{"R", "G", "B"};
  const StokesPlanes grey = color ? StokesPlanes{} : mean_stokes(picture.planes);
  std::array<const Image*, 3> s0 = {&grey.s0, &grey.s0, &grey.s0};
  std::array<double, 3> gains = {1, 1, 1};
  if (color) {
    for (std::size_t i = 0; i < 3; ++i) s0[i] = &picture.planes[i].s0;
    if (settings.white_balance) gains = balance(picture);
  }
  double white = 0;
  for (std::size_t i = 0; i < 3; ++i)
    white = std::max(white,
                     gains[i] * internal::percentile(s0[i]->values(), settings.white_percentile));
  const double scale = white > 0 ? settings.brightness / white : 0;
  return paint(s0[0]->rows(), s0[0]->cols(), [&](int r, int c) {
    std::array<float, 3> rgb;
    for (std::size_t i = 0; i < 3; ++i) {
      const double v = (*s0[i])(r, c);
      if (!std::isfinite(v)) return undefined_color(r, c);
      rgb[i] = srgb_of_linear(v * gains[i] * scale);
    }
    return Rgb{rgb[0], rgb[1], rgb[2]};
  });
}

SignedPictures render_s1_s2(const StokesPlanes& stokes, const RenderSettings& settings) {
  std::vector<float> magnitudes = stokes.s1.values();
  magnitudes.insert(magnitudes.end(), stokes.s2.values().begin(), stokes.s2.values().end());
  for (float& v : magnitudes) v = std::abs(v);
  const double scale = internal::percentile(std::move(magnitudes), kScalePercentile);
  return {paint_signed(stokes.s1, scale, settings.legend),
          paint_signed(stokes.s2, scale, settings.legend), scale};
}

Planes render_rising(const Image& values, double highest, bool legend) {
  Planes picture = paint(values.rows(), values.cols(), [&](int r, int c) {
    const double v = values(r, c);
    return std::isfinite(v) ? rising_color(v / highest) : undefined_color(r, c);
  });
  if (legend)
    draw_bar(picture, rising_color,
             {"0", fmt::format("{:.3g}", highest / 2), fmt::format("{:.3g}", highest)});
  return picture;
}

std::vector<Planes> render_on_one_scale(std::span<const Image> images, bool legend) {
  std::vector<float> values;
  for (const Image& image : images)
    values.insert(values.end(), image.values().begin(), image.values().end());
  const double highest = std::max(internal::percentile(std::move(values), kScalePercentile), 1e-30);
  std::vector<Planes> pictures;
  for (const Image& image : images) pictures.push_back(render_rising(image, highest, legend));
  return pictures;
}

Planes render_dolp(const Image& dolp, const RenderSettings& settings) {
  return render_rising(dolp, settings.dolp_max, settings.legend);
}

Planes render_aolp(const Image& aolp_deg, const Image& dolp, const RenderSettings& settings) {
  MALUS_REQUIRE(aolp_deg.rows() == dolp.rows() && aolp_deg.cols() == dolp.cols());
  Planes picture = paint(aolp_deg.rows(), aolp_deg.cols(), [&](int r, int c) {
    const double angle = aolp_deg(r, c), strength = dolp(r, c) / settings.dolp_max;
    if (!std::isfinite(angle)) return undefined_color(r, c);
    return aolp_color(angle, settings.aolp_by_dolp ? strength : 1);
  });
  if (settings.legend) draw_aolp_wheel(picture);
  return picture;
}

}  // namespace malus
