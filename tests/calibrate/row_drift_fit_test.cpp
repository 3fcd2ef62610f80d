#include "malus/calibrate/internal/row_drift_fit.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"

#include <cmath>
#include <string>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Rows that drift, drawn by their definition as a sum of two parts and not by row_kernel(): the
// slow part starts in its stationary state. Each frame has a level of its own.
FrameSeries drifting_offsets(const RowDrift& drift, int frames, int groups, double pixel_variance,
                             std::uint64_t seed) {
  FrameSeries series;
  const double decay = drift.white() ? 0.0 : std::exp(-1.0 / drift.length_groups);
  for (int f = 0; f < frames; ++f) {
    RandomSequence random(seed, static_cast<std::uint32_t>(f), Draw::kRow);
    const double level = random.normal();
    double slow = random.normal();
    std::vector<double> frame;
    for (int g = 0; g < groups; ++g) {
      // Odd groups have other channels: another deviation, another level.
      const double sigma = g % 2 ? 1.3 : 0.8;
      frame.push_back(
          level * (1 + g % 2) +
          sigma * (std::sqrt(drift.share) * slow + std::sqrt(1 - drift.share) * random.normal()) +
          std::sqrt(pixel_variance) * sigma * random.normal());
      slow = decay * slow + std::sqrt(1 - decay * decay) * random.normal();
    }
    series.push_back(std::move(frame));
  }
  return series;
}

std::vector<double> explained(double pixel_variance) {
  return {pixel_variance * 0.8 * 0.8, pixel_variance * 1.3 * 1.3};
}

// Mean error over 60 data sets within 4 of its standard errors, scatter as claimed (a variance of
// 60 values has a relative error of 18 %; 4 of them).
TEST(RowDriftFit, IsUnbiasedWithTheScatterItClaims) {
  constexpr int kSets = 60;
  const struct {
    RowDrift drift;
    int frames, groups;
  } cases[] = {{{0.33, 2.0}, 25, 240},
               {{0.8, 5.0}, 40, 120},
               {{0.3, 20.0}, 30, 400},
               {{0.3, 20.0}, 30, 128},
               {{0.5, 150.0}, 30, 1200}};
  for (const auto& c : cases) {
    Moments share, length;
    for (std::uint64_t seed = 0; seed < kSets; ++seed) {
      const auto found = fit_row_drift(drifting_offsets(c.drift, c.frames, c.groups, 0.4, seed),
                                       explained(0.4), c.frames);
      ASSERT_TRUE(found) << found.reason();
      share.add((found->drift.share - c.drift.share) / found->share_stderr);
      length.add((found->drift.length_groups - c.drift.length_groups) / found->length_stderr);
    }
    const double limit = 4 / std::sqrt(kSets);
    EXPECT_NEAR(share.mean(), 0, limit) << c.drift.length_groups;
    EXPECT_NEAR(length.mean(), 0, limit) << c.drift.length_groups;
    EXPECT_NEAR(share.variance(), 1, 0.75) << c.drift.length_groups;
    EXPECT_NEAR(length.variance(), 1, 0.75) << c.drift.length_groups;
  }
}

// White rows: the stated chance of a false drift is 1 in 1000; none of 200 is seen.
TEST(RowDriftFit, WhiteRowsStayWhite) {
  for (std::uint64_t seed = 0; seed < 200; ++seed)
    EXPECT_FALSE(fit_row_drift(drifting_offsets({}, 10, 128, 0.4, seed), explained(0.4), 10));
}

// Two frames about their mean are one, and its mirror image.
TEST(RowDriftFit, WhiteRowsOfTwoFramesStayWhite) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    FrameSeries rows = drifting_offsets({}, 1, 32 << seed % 5, 0.4, seed);
    rows.push_back(rows.front());
    for (double& offset : rows.back()) offset = -offset;
    EXPECT_FALSE(fit_row_drift(rows, explained(0.4), 1)) << seed;
  }
}

TEST(RowDriftFit, SaysWhyItCannotDecide) {
  const auto few = fit_row_drift(drifting_offsets({0.9, 4}, 1, 128, 0, 1), {1, 1}, 1);
  ASSERT_FALSE(few);
  EXPECT_NE(few.reason().find("1 frames of 128"), std::string::npos);
  const auto small = fit_row_drift(drifting_offsets({0.9, 4}, 30, 16, 0, 1), {1, 1}, 30);
  EXPECT_FALSE(small);
  const FrameSeries constant(10, std::vector<double>(64, 2.0));
  const auto none = fit_row_drift(constant, {0.1}, 10);
  ASSERT_FALSE(none);
  EXPECT_NE(none.reason().find("too little row noise"), std::string::npos);
}

