// Closure: what the compiled sampler draws from a model, calibration finds again: covariances
// between channels, which vary a frame's parameters together, and the laws over gain.
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/row_drift_fit.h"
#include "malus/synthesize/synthesizer.h"

#include <cmath>
#include <memory>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kBiasFrames = 300, kLevels = 6, kRows = 64, kCols = 512;
// A channel lies in every second row group: 16 groups of 128 pixels in a frame.
constexpr double kGroups = kRows / 4, kGroupPixels = kCols / 4;
constexpr RowDrift kDrift{0.4, 1.5};

FrameSet drawn_set(const std::shared_ptr<const Synthesizer>& camera, FrameKind kind, double gain_db,
                   float level_dn, int count, std::uint64_t seed) {
  FrameSet set;
  set.kind = kind;
  set.gain.gain_db = gain_db;
  set.exposure_s = static_cast<double>(level_dn);
  set.count = count;
  set.load = [=](int i) {
    const Image clean(kRows, kCols, level_dn);
    const NoiseModel& model = camera->model();
    return camera->draw_raw(clean, GainSetting{.gain_db = gain_db, .iso = {}},
                            {.seed = seed, .frame = static_cast<std::uint32_t>(i)}, model.black_dn,
                            model.white_dn);
  };
  return set;
}

struct Closure {
  NoiseModel truth = load_model("builtin:imx250myr-simulated");
  NoiseModel found;
  Closure() {
    // The built-in model's rows are white.
    for (PhysicsCalibration& p : truth.physics) p.row_drift.drift = kDrift;
    truth.joint = fit_joint_model(truth.physics).value();
    const auto camera = std::make_shared<const Synthesizer>(truth, SynthesisSettings{});
    CalibrationInput input;
    input.row_group = truth.row_group;
    for (const PhysicsCalibration& p : truth.physics) {
      const double db = *p.gain.gain_db;
      const auto seed = static_cast<std::uint64_t>(1000 * (1 + db));
      input.sets.push_back(drawn_set(camera, FrameKind::kBias, db, 0, kBiasFrames, seed));
      for (int l = 1; l <= kLevels; ++l)
        input.sets.push_back(drawn_set(camera, FrameKind::kFlat, db, 350.0f * static_cast<float>(l),
                                       2, seed + static_cast<std::uint64_t>(l)));
    }
    found = calibrate_physics(input, {}, silent_progress());
  }
};

const Closure& closure() {
  static const Closure once;
  return once;
}

// A covariance estimated from n frames has the variance (c_ii c_jj + c_ij²)/n, c with the sampling
// variance of one frame's estimate inside.
void expect_covariance(const SquareMatrix& found, const SquareMatrix& truth, double sampling_dn2,
                       const char* name, double gain_db) {
  ASSERT_EQ(found.n, truth.n);
  for (int i = 0; i < truth.n; ++i)
    for (int j = 0; j <= i; ++j) {
      const double ii = truth(i, i) + sampling_dn2, jj = truth(j, j) + sampling_dn2;
      const double ij = truth(i, j) + sampling_dn2;
      const double error = std::sqrt((ii * jj + ij * ij) / kBiasFrames);
      EXPECT_NEAR(found(i, j), truth(i, j), 5 * error)
          << name << ' ' << gain_db << " dB " << i << j;
    }
}

TEST(Closure, CovariancesBetweenChannels) {
  int gains_with_rows = 0;
  for (std::size_t g = 0; g < closure().truth.physics.size(); ++g) {
    const PhysicsCalibration &truth = closure().truth.physics[g],
                             &found = closure().found.physics[g];
    const double db = *truth.gain.gain_db;
    const double row = truth.sigma_row.mean[0] * truth.sigma_row.mean[0];
    const double pixel = truth.temporal_sd_dark_dn.empty()
                             ? read_variance_dn2(closure().truth.physics_at(truth.gain).channels[0])
                             : truth.temporal_sd_dark_dn[0] * truth.temporal_sd_dark_dn[0];
    const double group = row + pixel / kGroupPixels;  // variance of a group's mean
    const double slow = row * drift_of_means(kDrift, static_cast<int>(kGroups), 2, 0);
    expect_covariance(found.mu.covariance, truth.mu.covariance, (group + slow) / kGroups, "mu", db);
    // Where rows are lost in the pixels' noise, their deviation is no normal variable.
    if (row < pixel / kGroupPixels) continue;
    ++gains_with_rows;
    expect_covariance(found.sigma_row.covariance, truth.sigma_row.covariance,
                      group * group / (2 * row * (kGroups - 1)), "sigma_row", db);
  }
  EXPECT_GE(gains_with_rows, 3);
}

// Found wherever the rows are seen at all, within four standard errors.
TEST(Closure, RowDrift) {
  int found_at = 0;
  for (const PhysicsCalibration& found : closure().found.physics) {
    const MeasuredRowDrift& row = found.row_drift;
    if (row.drift.white()) continue;
    ++found_at;
    EXPECT_NEAR(row.drift.share, kDrift.share, 4 * row.share_stderr) << found.gain.text();
    EXPECT_NEAR(row.drift.length_groups, kDrift.length_groups, 4 * row.length_stderr)
        << found.gain.text();
    EXPECT_LT(row.share_stderr, 0.1) << found.gain.text();
  }
  EXPECT_GE(found_at, 3);
}

TEST(Closure, LawsOverGain) {
  ASSERT_TRUE(closure().truth.joint && closure().found.joint);
  ASSERT_EQ(closure().found.joint->segments.size(), 1u);
  const JointSegment &truth = closure().truth.joint->segments[0],
                     &found = closure().found.joint->segments[0];
  const auto near = [](const LogLinear& a, const LogLinear& b, double least, const char* name,
                       std::size_t channel) {
    EXPECT_NEAR(a.slope, b.slope, 5 * std::hypot(a.slope_stderr, least)) << name << ' ' << channel;
  };
  near(found.K_of_gain, truth.K_of_gain, 1e-4, "K", 0);
  for (std::size_t c = 0; c < 16; ++c) {
    near(found.sigma_tl[c], truth.sigma_tl[c], 2e-3, "sigma_tl", c);
    near(found.sigma_row[c], truth.sigma_row[c], 5e-3, "sigma_row", c);
    near(found.minus_mu[c], truth.minus_mu[c], 5e-3, "mu", c);
  }
}

}  // namespace
}  // namespace malus
