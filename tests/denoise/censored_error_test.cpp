// Truth: light known without noise; noise from the generative law (synthesize/exact.h), cut off at
// white as a converter does; fixed seeds.
#include "malus/denoise/internal/censored_error.h"

#include "malus/base/random.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kCensoredRows = 256, kCensoredCols = 384;
constexpr double kWhiteDn = 4000;

PhysicsNoise noise_of_layout(const char* layout) {
  return equal_channels(layout, {0.5, 0.1, 0.0, 1.2, 0.0});
}

double deviation_at_white(const PhysicsNoise& noise) {
  return std::sqrt(profile_of(noise).channels[0].variance(kWhiteDn));
}

// From 5 of the noise's deviations below white on the left to 4 above on the right.
Image ramp_through_white(double deviation_dn) {
  Image dn(kCensoredRows, kCensoredCols);
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c)
      dn(r, c) = static_cast<float>(kWhiteDn + deviation_dn * (9.0 * c / dn.cols() - 5));
  return dn;
}

RawFrame cut_off_frame(const Image& clean, const PhysicsNoise& noise) {
  RawFrame frame = drawn_frame(clean, noise, {.white_dn = kWhiteDn}, 17);
  for (float& v : frame.dn.values()) v = std::min(v, static_cast<float>(kWhiteDn));
  return frame;
}

TEST(CensoringBias, IsWhatCuttingOffTakesFromAGaussiansMean) {
  // The mean of 400,000 draws has a standard error of 0.0016 deviations: 4 of them.
  constexpr int kDraws = 400000;
  RandomSequence random(3, 0, Draw::kOther);
  std::vector<double> z;
  for (int i = 0; i < kDraws; ++i) z.push_back(random.normal());
  for (const double white : {-2.0, -1.0, 0.0, 0.7, 2.0}) {
    double lost = 0, above = 0;
    for (const double v : z) {
      lost += std::max(v - white, 0.0);
      above += v > white;
    }
    EXPECT_NEAR(censoring_bias(above / kDraws), lost / kDraws, 0.0064) << white;
  }
  EXPECT_NEAR(censoring_bias(0.5), 1 / std::sqrt(2 * std::acos(-1.0)), 1e-12);
}

TEST(CensoringError, IsOfTheChannelsOwnNeighboursAndOfLightNearWhite) {
  const PhysicsNoise noise = noise_of_layout("polar-mono");
  const NoiseProfile profile = profile_of(noise);
  const double deviation_dn = deviation_at_white(noise);
  const auto white_dn = static_cast<float>(kWhiteDn);
  PreparedFrame frame;
  frame.layout = noise.layout;
  frame.dn = Image(40, 40, white_dn - static_cast<float>(2 * deviation_dn));
  frame.saturated_dn.assign(4, white_dn);
  frame.dn(20, 20) = white_dn;
  frame.dn(0, 0) = frame.dn(0, 2) = white_dn;
  frame.dn(24, 22) = white_dn - static_cast<float>(4 * deviation_dn);
  frame.saturated = SaturatedPixels(frame.dn, frame.layout, frame.saturated_dn);
  Image variance_dn2(40, 40, 1.0f);
  add_censoring_error(frame, profile, frame.dn, variance_dn2);
  const auto stated = [&](double share) {
    return 1 + std::pow(deviation_dn * censoring_bias(share), 2);
  };
  for (int r = 10; r < 40; ++r)
    for (int c = 10; c < 40; ++c) {
      const bool around =
          r % 2 == 0 && c % 2 == 0 && std::abs(r - 20) <= 4 && std::abs(c - 20) <= 4;
      const bool dark = r == 24 && c == 22, saturated = r == 20 && c == 20;
      EXPECT_NEAR(variance_dn2(r, c), around && !dark && !saturated ? stated(1 / 25.0) : 1.0, 1e-3)
          << r << ' ' << c;
    }
  // At the border there are fewer: two of nine, and one of 3 x 5 further in.
  EXPECT_NEAR(variance_dn2(2, 0), stated(2 / 12.0), 1e-3 * stated(2 / 12.0));
  EXPECT_NEAR(variance_dn2(0, 6), stated(1 / 15.0), 1e-3 * stated(1 / 15.0));
}

class BesideSaturation : public testing::TestWithParam<std::pair<const char*, const char*>> {};
INSTANTIATE_TEST_SUITE_P(Layouts, BesideSaturation,
                         testing::Values(std::pair{"polar-mono", "nl-ridge"},
                                         std::pair{"bayer-rggb", "bm3d"},
                                         std::pair{"polar-bayer-rggb", "nl-ridge"}));

// Level by level of the true light, in deviations from white: the pixels that by chance are not
// saturated. Prints the table of docs/uncertainty.md.
TEST_P(BesideSaturation, TwoDeviationsHoldTheLight) {
  const PhysicsNoise noise = noise_of_layout(GetParam().first);
  const double deviation_dn = deviation_at_white(noise);
  const Image clean = ramp_through_white(deviation_dn);
  const RawFrame frame = cut_off_frame(clean, noise);
  const Denoised result = denoise_frame(frame, profile_of(noise), {.method = GetParam().second},
                                        silent_progress(), true);
  for (const double low : {-4.0, -2.0, -1.0, 0.0, 1.0}) {
    double error2 = 0, stated = 0, covered = 0, count = 0;
    for (int r = 0; r < clean.rows(); ++r)
      for (int c = 0; c < clean.cols(); ++c) {
        const double level = (double{clean(r, c)} - kWhiteDn) / deviation_dn;
        if (level < low || level >= low + 1 || frame.dn(r, c) >= kWhiteDn) continue;
        const double error = double{result.dn_above_black(r, c)} - clean(r, c),
                     variance = (*result.variance_dn2)(r, c);
        ASSERT_TRUE(std::isfinite(variance));
        error2 += error * error;
        stated += variance;
        covered += error * error <= 4 * variance;
        ++count;
      }
    ASSERT_GT(count, 300) << low;
    std::printf("%-18s %-9s %4.0f to %2.0f deviations: error %.2f of the stated, %.0f %% covered\n",
                GetParam().first, GetParam().second, low, low + 1, std::sqrt(error2 / stated),
                100 * covered / count);
    EXPECT_GT(covered / count, 0.9) << low;
    EXPECT_LT(std::sqrt(error2 / stated), 1.4) << low;
    EXPECT_GT(std::sqrt(error2 / stated), 0.3) << low;
  }
}

}  // namespace
}  // namespace malus
