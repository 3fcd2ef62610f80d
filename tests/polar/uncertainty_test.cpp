#include "malus/polar/uncertainty.h"

#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kDraws = 40000;

struct Sample {
  Moments s0, s1, s2, dolp, corrected, aolp_error_deg;
  int dolp_within = 0, aolp_within = 0;  // truth inside two of the pixel's own standard deviations
};

// Draws the four intensities of one pixel with Gaussian noise of known standard deviations and
// judges every estimate against the truth.
Sample simulate(const Stokes& truth, const std::array<double, 4>& sd) {
  Sample sample;
  RandomSequence random(11, 0, Draw::kOther);
  const double dolp = dolp_of(truth), aolp = aolp_deg_of(truth);
  const StokesCovariance v =
      stokes_covariance(sd[0] * sd[0], sd[1] * sd[1], sd[2] * sd[2], sd[3] * sd[3]);
  for (int i = 0; i < kDraws; ++i) {
    std::array<double, 4> intensity;
    for (std::size_t a = 0; a < 4; ++a)
      intensity[a] =
          intensity_behind(truth, 45.0 * static_cast<double>(a)) + sd[a] * random.normal();
    const Stokes s = stokes_of(intensity[0], intensity[1], intensity[2], intensity[3]);
    sample.s0.add(s.s0), sample.s1.add(s.s1), sample.s2.add(s.s2);
    sample.dolp.add(dolp_of(s));
    const double corrected = corrected_dolp(s, v);
    sample.corrected.add(corrected);
    const double error = std::remainder(aolp_deg_of(s) - aolp, 180.0);
    sample.aolp_error_deg.add(error);
    sample.dolp_within += std::abs(corrected - dolp) < 2 * std::sqrt(dolp_variance(s, v));
    sample.aolp_within +=
        std::abs(error) < 2 * std::sqrt(aolp_variance_deg2(s, v, Intensities::kMeasured));
  }
  return sample;
}

// Relative standard error of a variance from kDraws Gaussian samples: sqrt(2/n) = 0.7 %; 4 sigma.
constexpr double kVarianceTolerance = 0.03;

TEST(Uncertainty, VariancesAgreeWithSimulation) {
  const std::array<double, 4> sd = {3, 5, 8, 4};
  for (const Stokes truth :
       {Stokes{1000, 400, 250}, Stokes{1000, -300, 50}, Stokes{1000, 0, -600}}) {
    const Sample sample = simulate(truth, sd);
    const StokesCovariance v = stokes_covariance(9, 25, 64, 16);
    EXPECT_NEAR(sample.s0.variance() / v.s0s0, 1, kVarianceTolerance);
    EXPECT_NEAR(sample.s1.variance() / v.s1s1, 1, kVarianceTolerance);
    EXPECT_NEAR(sample.s2.variance() / v.s2s2, 1, kVarianceTolerance);
    EXPECT_NEAR(sample.dolp.variance() / dolp_variance(truth, v), 1, kVarianceTolerance);
    EXPECT_NEAR(
        sample.aolp_error_deg.variance() / aolp_variance_deg2(truth, v, Intensities::kMeasured), 1,
        kVarianceTolerance);
  }
}

// From a signal of three standard deviations on, two standard deviations hold the truth about 95 %
// of the time.
TEST(Uncertainty, TwoStandardDeviationsHoldTheTruth) {
  for (double snr : {3.0, 5.0, 20.0}) {
    const double sd = 10, amplitude = snr * sd * std::sqrt(2.0);  // sd of S1 and S2 is sqrt(2) sd
    const Sample sample = simulate({4000, 0.6 * amplitude, 0.8 * amplitude}, {sd, sd, sd, sd});
    EXPECT_NEAR(static_cast<double>(sample.dolp_within) / kDraws, 0.95, 0.02) << snr;
    EXPECT_NEAR(static_cast<double>(sample.aolp_within) / kDraws, 0.95, 0.03) << snr;
  }
}

