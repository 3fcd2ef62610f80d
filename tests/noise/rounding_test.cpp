// Truth: rounded Gaussian samples' means from the normal distribution's own integrals.
#include "malus/noise/rounding.h"

#include "malus/base/random.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace malus {
namespace {

double mean_of_rounded(double signal, double sigma, double step) {
  double mean = 0;
  const auto below = [&](double edge) {
    return 0.5 * std::erfc((signal - edge) / (sigma * std::numbers::sqrt2));
  };
  for (int n = -12; n <= 12; ++n)
    mean += n * step * (below((n + 0.5) * step) - below((n - 0.5) * step));
  return mean;
}

TEST(Rounding, LeavesTheOffsetOfTheMeanOfRoundedSamples) {
  for (const double step : {1.0, 4.0})
    for (const double sigma : {0.02, 0.1, 0.2, 0.3, 0.45}) {
      constexpr int kPlaces = 2000;
      double square = 0;
      for (int i = 0; i < kPlaces; ++i) {
        const double signal = step * (i + 0.5) / kPlaces;
        square += std::pow(mean_of_rounded(signal, sigma * step, step) - signal, 2) / kPlaces;
      }
      const double stated = undithered_variance(step, sigma * sigma * step * step);
      EXPECT_NEAR(stated, square, 1e-3 * square + 1e-6 * step * step) << step << " " << sigma;
    }
}

TEST(Rounding, HasItsLimits) {
  EXPECT_EQ(undithered_variance(0, 1), 0);
  EXPECT_DOUBLE_EQ(undithered_variance(2, 0), 4.0 / 12);
  EXPECT_NEAR(undithered_variance(1, 1.01e-4) * 12, 1, 0.08);  // the sum meets the closed form
  EXPECT_LT(undithered_variance(1, 0.25), 1e-5);
}

// On a code noise of s steps changes the code of 2 Q(1/2s) of the samples, each by one step; where
// rounding hides nothing it adds its step²/12.
TEST(Rounding, TellsTheMostThatCodesAllow) {
  for (const double sd : {0.1, 0.15, 0.2}) {
    const double shown = std::erfc(0.5 / (std::sqrt(2.0) * sd));
    EXPECT_NEAR(std::sqrt(most_rounded_noise(1, shown)), sd, 1e-4);
    EXPECT_NEAR(std::sqrt(most_rounded_noise(4, 16 * shown)), 4 * sd, 4e-4);
  }
  EXPECT_NEAR(most_rounded_noise(1, 9 + 1.0 / 12), 9, 1e-5);
  // What no pixel of a sensor shows may still be noise, of as little as it takes.
  EXPECT_NEAR(most_rounded_noise(1, 1e-7), 0.00881, 2e-5);
}

// Steps so fine that rounding adds its step²/12 everywhere; a step that hides the noise: next to
// none on a code, a quarter between two; and in between against drawn samples (five of their
// errors).
TEST(Rounding, GivesSamplesTheirVariance) {
  for (const double offset : {0.0, 0.3, -1.5})
    EXPECT_NEAR(rounded_variance(1, offset, 4), 4 + 1.0 / 12, 1e-9);
  EXPECT_LT(rounded_variance(2, 4.0, 0.01), 1e-9);
  EXPECT_NEAR(rounded_variance(2, 5.0, 0.01), 1, 1e-9);
  for (const double offset : {0.1, 0.4, 7.6}) {
    constexpr int kSamples = 40'000;
    RandomSequence random(5, 0, Draw::kOther);
    double sum = 0, squares = 0;
    for (int i = 0; i < kSamples; ++i) {
      const double code = std::round(offset + 0.25 * random.normal());
      sum += code / kSamples;
      squares += code * code / kSamples;
    }
    EXPECT_NEAR(rounded_variance(1, offset, 0.0625), squares - sum * sum, 0.012) << offset;
  }
}

}  // namespace
}  // namespace malus
