#include "malus/denoise/row_noise.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "denoise/simulated_rows.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

double rms_error(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(RowNoise, OffsetsAreFoundWithTheirDeviation) {
  const NoiseProfile profile = profile_of_rows(1.0, 1.5);
  const SimulatedRows truth = simulate_rows(profile, 400, 600, false);
  const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
  ASSERT_EQ(rows.offset.size(), 200u);
  // 1200 pixels of 7.7 DN: 0.22 of the offsets' deviation is the floor.
  EXPECT_LT(rms_error(rows.offset, truth.offset), 0.45);
}

// Rows whose pixels have the offsets' deviation, and ten times it: slow waves of the offsets are
// most of what is left.
TEST(RowNoise, TheStatedDeviationIsThatOfTheOffsetsErrors) {
  for (const double sigma_row_dn : {7.7, 0.77}) {
    const NoiseProfile profile = profile_of_rows(sigma_row_dn, 1.5);
    const SimulatedRows truth = simulate_rows(profile, 800, 600, false);
    const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
    double stated = 0;
    for (const double deviation : rows.deviation) stated += deviation * deviation / 400;
    EXPECT_NEAR(std::sqrt(stated) / rms_error(rows.offset, truth.offset), 1.0, 0.25)
        << sigma_row_dn;
  }
}

// Offsets that drift, of a camera whose model knows it and of one whose model takes them for white:
// what is left then is up to 2.5 times what is stated.
TEST(RowNoise, OffsetsThatDriftAreFoundByTheModelsDrift) {
  NoiseProfile profile = profile_of_rows(2.0, 1.5);
  const RowDrift drift{0.7, 10.0};
  double left = 0, stated = 0, left_by_white = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const SimulatedRows truth = simulate_rows(profile, 800, 600, false, seed, drift);
    profile.row_drift = drift;
    const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
    left += std::pow(rms_error(rows.offset, truth.offset), 2) / 8;
    for (const double deviation : rows.deviation) stated += deviation * deviation / 3200;
    profile.row_drift = {};
    left_by_white +=
        std::pow(
            rms_error(estimate_row_noise(truth.dn, profile, kRowsSaturateDn).offset, truth.offset),
            2) /
        8;
  }
  EXPECT_LT(left, 0.7 * left_by_white);
  EXPECT_NEAR(std::sqrt(stated / left), 1.0, 0.15);
}

TEST(RowNoise, APictureIsNotTakenForRows) {
  const NoiseProfile profile = profile_of_rows(1.0, 1.5);
  const SimulatedRows truth = simulate_rows(profile, 400, 600, true);
  const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
  // The waves lift rows by 0.7 DN against their neighbours, two thirds of the noise.
  EXPECT_LT(rms_error(rows.offset, truth.offset), 0.92);
  // The row beside the horizontal edge of 50 DN must not be lifted by more than the model's rows.
  for (const double offset : rows.offset) EXPECT_LT(std::abs(offset), 3.5);
}

// Lit windows of 12 columns and 16 rows on a ground of 2 DN: they cover a seventh of their rows,
// and each row that is compared across their edge differs from them by up to 600 DN.
TEST(RowNoise, LitWindowsLeaveNoStreaksInTheirRows) {
  for (const double sigma_row_dn : {0.5, 2.0}) {
    const NoiseProfile profile = profile_of_rows(sigma_row_dn, 0.5);
    RandomSequence windows(13, 0, Draw::kOther), noise(14, 0, Draw::kPixel);
    SimulatedRows truth = simulate_rows(profile, 512, 512, false);
    const auto lit = [](int row) { return row % 64 >= 24 && row % 64 < 40; };
    double light = 0;
    for (int r = 0; r < 512; r += 16)
      for (int c = 0; c < 512; ++c) {
        if (c % 12 == 0)
          light = windows.uniform() < 0.15 ? 20 * std::pow(30, windows.uniform()) : 2;
        for (int i = r; i < r + 16; ++i) {
          const double clean = lit(i) ? light : 2;
          truth.dn(i, c) = static_cast<float>(
              clean + std::sqrt(0.5 * clean + 14) * noise.normal() +
              profile.channels[static_cast<std::size_t>(profile.layout.channel_at(i, c))]
                      .sigma_row_dn *
                  truth.offset[static_cast<std::size_t>(i / 2)]);
        }
      }
    const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
    double error_dn2 = 0, stated_dn2 = 0;
    for (int r = 0; r < 512; ++r)
      if (lit(r)) {
        const auto g = static_cast<std::size_t>(r / 2);
        error_dn2 += std::pow(sigma_row_dn * (rows.offset[g] - truth.offset[g]), 2) / 128;
        stated_dn2 += std::pow(sigma_row_dn * rows.deviation[g], 2) / 128;
      }
    EXPECT_LT(error_dn2, std::pow(0.5 * sigma_row_dn, 2)) << sigma_row_dn;
    EXPECT_LT(error_dn2 / stated_dn2, 1.5) << sigma_row_dn;
  }
}