// The raw DoLP of noise is biased upward. The corrected one has less than 7 % of a standard
// deviation left at a signal of two standard deviations and nothing measurable from three on. For
// no signal at all its mean is, in standard deviations, sqrt(pi/2)/2 + sqrt(pi/6)/2: the integral
// of the estimator over the Rayleigh distribution.
TEST(Uncertainty, CorrectedDolpLosesTheBias) {
  const double sd = 10, s0 = 1000, unit = sd * std::sqrt(2.0) / s0;
  for (const auto& [snr, limit] : {std::pair{2.0, 0.07}, {3.0, 0.035}, {5.0, 0.035}}) {
    const double dolp = snr * unit;
    const Sample sample = simulate({s0, dolp * s0, 0}, {sd, sd, sd, sd});
    EXPECT_GT(sample.dolp.mean() - dolp, 0.08 * unit);
    EXPECT_LT(std::abs(sample.corrected.mean() - dolp), limit * unit) << snr;
  }
  const Sample dark = simulate({s0, 0, 0}, {sd, sd, sd, sd});
  const double expected = 0.5 * (std::sqrt(std::numbers::pi / 2) + std::sqrt(std::numbers::pi / 6));
  EXPECT_NEAR(dark.corrected.mean() / unit, expected, 0.02);
}

TEST(Uncertainty, DirectionOfUnequalNoiseDoesNotMatterForTheCorrection) {
  const double s0 = 1000, amplitude = 60;
  for (double turn : {0.0, 0.4, 0.9, 1.4}) {
    const Stokes truth{s0, amplitude * std::cos(2 * turn), amplitude * std::sin(2 * turn)};
    const Sample sample = simulate(truth, {16, 8, 16, 8});
    EXPECT_NEAR(sample.corrected.mean(), amplitude / s0, 0.0015) << turn;
  }
}

TEST(Uncertainty, UndefinedAndUnpolarizedPixels) {
  const StokesCovariance v = stokes_covariance(1, 1, 1, 1);
  EXPECT_TRUE(std::isnan(dolp_variance({0, 1, 1}, v)));
  EXPECT_TRUE(std::isnan(aolp_variance_deg2({-1, 1, 1}, v, Intensities::kMeasured)));
  EXPECT_TRUE(std::isnan(corrected_dolp({0, 1, 1}, v)));
  EXPECT_DOUBLE_EQ(corrected_dolp({10, 0, 0}, v), 0);
  EXPECT_DOUBLE_EQ(dolp_variance({10, 0, 0}, v), 2.0 / 100);
  EXPECT_DOUBLE_EQ(aolp_variance_deg2({10, 0, 0}, v, Intensities::kMeasured), 2700);
  EXPECT_DOUBLE_EQ(aolp_variance_deg2({10, 1e-6, 0}, v, Intensities::kMeasured), 2700)
      << "no more than an unknown angle";
}

// Light has a DoLP of 0 to 1, so one of 3 errs by 3 at most, and one of .2 by 1.
TEST(Uncertainty, OfDolpIsNoMoreThanCanBe) {
  const StokesCovariance v = stokes_covariance(100, 100, 100, 100);
  EXPECT_DOUBLE_EQ(dolp_variance({1, 3, 0}, v), 9);
  EXPECT_DOUBLE_EQ(dolp_variance({1, 0.2, 0}, v), 1);
  EXPECT_DOUBLE_EQ(dolp_variance({1, 0, 0}, v), 1);
  EXPECT_LT(dolp_variance({100, 20, 0}, v), 0.03) << "and as before where there is light";
}

