// Demosaicking measured on scenes with four full-resolution angle pictures. The table is in
// docs/polarization.md.
#include "malus/io/angle_pictures.h"
#include "malus/polar/demosaick.h"

#include <algorithm>
#include <cmath>
#include <iostream>

#include "support.h"
#include <fmt/format.h>

namespace malus {
namespace {

// RGB planes of the four angles.
struct Scene {
  std::array<Planes, 4> angles;
};

Scene load_scene(const std::string& name) {
  const auto pictures = load_angle_pictures(testing::shared_data() / "polar-scenes" / name);
  Scene scene;
  std::ranges::transform(pictures, scene.angles.begin(), &Picture::planes);
  return scene;
}

int plane_of(Color color) { return color == Color::kRed ? 0 : color == Color::kBlue ? 2 : 1; }

Image mosaic_of(const Scene& scene, const SensorLayout& layout) {
  const Planes& first = scene.angles[0];
  Image mosaic(first.rows() / 4 * 4, first.cols() / 4 * 4);
  for (int r = 0; r < mosaic.rows(); ++r)
    for (int c = 0; c < mosaic.cols(); ++c) {
      const Site& site = layout.site(layout.channel_at(r, c));
      mosaic(r, c) =
          scene.angles[static_cast<std::size_t>(*site.angle_deg / 45)][plane_of(site.color)](r, c);
    }
  return mosaic;
}

struct Quality {
  double s0_db, s1_db, s2_db, dolp_db, aolp_deg;
};

// Peak of the Stokes parameters: twice the largest intensity's half, i.e. the picture's white.
Quality judge(const Scene& scene, const StokesPicture& picture, const SensorLayout& layout) {
  std::array<double, 4> squares{};
  double angle_sum = 0, weight_sum = 0, white = 0, count = 0;
  for (const Planes& planes : scene.angles)
    for (float v : planes[1].values()) white = std::max(white, double{v});
  constexpr int kBorder = 16;
  for (std::size_t k = 0; k < picture.planes.size(); ++k) {
    const int plane = layout.colored() ? static_cast<int>(k) : 1;
    const StokesPlanes& s = picture.planes[k];
    for (int r = kBorder; r < s.s0.rows() - kBorder; ++r)
      for (int c = kBorder; c < s.s0.cols() - kBorder; ++c) {
        const auto i = [&](std::size_t a) { return double{scene.angles[a][plane](r, c)}; };
        const Stokes truth = stokes_of(i(0), i(1), i(2), i(3));
        const Stokes found{s.s0(r, c), s.s1(r, c), s.s2(r, c)};
        if (!(truth.s0 > 0)) continue;
        const auto dolp = [](const Stokes& x) {
          return x.s0 > 0 ? std::min(dolp_of(x), 1.0) : 0.0;
        };
        const std::array<double, 4> errors = {
            (found.s0 - truth.s0) / white, (found.s1 - truth.s1) / white,
            (found.s2 - truth.s2) / white, dolp(found) - dolp(truth)};
        for (std::size_t e = 0; e < 4; ++e) squares[e] += errors[e] * errors[e];
        ++count;
        const double a = aolp_deg_of(truth), b = aolp_deg_of({1, found.s1, found.s2});
        if (std::isnan(a) || std::isnan(b)) continue;
        const double d = std::remainder(a - b, 180.0);
        angle_sum += dolp(truth) * d * d;
        weight_sum += dolp(truth);
      }
  }
  const auto db = [&](double sum) { return -10 * std::log10(sum / count); };
  return {db(squares[0]), db(squares[1]), db(squares[2]), db(squares[3]),
          std::sqrt(angle_sum / weight_sum)};
}

TEST(DemosaickScenes, ResidualInterpolationIsAtLeastBilinearEverywhere) {
  MALUS_NEEDS_SHARED("polar-scenes/wen_1/I0.png");
  for (const char* layout_name : {"polar-mono", "polar-bayer-rggb"}) {
    const auto layout = SensorLayout::named(layout_name);
    double gain_s0 = 0, gain_dolp = 0;
    for (const char* name : {"wen_1", "lapray_1", "cases"}) {
      const Scene scene = load_scene(name);
      const Image mosaic = mosaic_of(scene, layout);
      const Quality plain =
          judge(scene, demosaick(mosaic, layout, Demosaicking::kBilinear), layout);
      const Quality good = judge(scene, demosaick(mosaic, layout, Demosaicking::kResidual), layout);
      for (const auto& [method, q] : {std::pair{"bilinear", plain}, {"residual", good}})
        std::cout << fmt::format(
            "{:<17} {:<9} {:<9} S0 {:6.2f}  S1 {:6.2f}  S2 {:6.2f}  DoLP {:6.2f}  AoLP {:5.2f}\n",
            layout_name, name, method, q.s0_db, q.s1_db, q.s2_db, q.dolp_db, q.aolp_deg);
      // Where the scene is so smooth that straight lines are the truth they may tie.
      EXPECT_GT(good.s0_db, plain.s0_db - 0.3) << layout_name << ' ' << name;
      EXPECT_GT(good.dolp_db, plain.dolp_db - 0.3) << layout_name << ' ' << name;
      EXPECT_LT(good.aolp_deg, plain.aolp_deg + 0.2) << layout_name << ' ' << name;
      gain_s0 += (good.s0_db - plain.s0_db) / 3;
      gain_dolp += (good.dolp_db - plain.dolp_db) / 3;
    }
    EXPECT_GT(gain_s0, 2) << layout_name;
    EXPECT_GT(gain_dolp, 1) << layout_name;
  }
}

}  // namespace
}  // namespace malus
