// The noise of a picture whose camera multiplied colours after the conversion.
#include "malus/base/random.h"
#include "malus/denoise/estimate_noise.h"

#include <array>
#include <cmath>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Red times 2, blue times 1.37: red's noise had been half to 0.85 of what it is.
TEST(EstimateProfile, ColoursThatWereMultipliedHaveTheirOwnNoise) {
  const std::array<double, 4> gains = {2, 1, 1, 1.37};
  for (const std::uint64_t seed : {1, 2, 3}) {
    Image clean(384, 384);
    for (int r = 0; r < 384; ++r)
      for (int c = 0; c < 384; ++c)
        clean(r, c) = static_cast<float>(30 + 1.5 * c + 40 * std::sin(0.05 * r));
    const PhysicsNoise noise = equal_channels("bayer-rggb", {0.4, 0.14, 0, 0.7, 0});
    RawFrame frame = drawn_frame(std::move(clean), noise, {.black_dn = 64}, seed);
    frame.black_known = true;
    for (int r = 0; r < 384; ++r)
      for (int c = 0; c < 384; ++c) {
        const double gain = gains[static_cast<std::size_t>(frame.layout.channel_at(r, c))];
        const double code = std::round(frame.dn(r, c)) - 64;
        frame.dn(r, c) = static_cast<float>(64 + std::round(gain * code));
      }
    const Estimate<PictureNoise> found = estimate_profile(frame);
    ASSERT_TRUE(found);
    for (std::size_t k = 0; k < gains.size(); ++k)
      for (const double signal : {100.0, 300.0, 550.0}) {
        const double truth = 0.4 * signal + 1;
        EXPECT_NEAR(
            found->profile.channels[k].variance(gains[k] * signal) / (gains[k] * gains[k] * truth),
            1, 0.15)
            << k << " " << signal;
      }
  }
}

}  // namespace
}  // namespace malus