TEST(Uncertainty, PlanesFollowThePixelFormulasAndSharedSitesHalveTheVariance) {
  const auto layout =
      SensorLayout::from_sites({{"0", "45", "0", "45"}, {"135", "90", "135", "90"}});
  Planes intensity(8, 3, 5), variance(8, 3, 5);
  for (int k = 0; k < 8; ++k)
    for (std::size_t i = 0; i < 15; ++i) {
      intensity[k].values()[i] = static_cast<float>(100 + 17 * k % 11 + i);
      variance[k].values()[i] = static_cast<float>(4 + k % 4);
    }
  const auto stokes = stokes_per_color(intensity, layout);
  const auto u = uncertainty_per_color(stokes, variance, layout, Intensities::kMeasured);
  ASSERT_EQ(u.size(), 1u);
  // The mean of two sites with variances a and b has (a + b) / 4.
  // 0: k = 0, 2 (4, 6); 45: k = 1, 3 (5, 7); 135: k = 4, 6 (4, 6); 90: k = 5, 7 (5, 7).
  const StokesCovariance v = stokes_covariance(2.5, 3, 3, 2.5);
  const Stokes s{stokes[0].s0(2, 4), stokes[0].s1(2, 4), stokes[0].s2(2, 4)};
  EXPECT_FLOAT_EQ(u[0].s0_variance(2, 4), static_cast<float>(v.s0s0));
  EXPECT_FLOAT_EQ(u[0].s1_variance(2, 4), 5.5f);
  EXPECT_FLOAT_EQ(u[0].s2_variance(2, 4), 5.5f);
  EXPECT_FLOAT_EQ(u[0].dolp_sd(2, 4), static_cast<float>(std::sqrt(dolp_variance(s, v))));
  EXPECT_FLOAT_EQ(u[0].aolp_sd_deg(2, 4),
                  static_cast<float>(std::sqrt(aolp_variance_deg2(s, v, Intensities::kMeasured))));
  EXPECT_FLOAT_EQ(u[0].dolp_corrected(2, 4), static_cast<float>(corrected_dolp(s, v)));
}

// A filter that gives the mean of the truth given the samples: a normal truth, normal noise. Its
// estimates are too short by the posterior variance, of which the share in uncertainty.cpp (0.15)
// is stated here, so that all of it is put back. Standard error of the means: 0.0006.
TEST(Uncertainty, WhatAFilterTookFromDolpIsPutBackOnAverage) {
  constexpr double kS0 = 10, kSignal = 2, kNoise = 3, kShare = 0.15;
  constexpr double kGain = kSignal * kSignal / (kSignal * kSignal + kNoise * kNoise);
  const double variance = kGain * kNoise * kNoise / kShare;
  RandomSequence random(3, 0, Draw::kOther);
  Moments truth, estimate, expected, corrected;
  for (int i = 0; i < 40000; ++i) {
    const double s1 = kSignal * random.normal(), s2 = kSignal * random.normal();
    const Stokes s{kS0, kGain * (s1 + kNoise * random.normal()),
                   kGain * (s2 + kNoise * random.normal())};
    const StokesCovariance v{.s1s1 = variance, .s2s2 = variance};
    truth.add(std::hypot(s1, s2) / kS0);
    estimate.add(dolp_of(s));
    expected.add(expected_dolp(s, v));
    corrected.add(corrected_dolp(s, v));
  }
  EXPECT_NEAR(expected.mean(), truth.mean(), 0.003);
  EXPECT_LT(estimate.mean(), truth.mean() - 0.09);
  EXPECT_LT(corrected.mean(), estimate.mean()) << "the correction for samples goes the other way";
}

TEST(Uncertainty, ExpectedDolpAtItsLimits) {
  const StokesCovariance v{.s1s1 = 8, .s2s2 = 12};
  const double b = std::sqrt(0.15 * 10);
  EXPECT_NEAR(expected_dolp({100, 0, 0}, v), b * std::sqrt(std::numbers::pi / 2) / 100, 1e-12);
  EXPECT_TRUE(std::isnan(expected_dolp({0, 1, 1}, v)));
  EXPECT_DOUBLE_EQ(expected_dolp({100, 30, 40}, {}), 0.5);
  EXPECT_DOUBLE_EQ(expected_dolp({1, 0.6, 0.6}, v), 1) << "not lifted above 1";
  EXPECT_DOUBLE_EQ(expected_dolp({1, 3, 4}, v), 5) << "nor brought down to it";
  // The series from a length of sqrt(200) deviations on meets the Bessel functions.
  const double length = std::sqrt(200.0) * b;
  EXPECT_NEAR(
      expected_dolp({100, length * 1.0001, 0}, v) - expected_dolp({100, length * 0.9999, 0}, v),
      length * 2e-4 / 100 * (1 - 1.0 / 400), 1e-8);
}

