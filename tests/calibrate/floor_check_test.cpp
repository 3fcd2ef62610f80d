// Whether the lowest dark code is where the noise is cut off, or where it ends by itself.
#include "malus/calibrate/internal/floor_check.h"

#include "malus/calibrate/calibrate.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>
#include <vector>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kDarkPixels = 327680;

// Counts of the codes of Tukey-lambda noise from `lowest` on, which holds what lies below it, too.
std::vector<double> counts_of(double lambda, double sd, double mean, int lowest) {
  const double scale = sd / std::sqrt(tukey_lambda_variance(lambda));
  const auto cdf = [&](double x) { return tukey_lambda_cdf((x - mean) / scale, lambda); };
  std::vector<double> counts;
  for (int k = lowest; k == lowest || cdf(k - 0.5) < 1 - 0.5 / kDarkPixels; ++k)
    counts.push_back(std::round(kDarkPixels * (cdf(k + 0.5) - (k == lowest ? 0.0 : cdf(k - 0.5)))));
  return counts;
}

// The lowest code that occurs; of few of the pixels nobody asks.
std::vector<double> uncut_counts(double lambda, double sd, double mean) {
  int lowest = -40;
  while (counts_of(lambda, sd, mean, lowest)[0] < 1) ++lowest;
  return counts_of(lambda, sd, mean, lowest);
}

TEST(FloorCheck, NoiseIsCutOffWhereItsUpperHalfReachesFarther) {
  int asked = 0;
  for (const double mean : {0.0, 0.2, 0.3, 0.45, 0.7}) {
    for (const double lambda : {0.0, 0.14, 0.5, 1.0})
      for (const double sd : {0.35, 0.42, 0.5, 0.7, 1.0, 3.0}) {
        const std::vector<double> counts = uncut_counts(lambda, sd, mean);
        if (counts.size() < 4 || counts[0] < kMostSilentZeros * kDarkPixels) continue;  // is_pile
        ++asked;
        EXPECT_FALSE(reach_beyond_mirror(counts)) << lambda << " " << sd << " " << mean;
      }
    for (const double lambda : {-0.2, 0.0, 0.14})
      for (const double sd : {1.2, 3.0, 8.0})
        for (const double z : {0.0, 0.5, 1.0, 2.0, 2.5})
          EXPECT_TRUE(reach_beyond_mirror(
              counts_of(lambda, sd, mean, static_cast<int>(std::lround(mean - z * sd)))))
              << lambda << " " << sd << " " << z;
  }
  EXPECT_GT(asked, 20);
}

// Of noise of half a code with light tails 6 % lie at the lowest code, which a parabola through the
// next three leaves empty: "the camera's black level cuts the noise off", the shape not known,
// sigma_TL 38 % too small.
TEST(FloorCheck, NarrowNoiseWithLightTailsIsNotCutOff) {
  testing::SimulatedCamera camera = testing::mono_camera(0.02, 0.5, 0.5, 0.05, 3);
  camera.rows = camera.cols = 128;
  camera.black_dn = 10;
  camera.white_dn = 255;
  camera.flat_levels = 0;
  camera.dsnu_dn = 0.1;
  camera.gains[0].noise.channels[0].mu_dn = 0.3;
  const PhysicsCalibration p = testing::calibrated(camera).physics.at(0);
  EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("the lowest code"))));
  EXPECT_THAT(p.warnings, Not(Contains(HasSubstr("shape of the read noise is not known"))));
  const double truth = camera.gains[0].noise.channels[0].sigma_tl_dn;
  EXPECT_NEAR(p.sigma_tl.mean[0], truth, 0.05 * truth);
}

}  // namespace
}  // namespace malus
