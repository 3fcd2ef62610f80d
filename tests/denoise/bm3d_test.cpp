#include "malus/denoise/bm3d.h"

#include "malus/base/random.h"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

Planes with_noise(Planes planes, float sigma, std::uint64_t seed) {
  for (int c = 0; c < planes.channels(); ++c) {
    RandomSequence random(seed, static_cast<std::uint32_t>(c), Draw::kUser);
    for (float& value : planes[c].values()) value += sigma * static_cast<float>(random.normal());
  }
  return planes;
}

TEST(Bm3d, RemovesMostOfTheNoiseOfAFlatPicture) {
  const Planes clean(1, 24, 20);
  const std::array sigma = {2.0F};
  const Planes result = bm3d(with_noise(clean, sigma[0], 1), sigma, {.profile = "fast"});
  double squares = 0;
  for (const float value : result[0].values()) squares += double(value) * value;
  EXPECT_LT(squares / static_cast<double>(result[0].size()), 4.0 / 10);
}

}  // namespace
}  // namespace malus