TEST(Uncertainty, DenoisedIntensitiesGetTheExpectedDolpAndTheErrorThatTheyShare) {
  const auto layout = SensorLayout::named("polar-mono");
  Planes intensity(4, 1, 1), variance(4, 1, 1);
  for (int k = 0; k < 4; ++k) {
    intensity[k].values()[0] = static_cast<float>(10 + k);
    variance[k].values()[0] = 4;
  }
  const auto stokes = stokes_per_color(intensity, layout);
  const auto u = uncertainty_per_color(stokes, variance, layout, Intensities::kDenoised);
  const Stokes s{stokes[0].s0(0, 0), stokes[0].s1(0, 0), stokes[0].s2(0, 0)};
  EXPECT_FLOAT_EQ(u[0].dolp_corrected(0, 0),
                  static_cast<float>(expected_dolp(s, {.s1s1 = 8 * 0.65, .s2s2 = 8 * 0.65})));
  EXPECT_GT(u[0].dolp_corrected(0, 0), static_cast<float>(dolp_of(s)));
  // Four errors of variance 4, correlated by 0.35: their mean has 1 + 3 * 0.35, S0 is twice it; a
  // difference of two has 1 - 0.35.
  EXPECT_FLOAT_EQ(u[0].s0_variance(0, 0), 4.0f * 2.05f);
  EXPECT_FLOAT_EQ(u[0].s1_variance(0, 0), 8 * 0.65f);
  EXPECT_FLOAT_EQ(u[0].s2_variance(0, 0), 8 * 0.65f);
}

// One angle errs much more than the others, as of light behind a polarizer or with a filled defect:
// beside it next to nothing cancels. All the planes' figures against errors that are drawn.
TEST(Uncertainty, ErrorsThatAreSharedCancelAsFarAsTheyAreAlike) {
  constexpr double kShared = 0.35;
  const Stokes truth{1000, 400, 250};
  for (const std::array<double, 4> sd : {std::array<double, 4>{10, 3, 0.5, 3}, {2, 9, 4, 1}}) {
    const auto layout = SensorLayout::named("polar-mono");
    Planes intensity(4, 1, 1), variance(4, 1, 1);
    for (int k = 0; k < 4; ++k) {
      const int angle = *layout.site(k).angle_deg;
      intensity[k](0, 0) = static_cast<float>(intensity_behind(truth, angle));
      variance[k](0, 0) = static_cast<float>(std::pow(sd[static_cast<std::size_t>(angle / 45)], 2));
    }
    RandomSequence random(17, 0, Draw::kOther);
    Moments s0, s1, s2, dolp, aolp_deg;
    for (int i = 0; i < kDraws; ++i) {
      const double alike = std::sqrt(kShared) * random.normal();
      std::array<double, 4> of;
      for (std::size_t a = 0; a < 4; ++a)
        of[a] = intensity_behind(truth, 45.0 * static_cast<double>(a)) +
                sd[a] * (alike + std::sqrt(1 - kShared) * random.normal());
      const Stokes s = stokes_of(of[0], of[1], of[2], of[3]);
      s0.add(s.s0), s1.add(s.s1), s2.add(s.s2);
      dolp.add(dolp_of(s)), aolp_deg.add(aolp_deg_of(s));
    }
    const auto u = uncertainty_per_color(stokes_per_color(intensity, layout), variance, layout,
                                         Intensities::kDenoised)[0];
    EXPECT_NEAR(s0.variance() / u.s0_variance(0, 0), 1, kVarianceTolerance);
    EXPECT_NEAR(s1.variance() / u.s1_variance(0, 0), 1, kVarianceTolerance);
    EXPECT_NEAR(s2.variance() / u.s2_variance(0, 0), 1, kVarianceTolerance);
    EXPECT_NEAR(dolp.variance() / std::pow(u.dolp_sd(0, 0), 2), 1, kVarianceTolerance);
    EXPECT_NEAR(aolp_deg.variance() / std::pow(u.aolp_sd_deg(0, 0), 2), 1, kVarianceTolerance);
  }
}