TEST(RowNoise, RowsStrongerThanTheModelSaysAreStillRemoved) {
  const SimulatedRows truth = simulate_rows(profile_of_rows(1.6, 1.5), 400, 600, false);
  const RowNoise rows = estimate_row_noise(truth.dn, profile_of_rows(1.0, 1.5), kRowsSaturateDn);
  std::vector<double> drawn_dn = truth.offset;
  for (double& offset : drawn_dn) offset *= 1.6;
  // 1.6 DN is what was there.
  EXPECT_LT(rms_error(rows.offset, drawn_dn), 0.6);
}

// Lines of two rows every 28, five deviations of the rows' noise high.
TEST(RowNoise, LinesThatNoNoiseExplainsAreLeftInThePicture) {
  const NoiseProfile profile = profile_of_rows(3.0, 0.5);
  SimulatedRows truth = simulate_rows(profile, 560, 600, false);
  const auto line = [](std::size_t group) { return group % 14 == 5; };
  for (int r = 0; r < 560; ++r)
    if (line(static_cast<std::size_t>(r / 2)))
      for (int c = 0; c < 600; ++c) truth.dn(r, c) += 15;
  const RowNoise rows = estimate_row_noise(truth.dn, profile, kRowsSaturateDn);
  std::vector<double> error;
  double taken = 0, count = 0;
  for (std::size_t g = 0; g < rows.offset.size(); ++g)
    if (line(g)) {
      taken += rows.offset[g];
      ++count;
      if (rows.offset[g] == 0) {
        EXPECT_EQ(rows.deviation[g], 1);
      }
    } else {
      error.push_back(rows.offset[g] - truth.offset[g]);
    }
  EXPECT_LT(taken / count, 0.5);  // of 5; those that noise of 2 deviations hides are taken
  EXPECT_LT(rms_error(error, std::vector<double>(error.size())), 0.45);
}

// 5 % of the frames may lose the offset of their furthest row, and no more.
TEST(RowNoise, RowsOfTheNoiseAreSeldomTakenForLines) {
  int kept = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const NoiseProfile profile = profile_of_rows(3.0, 0.5);
    const RowNoise rows = estimate_row_noise(simulate_rows(profile, 400, 160, false, seed).dn,
                                             profile, kRowsSaturateDn);
    kept += static_cast<int>(std::count(rows.offset.begin(), rows.offset.end(), 0.0));
  }
  EXPECT_LE(kept, 4);  // 1 is expected; more than 4 of 20 in 0.3 % of all sets of seeds
}

TEST(RowNoise, LevelStripesAreLeftInThePicture) {
  const NoiseProfile profile = profile_of_rows(1.0, 1.5);
  SimulatedRows frame = simulate_rows(profile, 400, 600, false);
  for (int r = 0; r < 400; ++r)
    for (int c = 0; c < 600; ++c)
      frame.dn(r, c) += static_cast<float>(5 * std::sin(2 * 3.14159265358979 * r / 21.3));
  const RowNoise rows = estimate_row_noise(frame.dn, profile, kRowsSaturateDn);
  double taken = 0;  // along the stripes, 5 is all of them
  for (int g = 0; g < 200; ++g)
    taken += rows.offset[static_cast<std::size_t>(g)] *
             std::sin(2 * 3.14159265358979 * (2 * g + 0.5) / 21.3) / 100;
  EXPECT_LT(std::abs(taken), 1.0);
}

