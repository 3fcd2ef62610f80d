// The noise of pictures full of texture, channel by channel. Truth: what they are drawn from, fixed
// seeds.
#include "malus/base/random.h"
#include "malus/denoise/estimate_noise.h"

#include <algorithm>
#include <cmath>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// How much of a pixel lies within a leaf that is four times as long as it is wide.
double cover_of(double down, double right, double length, double turn) {
  const double along = right * std::cos(turn) + down * std::sin(turn),
               across = down * std::cos(turn) - right * std::sin(turn);
  return std::clamp(0.5 + length / 4 * (1 - std::hypot(along / length, 4 * across / length)), 0.0,
                    1.0);
}

// Leaves on a dark ground, in every block of the picture: green is their brightest colour.
Image foliage(int rows, int cols, const SensorLayout& layout, double light_dn) {
  RandomSequence random(2, 0, Draw::kScene);
  Image dn(rows, cols, static_cast<float>(0.05 * light_dn));
  for (int leaf = 0; leaf < 700; ++leaf) {
    const double row = rows * random.uniform(), col = cols * random.uniform(),
                 length = 2 + 7 * random.uniform(), turn = 3.14 * random.uniform(),
                 light = light_dn * (0.1 + 0.6 * random.uniform());
    const auto top = static_cast<int>(row), left = static_cast<int>(col);
    for (int r = std::max(top - 10, 0); r < std::min(top + 11, rows); ++r)
      for (int c = std::max(left - 10, 0); c < std::min(left + 11, cols); ++c) {
        const char name = layout.channel_name(layout.channel_at(r, c)).front();
        const double colour = name == 'G'   ? 1.0
                              : name == 'R' ? 0.5
                                            : 0.3,
                     cover = cover_of(r - row, c - col, length, turn);
        dn(r, c) += static_cast<float>(cover * (colour * light - double{dn(r, c)}));
      }
  }
  return dn;
}

// Channels had 0.3 to 10 times their variance, by what texture each of them showed.
TEST(EstimateProfile, ChannelsOfFoliageShareTheirNoise) {
  constexpr double kLight = 1800;
  const PhysicsNoise camera = equal_channels("polar-bayer-rggb", {0.4, 1.0, 0, 1.7, 0});
  RawFrame frame = drawn_frame(foliage(291, 283, camera.layout, kLight), camera, {}, 3);
  frame.black_known = true;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  EXPECT_GT(noise->relative_error, 0.1);  // of what was left out
  for (const ChannelProfile& channel : noise->profile.channels)
    for (const double light : {0.05 * kLight, 0.1 * kLight}) {
      const double ratio = channel.variance(light) / (0.4 * light + 1);
      EXPECT_GT(ratio, 0.6);
      EXPECT_LT(ratio, 1.4);
    }
}

}  // namespace
}  // namespace malus