TEST(Uncertainty, OfOneUnknownIntensityNothingFollows) {
  const auto layout = SensorLayout::named("polar-mono");
  for (const float unknown :
       {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()})
    for (const auto intensities : {Intensities::kMeasured, Intensities::kDenoised}) {
      Planes intensity(4, 1, 2), variance(4, 1, 2);
      for (int k = 0; k < 4; ++k)
        for (std::size_t i = 0; i < 2; ++i) {
          intensity[k].values()[i] = static_cast<float>(10 + k);
          variance[k].values()[i] = 1;
        }
      variance[2](0, 1) = unknown;
      const auto u =
          uncertainty_per_color(stokes_per_color(intensity, layout), variance, layout, intensities);
      for (const Image* plane : {&u[0].dolp_sd, &u[0].aolp_sd_deg, &u[0].dolp_corrected}) {
        EXPECT_TRUE(std::isfinite((*plane)(0, 0)));
        EXPECT_TRUE(std::isnan((*plane)(0, 1)));
      }
    }
}

struct PlanesAndVariance {
  Planes intensity, variance;
};

PlanesAndVariance sixteen_planes_of_one_variance() {
  PlanesAndVariance planes{Planes(16, 2, 2), Planes(16, 2, 2)};
  for (int k = 0; k < 16; ++k)
    for (std::size_t i = 0; i < 4; ++i) {
      planes.intensity[k].values()[i] = static_cast<float>(100 + k);
      planes.variance[k].values()[i] = 8;
    }
  return planes;
}

// Green averages two sites of every angle.
TEST(Uncertainty, MergedGreenHasHalfTheVariance) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  const auto [intensity, variance] = sixteen_planes_of_one_variance();
  const StokesPicture picture = merge_greens(stokes_per_color(intensity, layout), layout);
  const auto u = uncertainty_of(picture, variance, layout, Intensities::kMeasured);
  ASSERT_EQ(u.size(), 3u);
  EXPECT_FLOAT_EQ(u[0].s1_variance(1, 1), 16);
  EXPECT_FLOAT_EQ(u[1].s1_variance(1, 1), 8);
  EXPECT_FLOAT_EQ(u[2].s0_variance(1, 1), 8);
}

// Of a filter the errors of both greens are correlated by 0.35: their mean has 1.35 times the
// variance of independent ones. Red and blue have one site of every angle.
TEST(Uncertainty, DenoisedGreensShareTheirErrors) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  const auto [intensity, variance] = sixteen_planes_of_one_variance();
  const auto stokes = stokes_per_color(intensity, layout);
  const auto merged =
      uncertainty_of(merge_greens(stokes, layout), variance, layout, Intensities::kDenoised);
  ASSERT_EQ(merged.size(), 3u);
  EXPECT_FLOAT_EQ(merged[0].s1_variance(1, 1), 16 * 0.65f);
  EXPECT_FLOAT_EQ(merged[1].s1_variance(1, 1), 8 * 1.35f * 0.65f);
  EXPECT_FLOAT_EQ(merged[1].s0_variance(1, 1), 4 * 2.05f * 1.35f);
  EXPECT_FLOAT_EQ(merged[2].s2_variance(1, 1), 16 * 0.65f);
  for (const StokesUncertainty& u :
       uncertainty_per_color(stokes, variance, layout, Intensities::kDenoised))
    EXPECT_FLOAT_EQ(u.s1_variance(1, 1), 16 * 0.65f);
}

struct ColorLight {
  Stokes red, green, blue;
};

// Of one 4x4 cell, every pixel with a variance of 8.
PlanesAndVariance cell_of(const SensorLayout& layout, const ColorLight& light) {
  PlanesAndVariance planes{Planes(16, 1, 1), Planes(16, 1, 1)};
  for (int k = 0; k < 16; ++k) {
    const Site site = layout.site(k);
    const Stokes& s = site.color == Color::kRed    ? light.red
                      : site.color == Color::kBlue ? light.blue
                                                   : light.green;
    planes.intensity[k](0, 0) = static_cast<float>(intensity_behind(s, *site.angle_deg));
    planes.variance[k](0, 0) = 8;
  }
  return planes;
}

