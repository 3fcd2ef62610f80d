#include "malus/denoise/row_noise.h"

#include <cmath>
#include <vector>

#include "denoise/simulated_rows.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(RowNoise, DeviationAndGroupFromThePicture) {
  NoiseProfile profile = profile_of_rows(1.5, 1.5);
  const SimulatedRows truth = simulate_rows(profile, 600, 600, false);
  NoiseProfile unknown = profile_of_rows(0.0, 1.5);
  unknown.row_group = 1;
  estimate_row_deviation(truth.dn, kRowsSaturateDn, unknown);
  EXPECT_EQ(unknown.row_group, 2);
  EXPECT_NEAR(unknown.channels[0].sigma_row_dn, 1.5, 0.25);
}

// A page of marks 3 columns wide in lines of 4 to 14 rows: they cover a third of their rows'
// pixels, the paper between them lies level.
Image page_of_marks(const NoiseProfile& profile, double light, std::uint32_t seed) {
  RandomSequence marks(9, seed, Draw::kOther), noise(10, seed, Draw::kPixel);
  Image dn(512, 384, static_cast<float>(light));
  const auto rows_up_to = [&](int most) {
    return 4 + static_cast<int>((most - 3) * marks.uniform());
  };
  for (int top = 3, height = 0; top + 14 < dn.rows(); top += height + rows_up_to(9)) {
    height = rows_up_to(14);
    for (int left = 0; left + 3 < dn.cols(); left += 3)
      if (marks.uniform() < 0.35)
        for (int r = top; r < top + height; ++r)
          for (int c = left; c < left + 3; ++c) dn(r, c) = static_cast<float>(0.15 * light);
  }
  for (float& v : dn.values())
    v += static_cast<float>(std::sqrt(profile.channels[0].variance(v)) * noise.normal());
  return dn;
}

TEST(RowNoise, LinesOfTextAreNoRowNoise) {
  for (const double light : {40.0, 200.0})
    for (std::uint32_t seed = 0; seed < 10; ++seed) {
      NoiseProfile unknown = profile_of_rows(0.0, 0.4);
      estimate_row_deviation(page_of_marks(unknown, light, seed), kRowsSaturateDn, unknown);
      EXPECT_EQ(unknown.channels[0].sigma_row_dn, 0) << light << ", page " << seed;
    }
}

// Bars of random heights and levels, equal along each row and weaker than the pixels' noise:
// nothing but that rows resemble those beside them tells them from a camera's.
TEST(RowNoise, BarsThatSpanSeveralRowsAreNoRowNoise) {
  int found = 0;
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    NoiseProfile unknown = profile_of_rows(0.0, 1.5);
    RandomSequence bars(12, seed, Draw::kOther);
    Image dn = simulate_rows(unknown, 512, 256, false, seed).dn;
    double lift = 0;
    for (int r = 0, next = 0; r < dn.rows(); ++r) {
      if (r == next) {
        lift = 7 * bars.normal();
        next = r + 6 + static_cast<int>(12 * bars.uniform());
      }
      for (int c = 0; c < dn.cols(); ++c) dn(r, c) += static_cast<float>(lift);
    }
    estimate_row_deviation(dn, kRowsSaturateDn, unknown);
    found += unknown.channels[0].sigma_row_dn > 0;
  }
  EXPECT_LE(found, 3);  // of 20
}

// Text or bricks: the same lines again and again, no stronger than a camera's.
TEST(RowNoise, LinesThatRepeatAreNoRowNoise) {
  NoiseProfile unknown = profile_of_rows(0.0, 1.5);
  unknown.row_group = 1;
  for (const int period : {4, 7, 14, 30}) {
    RandomSequence lines(3, static_cast<std::uint32_t>(period), Draw::kOther);
    std::vector<double> lift;
    for (int r = 0; r < period; ++r) lift.push_back(6 * lines.normal());
    Image dn = simulate_rows(unknown, 400, 400, false).dn;
    for (int r = 0; r < dn.rows(); ++r)
      for (int c = 0; c < dn.cols(); ++c)
        dn(r, c) += static_cast<float>(lift[static_cast<std::size_t>(r % period)]);
    estimate_row_deviation(dn, kRowsSaturateDn, unknown);
    EXPECT_EQ(unknown.channels[0].sigma_row_dn, 0) << period;
  }
}

