// Clean material with known truth: colours undone, polarization by Fresnel, mosaics by Malus's law.
#include "malus/synthesize/scene.h"

#include "malus/base/error.h"
#include "malus/polar/fresnel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include <gtest/gtest.h>

namespace malus {
namespace {

Planes picture() {
  Planes rgb(3, 96, 128);
  for (int k = 0; k < 3; ++k)
    for (int r = 0; r < 96; ++r)
      for (int c = 0; c < 128; ++c)
        rgb[k](r, c) = 0.2f + 0.002f * static_cast<float>(c) + 0.1f * static_cast<float>(k);
  return rgb;
}

// Of R, G and B alone: what lies at infinity has a depth of it.
TEST(LinearLight, WhatIsNoNumberIsDarkAndCounted) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  Planes layers(4, 2, 2);
  for (Image& plane : layers)
    for (float& v : plane.values()) v = 0.5f;
  const std::vector<std::string> names{"B", "G", "R", "Z"};
  layers[0](0, 0) = layers[1](0, 0) = kInfinity;
  layers[2](0, 1) = std::numeric_limits<float>::quiet_NaN();
  layers[1](1, 0) = -kInfinity;
  layers[3](1, 1) = kInfinity;
  EXPECT_EQ(nonfinite_light(layers, names), 3);
  const Planes light = linear_light(layers, names, 1, false);
  ASSERT_EQ(light.channels(), 3);
  EXPECT_EQ(light[2].values(), (std::vector<float>{0, 0.5f, 0.5f, 0.5f}));
  EXPECT_EQ(light[1].values(), (std::vector<float>{0, 0.5f, 0, 0.5f}));
  EXPECT_EQ(light[0].values(), (std::vector<float>{0.5f, 0, 0.5f, 0.5f}));
}

TEST(CameraRgb, DevelopingItAgainGivesThePicture) {
  CameraResponse response;
  response.white_dn = 1000;
  response.exposure = 0.5;
  response.color_matrix = {1.6, -0.4, -0.2, -0.3, 1.5, -0.2, 0.1, -0.5, 1.4};
  response.white_balance = {2.0, 1.0, 1.5};
  const Planes linear = picture();
  const Planes camera = camera_rgb_of(linear, response);
  for (int i = 0; i < 96 * 128; i += 501) {
    double balanced[3];
    for (int k = 0; k < 3; ++k)
      balanced[k] = static_cast<double>(camera[k].values()[static_cast<std::size_t>(i)]) *
                    response.white_balance[static_cast<std::size_t>(k)] / 500;
    for (int k = 0; k < 3; ++k) {
      double developed = 0;
      for (int j = 0; j < 3; ++j)
        developed += response.color_matrix[static_cast<std::size_t>(3 * k + j)] * balanced[j];
      EXPECT_NEAR(developed, static_cast<double>(linear[k].values()[static_cast<std::size_t>(i)]),
                  1e-5);
    }
  }
  response.color_matrix = {1, 0, 0, 1, 0, 0, 0, 0, 1};
  EXPECT_THROW(camera_rgb_of(linear, response), InputError);
  response.color_matrix = {1, 2};
  EXPECT_THROW(camera_rgb_of(linear, response), InputError);
  EXPECT_THROW(camera_rgb_of(Planes(1, 2, 2), response), InputError);  // grey has no use for it
}

TEST(PolarScene, MatteSurfacesFollowDiffuseFresnel) {
  SceneSettings settings;
  settings.gloss = 0;
  const PolarScene scene = polarized_scene(picture(), settings, 3, 1);
  double steepest = 0;
  for (int r = 0; r < 96; r += 3)
    for (int c = 0; c < 128; c += 5) {
      const double nx = static_cast<double>(scene.normal_x(r, c));
      const double ny = static_cast<double>(scene.normal_y(r, c));
      const double nz = static_cast<double>(scene.normal_z(r, c));
      ASSERT_NEAR(nx * nx + ny * ny + nz * nz, 1.0, 1e-5);
      const double zenith = std::acos(std::min(nz, 1.0)) * 180 / std::numbers::pi;
      steepest = std::max(steepest, zenith);
      const StokesPlanes& s = scene.stokes[1];
      const Stokes pixel{static_cast<double>(s.s0(r, c)), static_cast<double>(s.s1(r, c)),
                         static_cast<double>(s.s2(r, c))};
      EXPECT_NEAR(dolp_of(pixel), diffuse_dolp(zenith, 1.5), 2e-4);
      if (zenith < 5) continue;
      double azimuth = std::atan2(ny, nx) * 180 / std::numbers::pi;
      double apart = std::remainder(aolp_deg_of(pixel) - azimuth, 180.0);
      EXPECT_NEAR(apart, 0, 0.1);
    }
  EXPECT_GT(steepest, 50);
  EXPECT_LE(steepest, 70.1);
}

TEST(PolarScene, GlossTurnsTheAngleAndStaysPhysical) {
  SceneSettings settings;
  settings.gloss = 1;
  const PolarScene scene = polarized_scene(picture(), settings, 3, 1);
  int turned = 0;
  for (int r = 0; r < 96; ++r)
    for (int c = 0; c < 128; ++c) {
      const StokesPlanes& s = scene.stokes[0];
      ASSERT_LE(std::hypot(s.s1(r, c), s.s2(r, c)), s.s0(r, c) * 1.0001f);
      const double azimuth = std::atan2(static_cast<double>(scene.normal_y(r, c)),
                                        static_cast<double>(scene.normal_x(r, c)));
      turned += static_cast<double>(s.s1(r, c)) * std::cos(2 * azimuth) +
                    static_cast<double>(s.s2(r, c)) * std::sin(2 * azimuth) <
                0;
    }
  EXPECT_GT(turned, 1000);
  const PolarScene again = polarized_scene(picture(), settings, 3, 1);
  EXPECT_EQ(again.stokes[2].s1.values(), scene.stokes[2].s1.values());
  const PolarScene other = polarized_scene(picture(), settings, 3, 2);
  EXPECT_NE(other.stokes[2].s1.values(), scene.stokes[2].s1.values());
}

TEST(FilmScene, AFilmWithoutRetardanceChangesNothing) {
  const FilmSettings settings{.polarized = 0.6, .angle_deg = 35, .retardance_waves = 0};
  const std::vector<StokesPlanes> scene = film_scene(picture(), settings, 3, 1);
  ASSERT_EQ(scene.size(), 3u);
  for (const StokesPlanes& s : scene)
    for (int r = 0; r < 96; r += 5)
      for (int c = 0; c < 128; c += 7) {
        const Stokes pixel{static_cast<double>(s.s0(r, c)), static_cast<double>(s.s1(r, c)),
                           static_cast<double>(s.s2(r, c))};
        EXPECT_NEAR(dolp_of(pixel), 0.6, 1e-5);
        EXPECT_NEAR(aolp_deg_of(pixel), 35, 1e-3);
      }
}

// With the axis along the rows everywhere, light at 45 degrees becomes cos(phase) of itself, and
// phases of the colours are as 1 / wavelength.
TEST(FilmScene, LightAt45DegreesToTheAxisFollowsTheCosineOfThePhase) {
  const FilmSettings settings{
      .polarized = 1, .angle_deg = 45, .retardance_waves = 0.4, .turn_deg = 0};
  const std::vector<StokesPlanes> scene = film_scene(picture(), settings, 3, 1);
  double most = 0;
  for (int r = 0; r < 96; ++r)
    for (int c = 0; c < 128; ++c) {
      std::array<double, 3> phase{};
      for (std::size_t k = 0; k < 3; ++k) {
        const auto s0 = static_cast<double>(scene[k].s0(r, c));
        ASSERT_NEAR(static_cast<double>(scene[k].s1(r, c)), 0, 1e-5 * s0);
        phase[k] = std::acos(std::clamp(static_cast<double>(scene[k].s2(r, c)) / s0, -1.0, 1.0));
      }
      most = std::max(most, phase[1]);
      if (phase[1] < 0.1) continue;
      EXPECT_NEAR(phase[0] / phase[1], 540.0 / 610, 1e-3);
      EXPECT_NEAR(phase[2] / phase[1], 540.0 / 465, 1e-3);
    }
  EXPECT_NEAR(most, 2 * std::numbers::pi * 0.4, 0.05);
}

// What a film does to light at 0 and at 45 degrees is its Mueller matrix between S1 and S2. Of a
// retarder it is symmetric with the values 1 (along the axis, wherever that lies) and cos(phase).
TEST(FilmScene, EveryPixelIsARotatedRetarder) {
  FilmSettings settings{.polarized = 1, .retardance_waves = 1.3, .turn_deg = 80};
  const auto column = [&](double angle_deg) {
    settings.angle_deg = angle_deg;
    return film_scene(picture(), settings, 5, 2)[2];
  };
  const StokesPlanes first = column(0), second = column(45);
  settings.turn_deg = 0;
  const StokesPlanes straight = column(45);
  int crossed = 0;
  for (int r = 0; r < 96; ++r)
    for (int c = 0; c < 128; ++c) {
      const float s0 = first.s0(r, c);
      const float m11 = first.s1(r, c) / s0, m21 = first.s2(r, c) / s0;
      const float m12 = second.s1(r, c) / s0, m22 = second.s2(r, c) / s0;
      const float cosine = straight.s2(r, c) / s0;
      ASSERT_NEAR(m12, m21, 1e-5f);
      ASSERT_NEAR(m11 + m22, 1 + cosine, 1e-5f);
      ASSERT_NEAR(m11 * m22 - m12 * m21, cosine, 1e-5f);
      crossed += std::abs(m12) > 0.2f;
    }
  EXPECT_GT(crossed, 1000);
}

TEST(Mosaic, SitesSeeMalussLaw) {
  std::vector<StokesPlanes> stokes(3);
  for (int k = 0; k < 3; ++k) {
    stokes[static_cast<std::size_t>(k)] = {Image(8, 8, 100.0f * static_cast<float>(k + 1)),
                                           Image(8, 8, 20.0f), Image(8, 8, -10.0f)};
  }
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  const Image mosaic = mosaic_of(stokes, layout);
  EXPECT_FLOAT_EQ(mosaic(0, 0), 0.5f * (100 - 20));  // R90
  EXPECT_FLOAT_EQ(mosaic(0, 1), 0.5f * (100 - 10));  // R45
  EXPECT_FLOAT_EQ(mosaic(1, 0), 0.5f * (100 + 10));  // R135
  EXPECT_FLOAT_EQ(mosaic(1, 1), 0.5f * (100 + 20));  // R0
  EXPECT_FLOAT_EQ(mosaic(0, 2), 0.5f * (200 - 20));  // G1 90
  EXPECT_FLOAT_EQ(mosaic(3, 3), 0.5f * (300 + 20));  // B0
  const Image bayer = mosaic_of(stokes, SensorLayout::named("bayer-rggb"));
  EXPECT_FLOAT_EQ(bayer(0, 0), 100.0f);
  EXPECT_FLOAT_EQ(bayer(1, 1), 300.0f);
}

TEST(Mosaic, SitesWithoutAColourFilterSeeAllColours) {
  std::vector<StokesPlanes> stokes(3);
  for (int k = 0; k < 3; ++k)
    stokes[static_cast<std::size_t>(k)] = {Image(4, 4, k == 0 ? 300.0f : 0.0f),
                                           Image(4, 4, k == 0 ? 30.0f : 0.0f), Image(4, 4)};
  const Image mono = mosaic_of(stokes, SensorLayout::named("mono"));
  EXPECT_FLOAT_EQ(mono(1, 1), 100.0f);
  const Image polar = mosaic_of(stokes, SensorLayout::named("polar-mono"));
  EXPECT_FLOAT_EQ(polar(0, 0), 0.5f * (100 - 10));  // 90
  EXPECT_FLOAT_EQ(polar(1, 1), 0.5f * (100 + 10));  // 0
}

}  // namespace
}  // namespace malus
