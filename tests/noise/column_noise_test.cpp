// Column noise of a calibration: when it counts, and what of the read noise it is.
#include "malus/noise/column_noise.h"

#include "malus/noise/tukey_lambda.h"

#include <cmath>
#include <limits>

#include "sample_model.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::db;

double read_deviation_dn(const PhysicsCalibration& p, std::size_t channel) {
  return p.sigma_tl.mean[channel] * std::sqrt(tukey_lambda_variance(p.lambda.mean[channel]));
}

PhysicsCalibration with_columns(PhysicsCalibration p, double of_read_noise, double relative_error) {
  for (std::size_t c = 0; c < 2; ++c) {
    p.sigma_column.mean[c] = of_read_noise * read_deviation_dn(p, c);
    p.sigma_column.standard_error[c] = relative_error * p.sigma_column.mean[c];
  }
  return p;
}

TEST(ColumnNoiseShares, AreSquaredDeviationsOverTheReadNoises) {
  for (const double share : column_noise_shares(with_columns(testing::physics2(0), 0.6, 0.01)))
    EXPECT_NEAR(share, 0.36, 1e-12);
  // More than there is cannot be: both are measured.
  for (const double share : column_noise_shares(with_columns(testing::physics2(0), 1.2, 0.01)))
    EXPECT_EQ(share, 0.95);
}

TEST(ColumnNoiseShares, AreZeroWhereTheColumnsAreNotSignificant) {
  const std::vector<double> none(2, 0.0);
  const PhysicsCalibration p = testing::physics2(0);
  EXPECT_EQ(column_noise_shares(with_columns(p, 0.6, 0.21)), none);
  EXPECT_NE(column_noise_shares(with_columns(p, 0.6, 0.19)), none);
  EXPECT_EQ(column_noise_shares(with_columns(p, 0.029, 0.01)), none);
  EXPECT_NE(column_noise_shares(with_columns(p, 0.031, 0.01)), none);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(column_noise_shares(with_columns(p, 0.6, nan)), none);
  PhysicsCalibration published = p;
  published.sigma_column = {};
  EXPECT_EQ(column_noise_shares(published), none);
}

// Gains of 0, 6 and 12 dB with 0.1, 0.5 and no share.
TEST(ColumnNoiseShares, AreInterpolatedOverGain) {
  NoiseModel model = testing::full_model();
  ASSERT_EQ(model.physics.size(), 3U);
  const double of_read_noise[] = {std::sqrt(0.1), std::sqrt(0.5), 0.0};
  for (std::size_t g = 0; g < 3; ++g)
    model.physics[g] = with_columns(model.physics[g], of_read_noise[g], 0.01);
  const auto at = [&](double gain_db) { return column_noise_shares_at(model, db(gain_db))[1]; };
  EXPECT_NEAR(at(0), 0.1, 1e-12);
  EXPECT_NEAR(at(3), 0.3, 1e-12);
  EXPECT_NEAR(at(6), 0.5, 1e-12);
  EXPECT_NEAR(at(10.5), 0.125, 1e-12);
  EXPECT_EQ(at(12), 0);
  EXPECT_NEAR(at(-3), 0.1, 1e-12);
  EXPECT_EQ(at(15), 0);
}

// The two parts of the read noise's variance add up to it; all else stays.
TEST(ColumnNoiseProfile, IsApartWhereItIsAskedFor) {
  NoiseModel model = testing::full_model();
  for (PhysicsCalibration& p : model.physics) p = with_columns(p, 0.6, 0.01);
  for (const double gain_db : {6.0, 9.0}) {
    const NoiseProfile whole = model.profile_at(db(gain_db)),
                       apart = model.profile_at(db(gain_db), GainRange::kCalibratedOnly,
                                                ColumnNoise::kApart);
    EXPECT_FALSE(whole.has_column_noise());
    ASSERT_TRUE(apart.has_column_noise());
    for (std::size_t c = 0; c < 2; ++c) {
      const double column = apart.channels[c].sigma_column_dn,
                   read = whole.channels[c].variance(0) - whole.step_dn * whole.step_dn / 12;
      EXPECT_NEAR(column * column, 0.36 * read, 1e-9);
      EXPECT_NEAR(apart.channels[c].variance(0) + column * column, whole.channels[c].variance(0),
                  1e-9);
      EXPECT_NEAR(apart.channels[c].variance(100) + column * column,
                  whole.channels[c].variance(100), 1e-9);
      EXPECT_EQ(apart.channels[c].bias_dn, whole.channels[c].bias_dn);
      EXPECT_EQ(apart.channels[c].sigma_row_dn, whole.channels[c].sigma_row_dn);
    }
  }
}

TEST(ColumnNoiseProfile, OfAModelWithoutIsTheSameEitherWay) {
  const NoiseModel model = load_model("imx250myr-simulated");
  const NoiseProfile whole = model.profile_at(db(12)),
                     apart =
                         model.profile_at(db(12), GainRange::kCalibratedOnly, ColumnNoise::kApart);
  EXPECT_FALSE(apart.has_column_noise());
  for (std::size_t c = 0; c < 16; ++c)
    for (const double dn : {0.0, 10.0, 1000.0})
      EXPECT_EQ(apart.channels[c].variance(dn), whole.channels[c].variance(dn));
}

}  // namespace
}  // namespace malus
