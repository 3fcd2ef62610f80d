// What a denoiser is told of a model. Truth: closed forms of the sample model's numbers.
#include "malus/noise/model.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>
#include <limits>

#include "../problem_of.h"
#include "sample_model.h"

namespace malus {
namespace {

using testing::db;
using testing::problem_of;

TEST(Profile, OfPhysicsAddsEveryPart) {
  PhysicsNoise noise = testing::full_model().physics_at(db(6));
  const PhysicsChannel& c = noise.channels[1];
  const NoiseProfile all = profile_of(noise);
  const double read = c.sigma_tl_dn * c.sigma_tl_dn * tukey_lambda_variance(c.lambda);
  EXPECT_NEAR(all.channels[1].variance(0.0), read + 4.0 / 12.0, 1e-12);
  EXPECT_NEAR(all.channels[1].variance(100.0), 100 * c.gain_dn_per_e + read + 4.0 / 12.0, 1e-10);
  EXPECT_NEAR(all.channels[1].variance(-50.0), read + 4.0 / 12.0, 1e-12);
  EXPECT_EQ(all.channels[1].bias_dn, c.mu_dn);
  EXPECT_EQ(all.channels[1].sigma_row_dn, c.sigma_row_dn);
  EXPECT_EQ(all.row_group, 2);
  noise.parts = {.shot = false, .read = false, .row = false, .quantization = true, .bias = false};
  const NoiseProfile bare = profile_of(noise);
  EXPECT_NEAR(bare.channels[1].variance(100.0), 4.0 / 12.0, 1e-12);
  EXPECT_EQ(bare.channels[1].bias_dn, 0.0);
  EXPECT_EQ(bare.channels[1].sigma_row_dn, 0.0);
}

// Of 1 % of dark pixels that differ by a step from the others, normal noise about a code has at
// most 1 / (2 * 2.5758) = 0.1941 steps; half of its square is sure.
TEST(Profile, TellsWhatOfHiddenDarkNoiseIsAGuess) {
  NoiseModel model = testing::full_model();
  PhysicsCalibration& p = model.physics[0];
  EXPECT_EQ(model.profile_at(db(0)).channels[0].guessed_dn2, 0);
  const double row_dn = p.sigma_row.mean[0], step_dn = model.quantization_dn;
  p.sigma_tl.standard_error[0] = std::numeric_limits<double>::infinity();
  p.temporal_sd_dark_dn[0] = 0.1 * step_dn;
  p.dark_point_dn2[0] = row_dn * row_dn + step_dn * step_dn / 12 + 0.33;
  const double sure_dn2 = 0.5 * std::pow(0.1941 * step_dn, 2);
  for (const ColumnNoise columns : {ColumnNoise::kInPixels, ColumnNoise::kApart}) {
    const NoiseProfile profile = model.profile_at(db(0), GainRange::kCalibratedOnly, columns);
    EXPECT_NEAR(profile.channels[0].guessed_dn2, 0.33 - sure_dn2, 1e-4);
    EXPECT_EQ(profile.channels[1].guessed_dn2, 0);
  }
  EXPECT_NEAR(model.profile_at(db(0)).channels[0].variance(0), 0.33 + step_dn * step_dn / 12, 1e-9);
  // Less noise than is sure: nothing is a guess.
  p.dark_point_dn2[0] -= 0.3;
  EXPECT_EQ(model.profile_at(db(0)).channels[0].guessed_dn2, 0);
}

TEST(Profile, OfTheOtherKinds) {
  NoiseModel model = testing::full_model();
  model.physics.clear();
  model.joint.reset();
  const NoiseProfile gaussian = model.profile_at(db(6));
  EXPECT_DOUBLE_EQ(gaussian.channels[1].variance(10.0), 0.9 * 10 + 3.0);
  EXPECT_EQ(gaussian.channels[1].bias_dn, -0.5);
  EXPECT_NE(problem_of([&] { (void)model.profile_at(db(7)); }), "");
  model.gaussian.clear();
  // Bins [-2,0] [0,1] [1,3] with 1/4 1/2 1/4: mean 1/2, second moment 1/4 4/3 + 1/2 1/3 + 1/4 13/3.
  const NoiseProfile measured = model.profile_at(db(6));
  // That of the dark level lacks the rounding to whole numbers.
  const double at_0 = (4 + 2 + 13) / 12.0 - 0.25 + std::pow(model.quantization_dn, 2) / 12;
  EXPECT_NEAR(measured.channels[0].variance(0.0), at_0, 1e-12);
  // 1/2 1/4 1/4: mean 1/8, second moment 1/2 4/3 + 1/4 1/3 + 1/4 13/3; half-way in between linear.
  const double at_100 = (8 + 1 + 13) / 12.0 - 1.0 / 64;
  EXPECT_NEAR(measured.channels[0].variance(100.0), at_100, 1e-12);
  EXPECT_NEAR(measured.channels[0].variance(50.0), 0.5 * (at_100 + at_0), 1e-12);
  EXPECT_EQ(measured.channels[1].sigma_row_dn, 0.4);
}

}  // namespace
}  // namespace malus