// Red and blue weigh a third each, the greens a sixth each: independent errors have 5/18 of one
// site's variance, those that are correlated by 0.35 have 0.65 * 5/18 + 0.35.
TEST(Uncertainty, OfTheMeanOfEqualColorsIsSmallerThanTheirOwn) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  const Stokes s{100, 30, 40};
  const auto [intensity, variance] = cell_of(layout, {s, s, s});
  const StokesPicture picture = merge_greens(stokes_per_color(intensity, layout), layout);
  const auto mean = uncertainty_of_mean(picture, variance, layout, Intensities::kMeasured);
  const double one = 8 * 5.0 / 18;
  const StokesCovariance v = stokes_covariance(one, one, one, one);
  EXPECT_FLOAT_EQ(mean.s0_variance(0, 0), static_cast<float>(v.s0s0));
  EXPECT_FLOAT_EQ(mean.s1_variance(0, 0), static_cast<float>(v.s1s1));
  EXPECT_FLOAT_EQ(mean.s2_variance(0, 0), static_cast<float>(v.s2s2));
  EXPECT_NEAR(mean.dolp_sd(0, 0), std::sqrt(dolp_variance(s, v)), 1e-6);
  EXPECT_NEAR(mean.aolp_sd_deg(0, 0), std::sqrt(aolp_variance_deg2(s, v, Intensities::kMeasured)),
              1e-4);
  EXPECT_NEAR(mean.dolp_corrected(0, 0), corrected_dolp(s, v), 1e-6);
  const auto red = uncertainty_of(picture, variance, layout, Intensities::kMeasured)[0];
  EXPECT_NEAR(mean.dolp_sd(0, 0) / red.dolp_sd(0, 0), std::sqrt(5.0 / 18), 1e-5);
  const auto filtered = uncertainty_of_mean(picture, variance, layout, Intensities::kDenoised);
  EXPECT_FLOAT_EQ(filtered.s1_variance(0, 0),
                  static_cast<float>(2 * 8 * (0.65 * 5 / 18 + 0.35) * 0.65));
}

// As of stress fringes: each colour is surely polarized, and their mean is not.
TEST(Uncertainty, OfTheMeanOfOpposedColorsKnowsNoAngle) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  const auto [intensity, variance] = cell_of(layout, {{400, 200, 0}, {400, 0, 0}, {400, -200, 0}});
  const StokesPicture picture = merge_greens(stokes_per_color(intensity, layout), layout);
  const auto own = uncertainty_of(picture, variance, layout, Intensities::kMeasured);
  EXPECT_LT(own[0].aolp_sd_deg(0, 0), 1);
  const auto mean = uncertainty_of_mean(picture, variance, layout, Intensities::kMeasured);
  EXPECT_FLOAT_EQ(mean.aolp_sd_deg(0, 0), static_cast<float>(std::sqrt(kUnknownAngleVarianceDeg2)));
  EXPECT_NEAR(mean.dolp_corrected(0, 0), 0, 1e-6);
  EXPECT_NEAR(own[0].dolp_corrected(0, 0), 0.5, 1e-3);
}

TEST(Uncertainty, NegativeVariancesAreRefusedByTheirPlaceInTheMosaic) {
  const auto layout = SensorLayout::named("polar-mono");
  Planes variance(4, 3, 5);
  variance[0](0, 0) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NO_THROW(require_variances(variance, layout, "v.exr"));
  variance[2](1, 4) = -0.5f;
  try {
    require_variances(variance, layout, "v.exr");
    FAIL() << "a negative variance";
  } catch (const InputError& error) {
    EXPECT_EQ(error.subject(), "v.exr");
    EXPECT_EQ(error.problem(), "a variance is negative: -0.5 DN² in row 3, column 8");
  }
}

}  // namespace
}  // namespace malus
