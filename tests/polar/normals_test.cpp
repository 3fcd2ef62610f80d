#include "malus/polar/normals.h"

#include "malus/base/random.h"
#include "malus/polar/fresnel.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

struct Reflectances {
  double s, p;
};

// Fresnel's equations themselves, air to dielectric (Hecht, Optics, 4.6).
Reflectances fresnel(double zenith_deg, double index) {
  const double in = zenith_deg * std::numbers::pi / 180, out = std::asin(std::sin(in) / index);
  const double s = (std::cos(in) - index * std::cos(out)) / (std::cos(in) + index * std::cos(out));
  const double p = (index * std::cos(in) - std::cos(out)) / (index * std::cos(in) + std::cos(out));
  return {s * s, p * p};
}

TEST(Fresnel, DolpFollowsFromTheReflectances) {
  for (double index : {1.3, 1.5, 2.0})
    for (double zenith = 1; zenith < 90; zenith += 4) {
      const Reflectances r = fresnel(zenith, index);
      EXPECT_NEAR(specular_dolp(zenith, index), (r.s - r.p) / (r.s + r.p), 1e-9);
      // Light from inside passes with the same transmittances on its way out.
      const double ts = 1 - r.s, tp = 1 - r.p;
      EXPECT_NEAR(diffuse_dolp(zenith, index), (tp - ts) / (tp + ts), 1e-9);
    }
}

TEST(Fresnel, ZenithsComeBack) {
  for (double index : {1.3, 1.5, 2.0}) {
    const double brewster = brewster_deg(index);
    EXPECT_NEAR(specular_dolp(brewster, index), 1, 1e-12);
    for (double zenith = 0.5; zenith < 90; zenith += 3.7) {
      EXPECT_NEAR(zenith_of_diffuse_deg(diffuse_dolp(zenith, index), index), zenith, 1e-6);
      const auto side = zenith < brewster ? BrewsterSide::kBelow : BrewsterSide::kAbove;
      EXPECT_NEAR(zenith_of_specular_deg(specular_dolp(zenith, index), index, side), zenith, 1e-5);
    }
    EXPECT_DOUBLE_EQ(zenith_of_diffuse_deg(0.99, index), 90) << "more than a surface can polarize";
    EXPECT_NEAR(zenith_of_specular_deg(1.7, index, BrewsterSide::kBelow), brewster, 1e-6);
  }
}

struct Sphere {
  NormalMap normals;
  StokesPlanes stokes;
  Image mask;
};

// A dielectric sphere in the dark, seen from far away: normals known, polarization by Fresnel.
Sphere sphere(int size, const NormalSettings& settings, double s0 = 1000) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const Image blank(size, size), undefined(size, size, nan);
  Sphere result{{undefined, undefined, undefined}, {blank, blank, blank}, blank};
  const double centre = 0.5 * (size - 1), radius = 0.45 * size;
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c) {
      const double x = (c - centre) / radius, y = (centre - r) / radius;
      if (x * x + y * y >= 0.98) continue;
      const double z = std::sqrt(1 - x * x - y * y), zenith = std::acos(z) * 180 / std::numbers::pi;
      if (settings.reflection == "specular" && zenith >= brewster_deg(settings.index)) continue;
      const bool diffuse = settings.reflection == "diffuse";
      const double dolp =
          diffuse ? diffuse_dolp(zenith, settings.index) : specular_dolp(zenith, settings.index);
      const double twice = 2 * (std::atan2(y, x) + (diffuse ? 0 : std::numbers::pi / 2));
      result.normals.x(r, c) = static_cast<float>(x);
      result.normals.y(r, c) = static_cast<float>(y);
      result.normals.z(r, c) = static_cast<float>(z);
      result.stokes.s0(r, c) = static_cast<float>(s0);
      result.stokes.s1(r, c) = static_cast<float>(s0 * dolp * std::cos(twice));
      result.stokes.s2(r, c) = static_cast<float>(s0 * dolp * std::sin(twice));
      result.mask(r, c) = 1;
    }
  return result;
}

TEST(Normals, SphereComesBackForBothReflections) {
  for (const char* reflection : {"diffuse", "specular"}) {
    NormalSettings settings;
    settings.reflection = reflection;
    const Sphere truth = sphere(101, settings);
    const Image mask = foreground_mask(truth.stokes.s0, settings.foreground);
    EXPECT_EQ(mask.values(), truth.mask.values()) << reflection;
    const NormalMap found = normals_of(truth.stokes, mask, settings);
    EXPECT_LT(*mean_angular_error_deg(found, truth.normals), 0.05) << reflection;
    for (std::size_t i = 0; i < mask.size(); ++i)
      EXPECT_EQ(std::isfinite(found.z.values()[i]), mask.values()[i] > 0);
  }
}

TEST(Normals, TheWrongReflectionModelTurnsTheAzimuthBy90) {
  NormalSettings diffuse, specular;
  specular.reflection = "specular";
  const Sphere truth = sphere(101, diffuse);
  const NormalMap wrong = normals_of(truth.stokes, truth.mask, specular);
  const double dot =
      wrong.x(50, 80) * truth.normals.x(50, 80) + wrong.y(50, 80) * truth.normals.y(50, 80);
  EXPECT_NEAR(dot, 0, 1e-3);
}

