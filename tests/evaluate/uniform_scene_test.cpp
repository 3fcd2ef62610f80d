// Scenes of known light under noise of fixed seeds.
#include "malus/base/random.h"
#include "malus/evaluate/noise_comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kSide = 64, kFrames = 4;
constexpr double kSd = 2, kBias = 5;

// light_dn: of mono's one channel, or of polar-mono's four.
NoiseFrames flat_frames(const std::vector<double>& light_dn, const SensorLayout& layout,
                        std::uint64_t seed, int count = kFrames) {
  return {count, [=](int k) {
            RandomSequence random(seed, static_cast<std::uint32_t>(k), Draw::kOther);
            Image frame(kSide, kSide);
            for (int r = 0; r < kSide; ++r)
              for (int c = 0; c < kSide; ++c)
                frame(r, c) = static_cast<float>(
                    kBias + light_dn[static_cast<std::size_t>(layout.channel_at(r, c))] +
                    kSd * random.normal());
            frame(0, 0) = std::numeric_limits<float>::quiet_NaN();
            return frame;
          }};
}

// Four channels of 1024 pixels in 4 frames on both sides: a standard error of sqrt(2 / 4096) 2 DN.
TEST(UniformScene, IsTheChannelsLightWithoutTheBias) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  const std::vector<double> light = {100, 0.01, 50, 0.4}, dark(4);
  const Image scene =
      uniform_scene(flat_frames(light, layout, 1), flat_frames(dark, layout, 2), layout);
  ASSERT_EQ(scene.rows(), kSide);
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) {
      const double truth = light[static_cast<std::size_t>(layout.channel_at(r, c))];
      if (truth < 0.1)
        EXPECT_EQ(scene(r, c), 0);  // below a twentieth of the noise: dark
      else
        EXPECT_NEAR(scene(r, c), truth, 5 * std::sqrt(2.0 / 4096) * kSd);
      EXPECT_EQ(scene(r + 62, c + 62), scene(r, c));
    }
}

TEST(UniformScene, LoadsNoMoreThanItNeeds) {
  const SensorLayout layout = SensorLayout::named("mono");
  int most = -1;
  const NoiseFrames lit{40,
                        [&](int k) {
                          most = std::max(most, k);
                          return Image(4, 4, 9);
                        }},
      unlit{40, [](int) { return Image(4, 4); }};
  EXPECT_EQ(uniform_scene(lit, unlit, layout)(3, 3), 9);
  EXPECT_EQ(most, kMostSceneFrames - 1);
}

// 20 log10(1000 / 2), with what the biases explain taken off.
TEST(KeptDetail, IsThePsnrBesideTheBiases) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  const std::vector<double> bias = {1, 2, 3, 4};
  Image clean(8, 8, 200), mean = clean;
  for (int r = 0; r < 8; ++r)
    for (int c = 0; c < 8; ++c)
      mean(r, c) += static_cast<float>(bias[static_cast<std::size_t>(layout.channel_at(r, c))]) +
                    (r % 4 < 2 ? 2.0f : -2.0f);
  mean(3, 3) = std::numeric_limits<float>::quiet_NaN();
  const Estimate<double> kept = kept_detail_psnr_db(mean, clean, layout, bias, 1000);
  ASSERT_TRUE(kept.decided());
  EXPECT_NEAR(*kept, 20 * std::log10(500), 1e-9);
  for (float& v : mean.values()) v = std::numeric_limits<float>::quiet_NaN();
  EXPECT_FALSE(kept_detail_psnr_db(mean, clean, layout, bias, 1000).decided());
}

}  // namespace
}  // namespace malus
