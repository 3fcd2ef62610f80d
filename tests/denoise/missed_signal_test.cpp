// Truth: the definition in plain loops, and what the normal distribution says of noise alone; fixed
// seeds. Of whole frames: stated_error_test.cpp.
#include "malus/denoise/internal/missed_signal.h"

#include "malus/base/random.h"

#include <algorithm>
#include <cstdint>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

Image unit_noise(int rows, int cols, std::uint64_t seed) {
  RandomSequence random(seed, 0, Draw::kOther);
  Image noise(rows, cols);
  for (float& v : noise.values()) v = static_cast<float>(random.normal());
  return noise;
}

Image stated_after(const Image& samples, const Image& estimate, float uncut = 1e5f) {
  Image error(estimate.rows(), estimate.cols(), 0.25f);
  const SensorLayout layout = SensorLayout::named("polar-mono");
  internal::add_missed_signal(source_of(samples, layout), std::vector<float>(4, uncut), estimate,
                              error);
  return error;
}

double mean(const Image& image) {
  double sum = 0;
  for (const float v : image.values()) sum += double{v};
  return sum / static_cast<double>(image.size());
}

TEST(MissedSignal, IsWhatItsDefinitionSays) {
  constexpr int kRows = 41, kCols = 37;
  Image samples = unit_noise(kRows, kCols, 1);
  for (int i = 0; i < kCols; ++i) samples(i, i) += 5;
  const Image estimate(kRows, kCols, 0.5f), error = stated_after(samples, estimate);
  constexpr double kTaps[] = {1, 4, 6, 4, 1};
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      double sum = 0;
      for (int a = -2; a <= 2; ++a)
        for (int b = -2; b <= 2; ++b) {
          if (r + a < 0 || r + a >= kRows || c + b < 0 || c + b >= kCols) continue;
          sum += kTaps[a + 2] * kTaps[b + 2] / 256 *
                 (double{samples(r + a, c + b)} - double{estimate(r + a, c + b)});
        }
      const double noise = 4900.0 / 65536;
      EXPECT_NEAR(double{error(r, c)}, 0.25 + 3 * std::max(sum * sum - 12 * noise, 0.0), 1e-5);
    }
}

// Of a normal z the mean of max(z² - 12, 0) is 0.0010. About a hundred places come to that here, so
// five standard errors are half of it.
TEST(MissedSignal, OfNoiseAloneIsNextToNothing) {
  const Image none(1500, 1500), error = stated_after(unit_noise(1500, 1500, 2), none);
  const double expected = 3 * 0.0010 * 4900 / 65536;
  EXPECT_NEAR(mean(error) - 0.25, expected, 0.5 * expected);
}

TEST(MissedSignal, BesideWhiteNothingIsConcluded) {
  const Image estimate(40, 40, 9.0f), samples(40, 40, 6.0f);
  EXPECT_EQ(mean(stated_after(samples, estimate, 8.9f)), 0.25);
  EXPECT_GT(mean(stated_after(samples, estimate, 9.1f)), 5.0);
}

}  // namespace
}  // namespace malus
