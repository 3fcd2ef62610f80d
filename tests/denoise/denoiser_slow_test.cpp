#include "denoise/tiled_scene.h"

namespace malus {
namespace {

// The surroundings of a tile are hundreds of pixels wide: only a large frame has more than one.
class TwoScales : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(All, TwoScales, ::testing::Values("nl-ridge", "bm3d"));

TEST_P(TwoScales, AreNotChangedByTilesAndThreads) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = drawn_frame(polarized_blobs(1600, 1600), noise, {.black_dn = 82}, 6);
  DenoiseSettings settings{.method = GetParam()};
  const Denoised whole = denoise_frame(frame, profile_of(noise), settings, silent_progress(), true);
  ASSERT_EQ(whole.tiles, 1);
  leave_memory(GetParam() == "nl-ridge" ? 127 : 120, settings);  // reaches of their own
  const int before = thread_count();
  set_thread_count(before == 1 ? 3 : 1);
  const Denoised tiled = denoise_frame(frame, profile_of(noise), settings, silent_progress(), true);
  set_thread_count(before);
  EXPECT_GT(tiled.tiles, 1);
  EXPECT_EQ(whole.dn_above_black.values(), tiled.dn_above_black.values());
  EXPECT_EQ(whole.variance_dn2->values(), tiled.variance_dn2->values());
}

// Copies lie 84 pixels away, further than blocks are looked for else.
TEST_P(TwoScales, OfWhatRepeatsAreNotChangedByTiles) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  Image dn(600, 1800);
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) dn(r, c) = r % 84 < 30 && c % 84 < 40 ? 200.0f : 60.0f;
  const RawFrame frame = drawn_frame(dn, noise, {.black_dn = 82}, 5);
  DenoiseSettings settings{.method = GetParam(), .profile = "fast"};
  const Denoised whole = denoise_frame(frame, profile_of(noise), settings);
  ASSERT_EQ(whole.tiles, 1);
  leave_memory(GetParam() == "nl-ridge" ? 60 : 52, settings);  // reaches of their own
  const Denoised tiled = denoise_frame(frame, profile_of(noise), settings);
  EXPECT_GT(tiled.tiles, 1);
  EXPECT_EQ(whole.dn_above_black.values(), tiled.dn_above_black.values());
}

}  // namespace
}  // namespace malus
