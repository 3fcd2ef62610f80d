#include "malus/noise/row_drift.h"

#include "malus/noise/joint_gain.h"

#include <cmath>

#include "sample_model.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(RowDrift, KernelHasTheStatedAutocorrelation) {
  for (const double share : {0.05, 0.33, 0.8, 1.0})
    for (const double length : {kShortestRowDrift, 0.7, 2.0, 11.0, kLongestRowDrift}) {
      const RowDrift drift{share, length};
      ASSERT_EQ(contradiction_in(drift), "");
      const auto k = row_kernel(drift);
      for (std::size_t lag = 0; lag < 40; ++lag) {
        double product = 0;
        for (std::size_t j = 0; j + lag < k.size(); ++j) product += k[j] * k[j + lag];
        // Weights below a thousandth of the second one are cut off.
        EXPECT_NEAR(product, row_autocorrelation(drift, static_cast<int>(lag)), 1e-3 * share)
            << share << ' ' << length << ' ' << lag;
      }
    }
}

TEST(RowDrift, WhiteRowsHaveOneWeightOfOne) {
  EXPECT_EQ(row_kernel({}), std::vector<double>{1.0});
  EXPECT_EQ(row_autocorrelation({}, 0), 1.0);
  EXPECT_EQ(row_autocorrelation({}, 1), 0.0);
}

TEST(RowDrift, ImpossibleOnesAreNamed) {
  EXPECT_EQ(contradiction_in(RowDrift{}), "");
  EXPECT_NE(contradiction_in(RowDrift{-0.1, 2}), "");
  EXPECT_NE(contradiction_in(RowDrift{1.1, 2}), "");
  EXPECT_NE(contradiction_in(RowDrift{NAN, 2}), "");
  EXPECT_NE(contradiction_in(RowDrift{0.5, 0}), "");
  EXPECT_NE(contradiction_in(RowDrift{0.5, NAN}), "");
  EXPECT_NE(contradiction_in(RowDrift{0.5, 300}), "");
  EXPECT_NE(contradiction_in(RowDrift{0, 3}), "");
}

TEST(RowDrift, IsNamedWithItsErrorsWhereTheyAreKnown) {
  EXPECT_EQ(text_of({{0.331, 1.97}, 0.019, 0.14}),
            "33 ± 2 % of the rows' variance, over 2.0 ± 0.1 row groups");
  EXPECT_EQ(text_of({{0.5, 4}, 0, 0}), "50 % of the rows' variance, over 4.0 row groups");
}

TEST(RowDrift, BetweenGainsItIsInterpolated) {
  NoiseModel model = testing::full_model();  // shares 0.2, 0.26, 0.32 at 0, 6, 12 dB, length 3
  GainSetting gain;
  gain.gain_db = 3.0;
  const RowDrift between = model.physics_at(gain).row_drift;
  EXPECT_NEAR(between.share, 0.23, 1e-12);
  EXPECT_NEAR(between.length_groups, 3.0, 1e-12);
  gain.gain_db = 6.0;
  EXPECT_EQ(model.physics_at(gain).row_drift, model.physics[1].row_drift.drift);
  EXPECT_EQ(model.sample_physics_at(gain, 1, 2).row_drift, model.physics[1].row_drift.drift);

  model.physics[0].row_drift = {};  // white at one end: its neighbour's length
  model.joint = fit_joint_model(model.physics).value();
  gain.gain_db = 3.0;
  EXPECT_NEAR(model.physics_at(gain).row_drift.share, 0.13, 1e-12);
  EXPECT_NEAR(model.physics_at(gain).row_drift.length_groups, 3.0, 1e-12);

  for (PhysicsCalibration& p : model.physics) p.row_drift = {};
  model.joint = fit_joint_model(model.physics).value();
  EXPECT_TRUE(model.physics_at(gain).row_drift.white());
  EXPECT_TRUE(model.joint->segments[0].row_drift.empty());
}

}  // namespace
}  // namespace malus
