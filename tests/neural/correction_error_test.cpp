// Truth: corrections and variances of known size.
#include "malus/neural/correction_error.h"

#include "malus/base/error.h"
#include "malus/neural/inference.h"
#include "malus/neural/package.h"

#include <cmath>
#include <limits>

#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(CorrectionError, ACorrectionWithinTheStatedErrorChangesNothing) {
  const Image guide(40, 48, 100.0f);
  Image result(40, 48), variance(40, 48, 4.0f);
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 48; ++c) result(r, c) = 100.0f + ((r + c) % 2 == 0 ? 1.9f : -1.9f);
  add_correction_error(guide.view(), result.view(), variance.view());
  for (const float v : variance.values()) EXPECT_EQ(v, 4.0f);
}

TEST(CorrectionError, ALargerOneIsStatedAsItIs) {
  const Image guide(41, 47, 100.0f);
  Image result(41, 47, 100.0f), variance(41, 47, 4.0f);
  for (int r = 0; r < 41; ++r)
    for (int c = 24; c < 47; ++c) result(r, c) = 110.0f;
  add_correction_error(guide.view(), result.view(), variance.view());
  for (int r = 0; r < 41; ++r) {
    for (int c = 28; c < 47; ++c) EXPECT_NEAR(variance(r, c), 100.0f, 1e-4f) << r << ' ' << c;
    for (int c = 0; c < 20; ++c) EXPECT_EQ(variance(r, c), 4.0f) << r << ' ' << c;
    // Between them as the cells around tell.
    EXPECT_NEAR(variance(r, 24), 4 * (100.0 * 3 / 4) / 4, 1e-4) << r;
    EXPECT_NEAR(variance(r, 23), 4 * (100.0 * 1 / 4) / 4, 1e-4) << r;
  }
}

TEST(CorrectionError, WhereNothingIsKnownNothingIsStated) {
  const Image guide(16, 16, 1.0f);
  Image result(16, 16, 1.0f), variance(16, 16, 1.0f);
  variance(5, 5) = std::numeric_limits<float>::quiet_NaN();
  result(5, 5) = 1e6f;
  add_correction_error(guide.view(), result.view(), variance.view());
  for (int r = 0; r < 16; ++r)
    for (int c = 0; c < 16; ++c)
      EXPECT_TRUE(r == 5 && c == 5 ? std::isnan(variance(r, c)) : variance(r, c) == 1.0f);
}

TEST(CorrectionError, OfNothingStatedBecomesTheCorrection) {
  const Image guide(8, 8, 1.0f), result(8, 8, 3.0f);
  Image variance(8, 8, 1e-6f);
  add_correction_error(guide.view(), result.view(), variance.view());
  for (const float v : variance.values()) EXPECT_NEAR(v, 4.0f, 1e-4f);
}

}  // namespace
}  // namespace malus