TEST(Normals, HalfPlanesFollowTheUsersWord) {
  NormalSettings settings;
  const Sphere truth = sphere(61, settings);
  const auto of = [&](const char* azimuth) {
    settings.azimuth = azimuth;
    return normals_of(truth.stokes, truth.mask, settings);
  };
  const NormalMap up = of("up"), down = of("down"), left = of("left"), right = of("right");
  for (std::size_t i = 0; i < truth.mask.size(); ++i) {
    if (truth.mask.values()[i] == 0) continue;
    EXPECT_GE(up.y.values()[i], -1e-6f);
    EXPECT_LE(down.y.values()[i], 1e-6f);
    EXPECT_LE(left.x.values()[i], 1e-6f);
    EXPECT_GE(right.x.values()[i], -1e-6f);
  }
}

// Two spheres side by side: each has its own centre.
TEST(Normals, EveryObjectHasItsOwnCentre) {
  const NormalSettings settings;
  const Sphere one = sphere(61, settings);
  const auto doubled = [](const Image& image) {
    Image wide(image.rows(), 2 * image.cols());
    for (int r = 0; r < wide.rows(); ++r)
      for (int c = 0; c < wide.cols(); ++c) wide(r, c) = image(r, c % image.cols());
    return wide;
  };
  const StokesPlanes stokes{doubled(one.stokes.s0), doubled(one.stokes.s1), doubled(one.stokes.s2)};
  const NormalMap truth{doubled(one.normals.x), doubled(one.normals.y), doubled(one.normals.z)};
  const NormalMap found = normals_of(stokes, doubled(one.mask), settings);
  EXPECT_LT(*mean_angular_error_deg(found, truth), 0.05);
}

TEST(Normals, LessNoiseGivesBetterNormals) {
  NormalSettings settings;
  const Sphere truth = sphere(121, settings);
  const auto error_at = [&](double sd) {
    StokesPlanes noisy = truth.stokes;
    RandomSequence random(6, 0, Draw::kOther);
    for (Image* image : {&noisy.s0, &noisy.s1, &noisy.s2})
      for (float& v : image->values()) v += static_cast<float>(sd * random.normal());
    return *mean_angular_error_deg(normals_of(noisy, truth.mask, settings), truth.normals);
  };
  const double clean = error_at(0), good = error_at(2), bad = error_at(20), worse = error_at(80);
  EXPECT_LT(clean, good);
  EXPECT_LT(good, 0.5 * bad);
  EXPECT_LT(bad, 0.7 * worse);
}

TEST(Normals, UndefinedPixelsStayUndefined) {
  const StokesPlanes s{Image(2, 2), Image(2, 2), Image(2, 2)};
  const NormalMap none = normals_of(s, Image(2, 2, 1.0f), {});
  EXPECT_TRUE(std::isnan(none.z(0, 0)));
  EXPECT_FALSE(mean_angular_error_deg(none, none).decided());
  const StokesPlanes facing{Image(2, 2, 5.0f), Image(2, 2), Image(2, 2)};
  EXPECT_FLOAT_EQ(normals_of(facing, Image(2, 2, 1.0f), {}).z(0, 0), 1.0f);
  // Above Brewster's angle, unpolarized reflections are those of surfaces seen edge-on.
  const NormalSettings far{.reflection = "specular", .above_brewster = true};
  EXPECT_TRUE(std::isnan(normals_of(facing, Image(2, 2, 1.0f), far).z(0, 0)));
}

TEST(Normals, SettingsThatAreNoneAreRefused) {
  const StokesPlanes light{Image(2, 2, 5.0f), Image(2, 2, 1.0f), Image(2, 2)};
  EXPECT_THROW(normals_of(light, Image(2, 2, 1.0f), {.azimuth = "upwards"}), InputError);
  EXPECT_THROW(normals_of(light, Image(2, 2, 1.0f), {.index = 0.5}), InputError);
}

TEST(MeanAngularError, ClosedForms) {
  const NormalMap z{Image(1, 2), Image(1, 2), Image(1, 2, 1.0f)};
  NormalMap other = z;
  other.x(0, 0) = 1, other.z(0, 0) = 0;
  EXPECT_NEAR(*mean_angular_error_deg(z, other), 45, 1e-9) << "90 and 0 degrees";
  other.z(0, 1) = -1;
  EXPECT_NEAR(*mean_angular_error_deg(z, other), 135, 1e-9) << "90 and 180 degrees";
}

TEST(MeanAngularError, CountsOnlyPixelsWithANormalInBothMaps) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  const NormalMap z{Image(1, 4), Image(1, 4), Image(1, 4, 1.0f)};
  NormalMap other{Image(1, 4), Image(1, 4), Image(1, 4)};  // the second pixel stays (0, 0, 0)
  other.x(0, 0) = 10;                                      // its length says nothing
  other.x(0, 2) = infinity, other.z(0, 2) = infinity;
  other.y(0, 3) = nan;
  EXPECT_NEAR(*mean_angular_error_deg(z, other), 90, 1e-9);
  EXPECT_NEAR(*mean_angular_error_deg(other, z), 90, 1e-9);
  const NormalMap empty{Image(1, 4), Image(1, 4), Image(1, 4)};
  EXPECT_FALSE(mean_angular_error_deg(z, empty).decided());
}

}  // namespace
}  // namespace malus
