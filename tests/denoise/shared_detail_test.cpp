#include "malus/denoise/shared_detail.h"

#include "malus/base/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

const std::vector<float> kSaturated(4, 4000.0f);

// Four channels of unit noise and, in all of them, a checker of the given amplitude.
Planes planes_with(double texture, int size = 128) {
  Planes planes(4, size, size);
  RandomSequence random(5, 0, Draw::kUser);
  for (int k = 0; k < 4; ++k)
    for (int r = 0; r < size; ++r)
      for (int c = 0; c < size; ++c)
        planes[k](r, c) = static_cast<float>(100 + random.normal() +
                                             texture * ((r + c) % 2 ? 1 : -1) * std::sin(0.3 * r));
  return planes;
}

TEST(SharedDetail, NoiseOfFourChannelsHasNothingInCommon) {
  EXPECT_LT(shared_detail(planes_with(0), kSaturated), 0.005);
}

// Power p in common beside noise of power 1: three channels predict p / (p + 1/3) of the fourth's
// p, so R² = p² / ((p + 1)(p + 1/3)). The texture's details are 2t sin(0.3 r), p = 2 t² on average.
TEST(SharedDetail, TextureThatAllChannelsSeeIsShared) {
  EXPECT_GT(shared_detail(planes_with(1.5), kSaturated), 0.5);
  EXPECT_GT(shared_detail(planes_with(10), kSaturated), 0.95);
}

TEST(SharedDetail, KnowsNoUnit) {
  Planes planes = planes_with(1.5);
  const double shared = shared_detail(planes, kSaturated);
  for (Image& plane : planes)
    for (float& v : plane.values()) v /= 4096;
  EXPECT_DOUBLE_EQ(shared_detail(planes, std::vector<float>(4, 4000.0f / 4096)), shared);
}

TEST(SharedDetail, NothingIsSaidWhereNothingCanBeKnown) {
  EXPECT_EQ(shared_detail(Planes(1, 128, 128), {4000.0f}), 0.0);
  EXPECT_EQ(shared_detail(planes_with(10, 32), kSaturated), 0.0);                // 16 blocks
  EXPECT_EQ(shared_detail(planes_with(10), std::vector<float>(4, 50.0f)), 0.0);  // all saturated
  EXPECT_EQ(shared_detail(Planes(4, 128, 128), kSaturated), 0.0);                // no noise at all
}

}  // namespace
}  // namespace malus