// Against the sums over all pairs of groups, written out.
TEST(RowDriftSampling, EqualsTheSumOverAllPairs) {
  const RowDrift drift{0.6, 3.0};
  for (const int shift : {0, 1, -2}) {
    double means = 0, variances = 0;
    for (int a = 0; a < 20; ++a)
      for (int b = 0; b < 20; ++b) {
        const int lag = std::abs(3 * (b - a) + shift);
        if (lag == 0) continue;
        means += row_autocorrelation(drift, lag) / 20;
        variances += std::pow(row_autocorrelation(drift, lag), 2) / 20;
      }
    EXPECT_NEAR(drift_of_means(drift, 20, 3, shift), means, 1e-12);
    EXPECT_NEAR(drift_of_variances(drift, 20, 3, shift), variances, 1e-12);
  }
  EXPECT_EQ(drift_of_means({}, 20, 3, 0), 0.0);
}

// Against the spread of 4000 draws of share and length: its own error is 1.1 %. Level: four of
// them.
TEST(RowDriftFit, ErrorsOfShareAndLengthAreThoseOfTheSum) {
  FittedRowDrift fitted{{{0.5, 8.0}, 0.02, 0.4}, -0.004};
  RandomSequence random(3, 0, Draw::kParameters);
  Moments sums;
  for (int i = 0; i < 4000; ++i) {
    const double a = random.normal(), b = random.normal();
    const double rho = -0.004 / (0.02 * 0.4);
    const RowDrift drawn{0.5 + 0.02 * a, 8.0 + 0.4 * (rho * a + std::sqrt(1 - rho * rho) * b)};
    sums.add(drift_of_means(drawn, 100, 2, 0));
  }
  const double spread = std::sqrt(sums.variance());
  EXPECT_NEAR(drift_of_means_stderr(fitted, 100, 2), spread, 0.045 * spread);
  EXPECT_EQ(drift_of_means_stderr({}, 100, 2), 0.0);
}

// A quarter of the frame's height: σ_b of such sessions scatters by 6 % (60 of a NumPy camera),
// and without the drift's own errors 4.7 % were stated.
TEST(RowDriftFit, ErrorsAreCarriedIntoTheRowsDeviation) {
  std::vector<double> relative;
  for (std::uint64_t seed = 0; seed < 9; ++seed) {
    testing::SimulatedCamera camera;
    camera.seed = seed;
    camera.rows = 256;
    camera.cols = 64;
    camera.bias_frames = 20;
    camera.flat_levels = 0;
    camera.gains.push_back(testing::polar_gain(12, "mono", 1));
    camera.gains[0].noise.channels[0].sigma_row_dn = 2;
    camera.gains[0].noise.row_drift = {0.8, 64};
    CalibrationInput input = testing::simulated_session(camera);
    input.row_group = 1;
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    const ChannelStatistics& row = model.physics.front().sigma_row;
    relative.push_back(row.standard_error.front() / row.mean.front());
  }
  EXPECT_GT(median_of(relative), 0.06);
}

// No drift was looked for in two or three frames, nor where the row group is not known: the truth
// lay within two stated errors of σ_b in 58 % of the sessions. Now in 90 %, for a frame may show
// little of its own drift; 60 sessions know that to 4 %. Level: four of it.
TEST(RowDriftFit, FewFramesHoldTheDriftInTheirErrors) {
  constexpr int kSessions = 60;
  constexpr double kLeast = 0.74 * kSessions;
  for (const int frames : {2, 3}) {
    int row = 0, mu = 0;
    for (std::uint64_t seed = 0; seed < kSessions; ++seed) {
      testing::SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 1.2, 2.0, seed);
      camera.rows = 256;
      camera.cols = 64;
      camera.bias_frames = frames;
      camera.flat_levels = 0;
      camera.gains[0].noise.row_drift = {0.8, 10};
      const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
      row += std::abs(p.sigma_row.mean[0] - 2.0) < 2 * p.sigma_row.standard_error[0];
      mu += std::abs(p.mu.mean[0]) < 2 * p.mu.standard_error[0];
    }
    EXPECT_GE(row, kLeast) << frames;
    EXPECT_GE(mu, kLeast) << frames;
  }
}

// A quarter of the rows may lie higher than the others by more than half of the temporal noise.
TEST(RowDrift, IsNoLightLeak) {
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    testing::SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 1.2, 1.5, seed);
    camera.rows = 256;
    camera.cols = 64;
    camera.bias_frames = 2;
    camera.flat_levels = 4;
    camera.gains[0].noise.row_drift = {0.9, 20};
    CalibrationInput input = testing::simulated_session(camera);
    input.row_group = 1;
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    for (const std::string& said : model.physics[0].warnings)
      EXPECT_EQ(said.find("light leak"), std::string::npos) << said;
  }
}

}  // namespace
}  // namespace malus
