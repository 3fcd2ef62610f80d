#include "malus/evaluate/leave_one_gain_out.h"

#include <cmath>

#include "support.h"

namespace malus {
namespace {

PhysicsCalibration law(double gain_db) {
  PhysicsCalibration p;
  const double K = 0.4 * std::pow(10.0, gain_db / 20.0);
  p.gain.gain_db = gain_db;
  p.K.mean = {K};
  p.mu.mean = {0};
  p.lambda.mean = {0.1};
  p.sigma_tl.mean = {1.5 * std::pow(K, 0.8)};
  p.sigma_row.mean = {0.2 * K};
  return p;
}

NoiseModel model_of(const std::vector<double>& gains) {
  NoiseModel model;
  model.black_dn = {0};
  model.white_dn = 4095;
  for (double gain_db : gains) model.physics.push_back(law(gain_db));
  return model;
}

TEST(LeaveOneGainOut, AnExactLawIsPredictedExactly) {
  const auto gains = leave_one_gain_out_physics(model_of({0, 6, 12, 18}));
  ASSERT_EQ(gains.size(), 4U);
  EXPECT_NE(gains[0].why_not, "");
  EXPECT_NE(gains[3].why_not, "");
  for (std::size_t i : {1U, 2U}) {
    EXPECT_EQ(gains[i].why_not, "");
    EXPECT_NEAR(gains[i].K_error, 0, 1e-9);
    EXPECT_NEAR(gains[i].read_error, 0, 1e-9);
    EXPECT_NEAR(gains[i].row_error, 0, 1e-9);
    EXPECT_LT(gains[i].sqrt_jsd, 1e-6);
    EXPECT_GT(gains[i].sqrt_jsd_nearest, 0.1);
  }
  EXPECT_TRUE(leave_one_gain_out_physics(model_of({0, 6})).empty());
}

TEST(LeaveOneGainOut, AnErrorIsReportedWithItsSign) {
  NoiseModel model = model_of({0, 6, 12, 18, 24});
  model.physics[2].K.mean[0] *= 1.1;
  model.physics[2].sigma_row.mean[0] /= 1.2;
  model.physics[2].mu.mean[0] = 0.25;
  const auto gains = leave_one_gain_out_physics(model);
  EXPECT_NEAR(gains[2].mu_error_dn, -0.25, 1e-9);
  EXPECT_NEAR(gains[2].K_error, 1 / 1.1 - 1, 1e-9);
  EXPECT_NEAR(gains[2].row_error, 0.2, 1e-9);
}

// Nearly Gaussian laws whose widths differ by a small share e: JSD = e²/(4 ln 2) bits.
TEST(LeaveOneGainOut, DivergenceOfNearlyEqualGaussians) {
  NoiseModel model = model_of({0, 6, 12, 18, 24});
  for (auto& p : model.physics) p.lambda.mean = {0.1349};
  model.quantization_dn = 0;
  constexpr double kShare = 0.05;
  model.physics[2].sigma_tl.mean[0] /= 1 + kShare;
  const auto gains = leave_one_gain_out_physics(model);
  EXPECT_NEAR(gains[2].read_error, kShare, 1e-9);
  EXPECT_NEAR(gains[2].sqrt_jsd, kShare / std::sqrt(4 * std::log(2.0)), 0.05 * kShare);
}

// Of a millionth of the noise: fifteen million steps a side took minutes, and more did not fit.
TEST(LeaveOneGainOut, StepsFarBelowTheNoiseAreAsNone) {
  NoiseModel model = model_of({0, 6, 12, 18, 24});
  model.physics[2].sigma_tl.mean[0] /= 1.05;
  model.quantization_dn = 0;
  const double without = leave_one_gain_out_physics(model)[2].sqrt_jsd;
  for (const double step_dn : {1e-6, 1e-12, 1e-300}) {
    model.quantization_dn = step_dn;
    EXPECT_NEAR(leave_one_gain_out_physics(model)[2].sqrt_jsd, without, 0.02 * without) << step_dn;
  }
}

// The published A7S2: both conversion gains found; medians of the table in docs/model-file.md.
TEST(LeaveOneGainOut, SonyA7S2) {
  const auto gains = leave_one_gain_out_physics(load_model("sony-a7s2"));
  ASSERT_EQ(gains.size(), 28U);
  int predicted = 0, better = 0;
  for (const LeftOutGain& g : gains) {
    const bool end =
        *g.gain.iso == 50 || *g.gain.iso == 1600 || *g.gain.iso == 2000 || *g.gain.iso == 25600;
    EXPECT_EQ(g.why_not.empty(), !end) << g.gain.text();
    if (end) continue;
    ++predicted;
    better += g.sqrt_jsd < g.sqrt_jsd_nearest;
    if (*g.gain.iso > 200) {
      EXPECT_LT(g.sqrt_jsd, 0.03) << g.gain.text();
    }
  }
  EXPECT_EQ(predicted, 24);
  EXPECT_GE(better, 20);
}

}  // namespace
}  // namespace malus