// In the lower half alone, so that most rows of the frame stand out by no more than a camera's.
TEST(RowNoise, StripesOfAPartOfTheFrameStayAndWhatTheyHideIsStated) {
  const NoiseProfile profile = profile_of_rows(4.0, 1.5);
  for (const int half_period : {6, 16}) {
    SimulatedRows frame = simulate_rows(profile, 512, 512, false, 5);
    const auto stripe = [&](int row) {
      return row < 272 ? 0.0 : (row / half_period) % 2 ? -1.0 : 1.0;
    };
    for (int r = 0; r < 512; ++r)
      for (int c = 0; c < 512; ++c) frame.dn(r, c) += static_cast<float>(6.5 * stripe(r));
    const RowNoise rows = estimate_row_noise(frame.dn, profile, kRowsSaturateDn);
    double taken = 0, error = 0, stated = 0, above = 0;
    for (int r = 0; r < 512; ++r) {
      const auto g = static_cast<std::size_t>(r / 2);
      const double missed = rows.offset[g] - frame.offset[g];
      if (r < 240) above += missed * missed / 240;
      if (r < 272) continue;
      taken += 4.0 * rows.offset[g] * stripe(r) / 240;
      error += missed * missed / 240;
      stated += rows.deviation[g] * rows.deviation[g] / 240;
    }
    EXPECT_LT(std::abs(taken), 1.3) << half_period;  // of 6.5
    EXPECT_LT(error / stated, 2) << half_period;
    EXPECT_LT(above, 0.2) << half_period;  // the other half loses its offsets as before
  }
}

TEST(RowNoise, StripesThatDwarfTheNoiseAreNoRowNoise) {
  NoiseProfile profile = profile_of_rows(0.0, 1.5);
  SimulatedRows frame = simulate_rows(profile, 600, 600, false);
  for (int r = 0; r < 600; ++r)
    for (int c = 0; c < 600; ++c)
      frame.dn(r, c) += static_cast<float>(40 * std::sin(2 * 3.14159265358979 * r / 21.3));
  estimate_row_deviation(frame.dn, kRowsSaturateDn, profile);
  EXPECT_EQ(profile.channels[0].sigma_row_dn, 0.0);
}

TEST(RowNoise, NothingWithoutRowNoiseInTheModel) {
  const SimulatedRows truth = simulate_rows(profile_of_rows(1.0, 1.5), 64, 64, false);
  for (const double offset :
       estimate_row_noise(truth.dn, profile_of_rows(0.0, 1.5), kRowsSaturateDn).offset)
    EXPECT_EQ(offset, 0.0);
}

TEST(RowNoise, RemovalSubtractsTheChannelsOwnShareAndLeavesSaturatedPixels) {
  const NoiseProfile profile = profile_of_rows(2.0, 1.5);
  Image dn(4, 4, 100.0f);
  dn(0, 0) = 4000;
  dn(0, 1) = 3990;  // the next channel saturates earlier
  dn(1, 0) = 3990;
  std::vector<float> saturated_dn = kRowsSaturateDn;
  saturated_dn[1] = 3985;
  remove_row_noise(dn, profile, RowNoise{{1.0, -0.5}, {1, 1}},
                   SaturatedPixels(dn, profile.layout, saturated_dn));
  EXPECT_EQ(dn(0, 0), 4000.0f);
  EXPECT_EQ(dn(0, 1), 3990.0f);
  EXPECT_NEAR(dn(1, 0), 3988.0f, 1e-3);
  EXPECT_NEAR(dn(1, 1), 98.0f, 1e-4);
  EXPECT_NEAR(dn(2, 1), 101.1f, 1e-4);
}

}  // namespace
}  // namespace malus
