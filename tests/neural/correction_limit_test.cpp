// Truth: corrections and variances of known size.
#include "malus/neural/internal/correction_limit.h"

#include "malus/image/view.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(CorrectionLimit, ACorrectionWithinTheStatedErrorStays) {
  const Image guide(40, 48, 100.0f), variance(40, 48, 4.0f);
  Image result(40, 48);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 48; ++c) result(r, c) = 100.0f + ((r + c) % 2 == 0 ? 1.05f : -1.05f);
  const Image before = result;
  limit_correction(guide.view(), variance.view(), result.view());
  EXPECT_EQ(result.values(), before.values());
}

TEST(CorrectionLimit, ALargerOneIsScaledDownToIt) {
  const Image guide(41, 47, 100.0f), variance(41, 47, 4.0f);
  Image result(41, 47, 100.0f);
  for (int r = 0; r < 41; ++r)
    for (int c = 24; c < 47; ++c) result(r, c) = r % 2 == 0 ? 110.0f : 90.0f;
  limit_correction(guide.view(), variance.view(), result.view());
  for (int r = 0; r < 41; ++r) {
    const float sign = r % 2 == 0 ? 1.0f : -1.0f;
    for (int c = 28; c < 47; ++c)
      EXPECT_NEAR(result(r, c), 100 + sign * std::sqrt(0.3f * 4), 1e-4f) << r << ' ' << c;
    for (int c = 0; c < 24; ++c) EXPECT_EQ(result(r, c), 100.0f) << r << ' ' << c;
    // The cells around tell three quarters of it: a squared correction of 75 for a variance of 4.
    EXPECT_NEAR(result(r, 24), 100 + sign * 10 * std::sqrt(0.3 * 4 / 75), 1e-4) << r;
  }
}

TEST(CorrectionLimit, WhereNothingIsKnownItStays) {
  const Image guide(16, 16, 1.0f);
  Image result(16, 16, 1.0f), variance(16, 16, 1.0f);
  variance(5, 5) = std::numeric_limits<float>::quiet_NaN();
  result(5, 5) = 1e6f;
  const Image before = result;
  limit_correction(guide.view(), variance.view(), result.view());
  EXPECT_EQ(result.values(), before.values());
}

TEST(CorrectionLimit, OfNothingStatedNothingIsLeft) {
  const Image guide(8, 8, 1.0f), variance(8, 8, 0.0f);
  Image result(8, 8, 3.0f);
  limit_correction(guide.view(), variance.view(), result.view());
  for (const float dn : result.values()) EXPECT_EQ(dn, 1.0f);
}

}  // namespace
}  // namespace malus
