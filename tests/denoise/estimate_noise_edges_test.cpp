// Frames at the edge of what tells a noise. Truth: what they are drawn from, fixed seeds.
#include "malus/base/random.h"
#include "malus/denoise/estimate_noise.h"

#include <cmath>
#include <string>
#include <vector>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// A lamp before a background without a single count, in floats: its levels have neither light nor
// noise.
TEST(EstimateProfile, ABackgroundWithoutLightIsNoBoundOfTheNoise) {
  const PhysicsNoise shot = equal_channels("mono", {0.5, 1.0, 0.0, 0.0, 0.0});
  RawFrame frame = drawn_frame(Image(256, 256, 200.0F), shot, {}, 4);
  frame.black_known = true;
  for (int r = 0; r < 256; ++r)
    for (int c = 0; c < 256; ++c)
      if (std::hypot(r - 128, c - 128) >= 30) frame.dn(r, c) = 0;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  EXPECT_NEAR(std::sqrt(noise->profile.channels[0].variance(200)), 10, 2);
}

// A patch of 6x6 pixels of one phase does not hold all channels of a cell of 8x8.
TEST(EstimateProfile, CellsLargerThanAPatchHaveTheirNoiseToo) {
  std::vector<std::vector<std::string>> sites;
  for (int r = 0; r < 8; ++r) {
    sites.emplace_back(4, r < 4 ? "R" : "G2");
    sites.back().insert(sites.back().end(), 4, r < 4 ? "G1" : "B");
  }
  PhysicsNoise camera;
  camera.layout = SensorLayout::from_sites(sites);
  camera.quantization_dn = 0;
  camera.channels.assign(64, PhysicsChannel{0.5, 1.0, 0.0, 3 * std::sqrt(3.0), 0.0});
  Image texture(640, 640);
  RandomSequence random(3, 0, Draw::kOther);
  for (int r = 0; r < 640; ++r)
    for (int c = 0; c < 640; ++c)
      texture(r, c) = static_cast<float>((100 + 0.8 * c) * (1 + 0.1 * random.normal()));
  const Estimate<PictureNoise> noise = estimate_profile(drawn_frame(texture, camera, {}, 4));
  ASSERT_TRUE(noise);
  for (const ChannelProfile& channel : noise->profile.channels)
    EXPECT_TRUE(std::isfinite(channel.variance(300)));
}

}  // namespace
}  // namespace malus
