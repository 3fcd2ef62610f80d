#include "malus/base/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Known-answer vectors of Random123 (kat_vectors, philox4x32 10).
TEST(Philox, MatchesPublishedVectors) {
  const auto zero = philox4x32(PhiloxBlock{{0, 0, 0, 0}}, 0);
  EXPECT_EQ(zero.word[0], 0x6627e8d5u);
  EXPECT_EQ(zero.word[1], 0xe169c58du);
  EXPECT_EQ(zero.word[2], 0xbc57ac4cu);
  EXPECT_EQ(zero.word[3], 0x9b00dbd8u);
  const auto ones = philox4x32(PhiloxBlock{{~0u, ~0u, ~0u, ~0u}}, ~std::uint64_t{0});
  EXPECT_EQ(ones.word[0], 0x408f276du);
  EXPECT_EQ(ones.word[1], 0x41c83b0eu);
  EXPECT_EQ(ones.word[2], 0xa20bc7c6u);
  EXPECT_EQ(ones.word[3], 0x6d5451fdu);
  const auto pi = philox4x32(PhiloxBlock{{0x243f6a88, 0x85a308d3, 0x13198a2e, 0x03707344}},
                             std::uint64_t{0x299f31d0} << 32 | 0xa4093822);
  EXPECT_EQ(pi.word[0], 0xd16cfe09u);
  EXPECT_EQ(pi.word[1], 0x94fdccebu);
  EXPECT_EQ(pi.word[2], 0x5001e420u);
  EXPECT_EQ(pi.word[3], 0x24126ea1u);
}

TEST(NormalQuantile, InvertsTheErrorFunctionFarIntoBothTails) {
  for (double z : {-8.0, -5.0, -1.5, -0.3, 0.0, 0.7, 2.0, 5.0}) {
    const double u = 0.5 * std::erfc(-z / std::sqrt(2.0));
    EXPECT_NEAR(normal_quantile(u), z, 2e-9 * (1 + std::abs(z))) << z;
  }
}

TEST(UniformOpen, NeverReachesZeroOrOne) {
  EXPECT_GT(uniform_open(0u), 0.0);
  EXPECT_LT(uniform_open(~0u), 1.0);
  EXPECT_GT(uniform_open(0u, 0u), 0.0);
  EXPECT_LT(uniform_open(~0u, ~0u), 1.0);
}

TEST(RandomSequence, SeedZeroDiffersFromOneAndRepeats) {
  RandomSequence a(0, 0, Draw::kOther), b(0, 0, Draw::kOther), c(1, 0, Draw::kOther);
  const auto first = a();
  EXPECT_EQ(first, b());
  EXPECT_NE(first, c());
}

}  // namespace
}  // namespace malus