// Offsets that follow each other slowly are a camera's all the same (a hundred draws; level 1 %).
TEST(RowNoise, SlowOffsetsAreNotTakenForLinesThatRepeat) {
  int found = 0;
  for (std::uint32_t seed = 0; seed < 100; ++seed) {
    NoiseProfile unknown = profile_of_rows(0.0, 1.5);
    unknown.row_group = 1;
    RandomSequence rows(7, seed, Draw::kOther);
    Image dn = simulate_rows(unknown, 160, 96, false, seed).dn;
    double slow = 0;
    for (int r = 0; r < dn.rows(); ++r) {
      slow = 0.9 * slow + 1.5 * rows.normal();
      for (int c = 0; c < dn.cols(); ++c) dn(r, c) += static_cast<float>(slow + 4 * rows.normal());
    }
    estimate_row_deviation(dn, kRowsSaturateDn, unknown);
    found += unknown.channels[0].sigma_row_dn > 0;
  }
  EXPECT_GE(found, 99);
}

// Its rows agree with those nine further down, but more with those between.
TEST(RowNoise, ABrightBandAcrossHidesNoRowNoise) {
  for (std::uint32_t seed = 0; seed < 10; ++seed) {
    NoiseProfile unknown = profile_of_rows(0.0, 1.5);
    unknown.row_group = 1;
    RandomSequence rows(8, seed, Draw::kOther);
    Image dn = simulate_rows(unknown, 400, 400, false, seed).dn;
    for (int r = 0; r < dn.rows(); ++r) {
      const double lift = 1600 * std::exp(-0.5 * std::pow((r - 200) / 20.0, 2)) + 4 * rows.normal();
      for (int c = 0; c < dn.cols(); ++c) dn(r, c) += static_cast<float>(lift);
    }
    estimate_row_deviation(dn, kRowsSaturateDn, unknown);
    EXPECT_GT(unknown.channels[0].sigma_row_dn, 3) << seed;  // of 4; the band's slopes add some
    EXPECT_LT(unknown.channels[0].sigma_row_dn, 7) << seed;
  }
}

// Two deviations of few rows differ by chance (two hundred draws; level 1 %: half of every offset
// would stay).
TEST(RowNoise, FewRowsAreSeldomTakenForPairs) {
  NoiseProfile profile = profile_of_rows(3.0, 1.5);
  profile.row_group = 1;
  int paired = 0;
  for (std::uint32_t seed = 0; seed < 200; ++seed) {
    NoiseProfile unknown = profile_of_rows(0.0, 1.5);
    estimate_row_deviation(simulate_rows(profile, 128, 96, false, seed).dn, kRowsSaturateDn,
                           unknown);
    paired += unknown.row_group == 2;
  }
  EXPECT_LE(paired, 1);
}

// Without a mosaic the next row may share the draw: it is compared with those further away.
TEST(RowNoise, DeviationOfPairsOfOneChannel) {
  const auto one_channel = [](double sigma_row_dn) {
    NoiseProfile profile = profile_of_rows(sigma_row_dn, 1.5);
    profile.layout = SensorLayout::named("mono");
    profile.channels.resize(1);
    return profile;
  };
  const std::vector<float> saturated_dn(1, 4000.0f);
  const NoiseProfile profile = one_channel(2.0);
  const Image dn = simulate_rows(profile, 600, 200, false).dn;
  NoiseProfile unknown = one_channel(0.0);
  estimate_row_deviation(dn, saturated_dn, unknown);
  EXPECT_EQ(unknown.row_group, 2);
  EXPECT_NEAR(unknown.channels[0].sigma_row_dn, 2.0, 0.3);
  const auto shown = shown_row_variance(dn, profile, saturated_dn);
  ASSERT_TRUE(shown);
  EXPECT_NEAR(shown->value, 1.0, 0.3);
}

}  // namespace
}  // namespace malus
