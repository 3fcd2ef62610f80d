#include "malus/calibrate/gaussian_calibration.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Noise that falls with the light is chance: the line is level then, at the weighted mean.
TEST(GaussianCalibration, LinesNeverFall) {
  MeasuredLevels measured;
  measured.distributions.gain.gain_db = 0;
  measured.row_variance_dn2 = {0.5, 0.5};
  measured.row_variance_stderr_dn2 = {0.1, 0.1};
  measured.bias_dn = {0, 0};
  measured.noise = {{{0, 4.2, 4000}, {10, 4.0, 2000}, {20, 3.9, 2000}},
                    {{0, 4.0, 4000}, {10, 4.5, 2000}, {20, 5.0, 2000}}};
  const auto line = gaussian_of(measured, 100);
  ASSERT_TRUE(line);
  EXPECT_EQ(line->slope_dn[0], 0);
  // Equal variances on the line: the levels weigh by their freedom alone.
  EXPECT_NEAR(line->offset_dn2[0], (2 * 4.2 + 4.0 + 3.9) / 4 + 0.5, 1e-9);
  // Weights 0.5 f / 4.075², 240.9 in all; χ² about the mean 4.065 of one degree of freedom.
  EXPECT_NEAR(line->offset_stderr_dn2[0], std::hypot(std::sqrt(4.065 / 240.9), 0.1), 1e-4);
  EXPECT_NEAR(line->slope_dn[1], 0.05, 1e-9);
  EXPECT_NEAR(line->offset_dn2[1], 4.5, 1e-9);
}

}  // namespace
}  // namespace malus
