#include "malus/evaluate/uncertainty_check.h"

#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <utility>

#include <gtest/gtest.h>

namespace malus {
namespace {

struct Simulated {
  Image truth, estimate, variance;
};

// Gaussian errors of a known deviation, stated `scale` times as large.
Simulated gaussian_errors(const SensorLayout& layout, double scale) {
  std::mt19937 engine(5);
  std::normal_distribution<double> normal;
  Simulated s{Image(400, 400), Image(400, 400), Image(400, 400)};
  for (int r = 0; r < 400; ++r)
    for (int c = 0; c < 400; ++c) {
      const double angle_deg =
          layout.polarized() ? *layout.site(layout.channel_at(r, c)).angle_deg : 0.0;
      s.truth(r, c) = static_cast<float>(1000 + 400 * std::cos(angle_deg * std::numbers::pi / 90));
      const double deviation = 10 + 0.01 * c;
      s.estimate(r, c) = s.truth(r, c) + static_cast<float>(deviation * normal(engine));
      s.variance(r, c) = static_cast<float>(scale * scale * deviation * deviation);
    }
  return s;
}

// Within four standard errors of n independent draws (level 6e-5).
void expect_share(const Coverage& coverage, double share) {
  ASSERT_GT(coverage.all, 1000);
  const double error = std::sqrt(share * (1 - share) / static_cast<double>(coverage.all));
  EXPECT_NEAR(coverage.share(), share, 4 * error);
}

TEST(UncertaintyCheck, GaussianErrorsAreHeldAsOftenAsTheIntegralSays) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  for (const double scale : {0.5, 1.0, 1.5}) {
    const Simulated s = gaussian_errors(layout, scale);
    UncertaintyCheck check;
    add_uncertainty(check, s.truth, s.estimate, s.variance, layout);
    // How often two deviations hold a normal error of which `factor` times the variance is stated.
    const auto share = [&](double factor) {
      return std::erf(2 * scale * std::sqrt(factor) / std::sqrt(2.0));
    };
    expect_share(check.pixel, share(1));
    // S0, S1 and S2 are given what errors that are correlated by 0.35 would have; these are
    // independent. DoLP's variance is (Var S1 + p² Var S0) / S0² with p = 0.4, Var S1 = 2 Var S0.
    constexpr double kSum = 1 + 3 * 0.35, kDifference = 1 - 0.35;
    expect_share(check.s0, share(kSum));
    for (const Coverage* coverage : {&check.s1, &check.s2, &check.aolp})
      expect_share(*coverage, share(kDifference));
    expect_share(check.dolp, share((2 * kDifference + 0.16 * kSum) / (2 + 0.16)));
    for (const auto& [coverage, factor] :
         {std::pair{&check.pixel, 1.0}, {&check.s0, kSum}, {&check.s1, kDifference}})
      EXPECT_NEAR(coverage->error_over_stated() * scale * scale * factor, 1, 0.02);
  }
}

TEST(UncertaintyCheck, AnglesAreTheSameAfterHalfATurnAndNotAfterAQuarter) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  const auto at_angle = [&](double aolp_deg) {
    Image mosaic(16, 16);
    for (int r = 0; r < 16; ++r)
      for (int c = 0; c < 16; ++c) {
        const double site_deg = *layout.site(layout.channel_at(r, c)).angle_deg;
        mosaic(r, c) =
            static_cast<float>(100 + 50 * std::cos((site_deg - aolp_deg) * std::numbers::pi / 90));
      }
    return mosaic;
  };
  const Image small(16, 16, 0.01f);
  UncertaintyCheck near, far;
  add_uncertainty(near, at_angle(0.01), at_angle(-0.01), small, layout);
  add_uncertainty(far, at_angle(10), at_angle(100), small, layout);
  EXPECT_EQ(near.aolp.share(), 1);
  EXPECT_EQ(far.aolp.share(), 0);
}

// S0 = 200 and DoLP 0.5. Of a variance v of every pixel, denoised ones being correlated by 0.35,
// DoLP has (2 (1 - 0.35) + 0.25 (1 + 3 * 0.35)) v / 200²: half of its 0.5 at v = 1379.
TEST(UncertaintyCheck, AnglesCountWhereDolpIsAboveTwoDeviations) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  Image mosaic(16, 16);
  for (int r = 0; r < 16; ++r)
    for (int c = 0; c < 16; ++c) {
      const double site_deg = *layout.site(layout.channel_at(r, c)).angle_deg;
      mosaic(r, c) = static_cast<float>(100 + 50 * std::cos(site_deg * std::numbers::pi / 90));
    }
  for (const float variance : {1340.0f, 1420.0f}) {
    UncertaintyCheck check;
    add_uncertainty(check, mosaic, mosaic, Image(16, 16, variance), layout);
    EXPECT_EQ(check.dolp.all, 64);
    EXPECT_EQ(check.aolp.all, variance < 1379 ? 64 : 0);
  }
}

TEST(UncertaintyCheck, ErrorsOfDolpAreHeldToItsRange) {
  DolpError error;
  error.add(0.5, 0.3);
  error.add(7.0, 0.9);  // as 1
  error.add(0.2, std::numeric_limits<double>::quiet_NaN());
  error.add(std::numeric_limits<double>::quiet_NaN(), 0.2);
  EXPECT_EQ(error.squared.count, 2);
  EXPECT_NEAR(error.mean(), 0.15, 1e-12);
  EXPECT_NEAR(*psnr_db(error.squared, 1.0), -10 * std::log10((0.04 + 0.01) / 2), 1e-9);
}

TEST(UncertaintyCheck, DolpAsItIsAndCorrected) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  const Simulated s = gaussian_errors(layout, 1.0);
  UncertaintyCheck check;
  add_uncertainty(check, s.truth, s.estimate, s.variance, layout);
  EXPECT_EQ(check.as_it_is.squared.count, 200 * 200);
  // S1 = 800, S0 = 2000, deviations below 20: the bias is that of noise, and lengthening adds more.
  EXPECT_NEAR(check.as_it_is.mean(), 0, 5e-4);
  EXPECT_GT(check.corrected.mean(), check.as_it_is.mean());
}

TEST(UncertaintyCheck, FramesAddUpAndWhatIsNoNumberIsLeftOut) {
  const SensorLayout layout = SensorLayout::named("bayer-rggb");
  Simulated s = gaussian_errors(layout, 1);
  UncertaintyCheck check;
  add_uncertainty(check, s.truth, s.estimate, s.variance, layout);
  EXPECT_EQ(check.pixel.all, 160000);
  EXPECT_EQ(check.s0.all, 0);
  EXPECT_EQ(check.aolp.all, 0);
  s.estimate(3, 4) = std::numeric_limits<float>::quiet_NaN();
  s.variance(5, 6) = std::numeric_limits<float>::infinity();
  add_uncertainty(check, s.truth, s.estimate, s.variance, layout);
  EXPECT_EQ(check.pixel.all, 319998);
  EXPECT_TRUE(std::isfinite(check.pixel.error_over_stated()));
}

}  // namespace
}  // namespace malus
