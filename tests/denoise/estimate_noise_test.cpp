#include "malus/denoise/estimate_noise.h"

#include "malus/base/random.h"
#include "malus/noise/model.h"
#include "malus/synthesize/exact.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

PhysicsNoise shot_and_read_noise(double gain, double read) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("polar-bayer-rggb");
  noise.row_group = 2;
  noise.quantization_dn = 0;
  // Uniform read noise (lambda 1) with deviation `read`: scale read * sqrt(3).
  noise.channels.assign(16, PhysicsChannel{gain, 1.0, 0.0, read * std::sqrt(3.0), 0.0});
  return noise;
}

RawFrame frame_of(Image clean, const PhysicsNoise& noise) {
  RawFrame frame;
  frame.layout = noise.layout;
  frame.black_dn.assign(static_cast<std::size_t>(noise.layout.channels()), 0.0);
  frame.white_dn = 4095;
  frame.dn = std::move(clean);
  frame.source = "test";
  add_noise_exact(noise, frame.dn, frame.dn, DrawAddress{.seed = 4});
  return frame;
}

Image shaded(int rows, int cols, double low, double high) {
  Image dn(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      dn(r, c) = static_cast<float>(low + (high - low) * c / cols + 10 * std::sin(0.05 * r));
  return dn;
}

TEST(EstimateProfile, FindsTheDeviationOfShadedPictures) {
  for (const auto& [gain, read] : {std::pair{1.5, 3.7}, {0.4, 1.0}, {6.0, 15.0}}) {
    const Estimate<PictureNoise> noise =
        estimate_profile(frame_of(shaded(512, 640, 30, 600), shot_and_read_noise(gain, read)));
    ASSERT_TRUE(noise);
    for (const double signal : {60.0, 300.0, 550.0}) {
      const double truth = std::sqrt(gain * signal + read * read);
      double mean = 0;
      for (const ChannelProfile& channel : noise->profile.channels) {
        const double found = std::sqrt(channel.variance(signal));
        EXPECT_NEAR(found / truth, 1.0, 0.1) << gain << " at " << signal;
        mean += found / 16;
      }
      EXPECT_NEAR(mean / truth, 1.0, 0.03) << gain << " at " << signal;
    }
    EXPECT_TRUE(noise->profile.estimated_from_picture);
    EXPECT_FALSE(noise->trust.empty());
  }
}

// A power of two changes no digit: the same frame in another unit, rows lifted by draws of
// deviation 6 among pixels of 10 to 30 DN.
TEST(EstimateProfile, KnowsNoUnit) {
  PhysicsNoise camera = shot_and_read_noise(1.5, 3.7);
  for (PhysicsChannel& channel : camera.channels) channel.sigma_row_dn = 6;
  RawFrame frame = frame_of(shaded(512, 640, 30, 600), camera);
  const Estimate<PictureNoise> in_dn = estimate_profile(frame);
  constexpr double kUnit = 1.0 / 4096;
  for (float& v : frame.dn.values()) v *= static_cast<float>(kUnit);
  frame.white_dn *= kUnit;
  const Estimate<PictureNoise> in_shares = estimate_profile(frame);
  ASSERT_TRUE(in_dn && in_shares);
  EXPECT_EQ(in_shares->profile.row_group, in_dn->profile.row_group);
  for (std::size_t k = 0; k < 16; ++k) {
    const ChannelProfile &dn = in_dn->profile.channels[k], &share = in_shares->profile.channels[k];
    EXPECT_NEAR(dn.sigma_row_dn, 6, 1);
    EXPECT_DOUBLE_EQ(share.sigma_row_dn, kUnit * dn.sigma_row_dn);
    for (const double signal : {60.0, 550.0})
      EXPECT_DOUBLE_EQ(share.variance(kUnit * signal), kUnit * kUnit * dn.variance(signal));
  }
}

TEST(EstimateProfile, ASmallFrameTellsHowTheNoiseRises) {
  const Estimate<PictureNoise> noise =
      estimate_profile(frame_of(shaded(256, 256, 30, 600), shot_and_read_noise(1.5, 3.7)));
  ASSERT_TRUE(noise);
  for (const double signal : {60.0, 300.0, 550.0}) {
    double mean = 0;
    for (const ChannelProfile& channel : noise->profile.channels)
      mean += std::sqrt(channel.variance(signal)) / 16;
    EXPECT_NEAR(mean / std::sqrt(1.5 * signal + 13.7), 1.0, 0.12) << signal;
  }
}

TEST(EstimateProfile, StarsInASmallFrameAreNotItsNoise) {
  Image dn(256, 256, 7.0F);
  for (int i = 0; i < 150; ++i) {
    const int row = i * 89 % 253, col = i * 151 % 251;
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) dn(row + r, col + c) = static_cast<float>(i * 37 % 149) * 10;
  }
  RawFrame frame = frame_of(dn, shot_and_read_noise(0.12, 1));
  frame.black_known = true;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  for (const ChannelProfile& channel : noise->profile.channels) {
    EXPECT_NEAR(std::sqrt(channel.variance(7) / (0.12 * 7 + 1)), 1.0, 0.3);
    EXPECT_LT(std::sqrt(channel.variance(1000) / (0.12 * 1000 + 1)), 2.5);
  }
}

// A bright spot on an even ground gets no noise that the ground knows nothing of.
TEST(EstimateProfile, AnEvenFrameMakesNoSteepLine) {
  const Estimate<PictureNoise> noise =
      estimate_profile(frame_of(Image(512, 512, 300.0F), shot_and_read_noise(0.4, 10.0)));
  ASSERT_TRUE(noise);
  for (const ChannelProfile& channel : noise->profile.channels) {
    EXPECT_NEAR(std::sqrt(channel.variance(300) / (0.4 * 300 + 100)), 1.0, 0.1);
    EXPECT_LT(std::sqrt(channel.variance(3000) / (0.4 * 3000 + 100)), 1.8);
  }
}

TEST(EstimateProfile, TextureRaisesItByLittle) {
  Image dn = shaded(512, 512, 100, 500);
  for (int r = 0; r < 512; ++r)
    for (int c = 0; c < 256; ++c)  // half of the picture
      dn(r, c) += static_cast<float>(60 * std::sin(0.2 * r) * std::sin(0.15 * c));
  const Estimate<PictureNoise> noise =
      estimate_profile(frame_of(dn, shot_and_read_noise(1.5, 3.7)));
  ASSERT_TRUE(noise);
  const double truth = std::sqrt(1.5 * 300 + 3.7 * 3.7);
  EXPECT_NEAR(std::sqrt(noise->profile.channels[0].variance(300)) / truth, 1.05, 0.1);
}

TEST(EstimateProfile, TextureThatChannelsShareIsNoNoise) {
  Image dn = shaded(512, 512, 100, 500);
  const RawFrame plain = frame_of(dn, shot_and_read_noise(1.5, 3.7));
  EXPECT_EQ(estimate_profile(plain)->trust.find("it is texture"), std::string::npos);
  for (int r = 0; r < 512; ++r)  // a checker of whole cells: every channel sees it alike
    for (int c = 0; c < 512; ++c) dn(r, c) *= (r / 4 + c / 4) % 2 ? 1.4F : 0.6F;
  const Estimate<PictureNoise> noise =
      estimate_profile(frame_of(dn, shot_and_read_noise(1.5, 3.7)));
  EXPECT_NE(noise->trust.find("it is texture"), std::string::npos);
  for (const ChannelProfile& channel : noise->profile.channels) {
    const double times = std::sqrt(channel.variance(300) / (1.5 * 300 + 3.7 * 3.7));
    EXPECT_GT(times, 0.7);
    EXPECT_LT(times, 2);  // 5 with the texture in it
  }
}

// Levels of one brightness: a line through them may be anything elsewhere.
TEST(EstimateProfile, WhiteNoiseOfAnEvenSmallFrameIsNotCalledTexture) {
  // Of 60 those of the largest shares, above 0.25, where patches count that are hardly smoother.
  for (const std::uint64_t seed : {12u, 15u, 26u}) {
    RawFrame frame;
    frame.layout = SensorLayout::named("polar-mono");
    frame.black_dn.assign(4, 0.0);
    frame.white_dn = 4095;
    frame.black_known = frame.white_known = true;
    frame.dn = Image(128, 128);
    RandomSequence random(seed, 0, Draw::kScene);
    for (float& v : frame.dn.values())
      v = static_cast<float>(std::round(500 + 20 * random.normal()));
    const Estimate<PictureNoise> noise = estimate_profile(frame);
    ASSERT_TRUE(noise);
    EXPECT_LT(noise->texture_share, 0.1) << seed;
    EXPECT_EQ(noise->trust.find("it is texture"), std::string::npos) << seed;
  }
}

// Without the floors its deviation comes out 13 times too large. All blocks are of one brightness:
// that the noise rises with the light is known only of noise that is not below zero in the dark.
TEST(EstimateProfile, AWeaveAllOverHidesNoNoise) {
  Image dn(512, 512);
  for (int r = 0; r < 512; ++r)
    for (int c = 0; c < 512; ++c)
      dn(r, c) = static_cast<float>((c % 2 ? 1800 : 1400) *
                                    (1 + 0.55 * std::sin(0.69 * r) * std::sin(0.61 * c)));
  RawFrame frame = frame_of(dn, shot_and_read_noise(0.2, 0.6));
  frame.black_known = true;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  EXPECT_GT(noise->texture_share, 0.9);
  for (const double signal : {700.0, 1800.0, 2700.0})
    for (const ChannelProfile& channel : noise->profile.channels)
      EXPECT_NEAR(std::sqrt(channel.variance(signal) / (0.2 * signal + 0.36)), 1.0, 0.1) << signal;
}

// Four strokes 2 pixels wide, with soft edges, for each letter; letters every 9 columns in lines of
// 10 rows, 15 rows apart.
Image page_of_letters(double paper, double ink) {
  RandomSequence strokes(15, 0, Draw::kOther);
  Image page(384, 384, static_cast<float>(paper));
  for (int top = 1; top + 14 < 384; top += 15)
    for (int left = 1; left + 9 < 384; left += 9) {
      if (strokes.uniform() < 0.15) continue;  // between words
      for (int stroke = 0; stroke < 4; ++stroke) {
        const double r0 = top + 1 + 8 * strokes.uniform(), c0 = left + 1 + 6 * strokes.uniform(),
                     down = top + 1 + 8 * strokes.uniform() - r0,
                     right = left + 1 + 6 * strokes.uniform() - c0;
        for (int r = top; r < top + 11; ++r)
          for (int c = left; c < left + 9; ++c) {
            const double along = std::clamp(((r - r0) * down + (c - c0) * right) /
                                                (down * down + right * right + 1e-9),
                                            0.0, 1.0),
                         away = std::hypot(r - r0 - along * down, c - c0 - along * right),
                         cover = std::clamp(1.5 - away, 0.0, 1.0);
            page(r, c) = std::min(page(r, c), static_cast<float>(paper + cover * (ink - paper)));
          }
      }
    }
  return page;
}

// Letters fill the page, nothing has smooth surroundings, but paper shows between lines and words.
// Without it the deviation comes out 1.6 to 3.4 times too large in mosaics.
TEST(EstimateProfile, PaperBetweenLettersTellsTheNoise) {
  for (const char* name : {"mono", "bayer-rggb", "polar-bayer-rggb"})
    for (const double gain : {0.3, 1.0}) {
      PhysicsNoise camera = shot_and_read_noise(gain, 2.0);
      camera.layout = SensorLayout::named(name);
      camera.channels.resize(static_cast<std::size_t>(camera.layout.channels()));
      RawFrame frame = frame_of(page_of_letters(3000, 400), camera);
      frame.black_known = true;
      const Estimate<PictureNoise> noise = estimate_profile(frame);
      ASSERT_TRUE(noise);
      double mean = 0;
      for (const ChannelProfile& channel : noise->profile.channels)
        mean += std::sqrt(channel.variance(3000) / (gain * 3000 + 4)) /
                static_cast<double>(noise->profile.channels.size());
      EXPECT_GT(mean, 0.8) << name << ", " << gain;
      EXPECT_LT(mean, 1.3) << name << ", " << gain;
    }
}

TEST(EstimateProfile, ABlackLevelThatIsNotKnownDoesNotHarm) {
  Image dn = shaded(512, 512, 5, 500);
  RawFrame frame = frame_of(dn, shot_and_read_noise(1.5, 3.7));
  for (float& v : frame.dn.values()) v += 82;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  const auto& curve = noise->profile.channels[0].variance;
  EXPECT_NEAR(std::sqrt(curve(82 + 300)) / std::sqrt(1.5 * 300 + 13.7), 1.0, 0.05);
  EXPECT_GT(curve(0), 0);
}

// A camera of 12 bits in a container of 16, of which nobody says so: a quarter of the frame is at
// 4095, which has no noise.
TEST(EstimateProfile, ClippedHighlightsOfUnknownWhiteAreNoPartOfIt) {
  RawFrame frame = frame_of(shaded(512, 512, 1000, 5100), shot_and_read_noise(1.0, 3.0));
  for (float& v : frame.dn.values()) v = std::min(std::nearbyint(v), 4095.0f);
  const Estimate<PictureNoise> known = estimate_profile(frame);
  frame.white_dn = 65535;
  const Estimate<PictureNoise> unknown = estimate_profile(frame);
  ASSERT_TRUE(known && unknown);
  for (std::size_t k = 0; k < 16; ++k) {
    const auto deviation_at = [k](const PictureNoise& noise, double signal) {
      return std::sqrt(noise.profile.channels[k].variance(signal));
    };
    for (const double signal : {1500.0, 3500.0}) {
      EXPECT_NEAR(deviation_at(*unknown, signal) / std::sqrt(signal + 9), 1.0, 0.1) << signal;
      EXPECT_EQ(deviation_at(*unknown, signal), deviation_at(*known, signal));
    }
  }
}

// Noise of less than a count: the largest value has many pixels, and is not clipped.
TEST(EstimateProfile, ManyPixelsAtTheMaximumOfAFaintFrameAreNotClipped) {
  RawFrame frame = frame_of(Image(256, 256, 100.4f), shot_and_read_noise(0.001, 0.4));
  for (float& v : frame.dn.values()) v = std::nearbyint(v);
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  for (const ChannelProfile& channel : noise->profile.channels)
    EXPECT_NEAR(std::sqrt(channel.variance(100)), 0.5, 0.1);
}

// All blocks of a board have nearly one brightness and no smooth one is left: lines through their
// variances, thousands of times the noise's, are as steep as chance has it, and would differ from
// channel to channel a hundredfold. The limits stand far from that and claim no accuracy.
TEST(EstimateProfile, ABoardOfOneBrightnessHasNoWildLines) {
  PhysicsNoise camera = shot_and_read_noise(1.0, 2.5);
  camera.layout = SensorLayout::named("bayer-rggb");
  camera.channels.resize(4);
  for (const double light : {100.0, 1000.0, 9900.0}) {
    Image board(256, 256);
    for (int r = 0; r < 256; ++r)
      for (int c = 0; c < 256; ++c)
        board(r, c) = static_cast<float>(light * ((r / 9 + c / 9) % 2 ? 0.6 : 0.1));
    RawFrame frame = frame_of(std::move(board), camera);
    frame.black_known = true;
    frame.white_dn = 10000;
    const Estimate<PictureNoise> noise = estimate_profile(frame);
    ASSERT_TRUE(noise);
    for (const ChannelProfile& channel : noise->profile.channels) {
      const double ratio = channel.variance(0.35 * light) / (0.35 * light + 6.25);
      EXPECT_GT(ratio, 0.4) << light;
      EXPECT_LT(ratio, 1.5) << light;
    }
  }
}

// The smooth blocks of a level may be its dark ones alone: their signal is not the level's mean.
TEST(EstimateProfile, BlackAndWhiteSquaresHaveOneLine) {
  PhysicsNoise camera = shot_and_read_noise(1.0, 2.5);
  camera.layout = SensorLayout::named("mono");
  camera.channels.resize(1);
  Image board(320, 320);
  for (int r = 0; r < 320; ++r)
    for (int c = 0; c < 320; ++c) board(r, c) = (r / 64 + c / 64) % 2 ? 6800.0f : 75.0f;
  RawFrame frame = frame_of(std::move(board), camera);
  frame.white_dn = 10000;
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  for (const double signal : {75.0, 6800.0})
    EXPECT_NEAR(noise->profile.channels[0].variance(signal) / (signal + 6.25), 1, 0.1) << signal;
}

// Where three quarters of a picture are black, less noisy than a step, the rest tells.
TEST(EstimateProfile, PixelsThatAllRoundToBlackTellNothing) {
  const PhysicsNoise camera = shot_and_read_noise(0.05, 0.125);
  Image steps(320, 320);
  for (int r = 0; r < 320; ++r)
    for (int c = 0; c < 320; ++c)
      steps(r, c) = std::array{0.03f, 0.4f, 5.0f, 70.0f}[static_cast<std::size_t>(c / 80)];
  RawFrame frame = frame_of(std::move(steps), camera);
  frame.black_known = true;
  for (float& v : frame.dn.values()) v = std::max(std::round(v), 0.0f);
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  ASSERT_TRUE(noise);
  for (const ChannelProfile& channel : noise->profile.channels)
    EXPECT_NEAR(channel.variance(70) / (0.05 * 70 + 0.1), 1, 0.3);
}

// Eight bits of a large well: in the dark the noise is less than a step, most pixels equal their
// neighbours, and what rounding adds is seen only where light changes.
TEST(EstimateProfile, RoundingIsNoiseToo) {
  RawFrame frame = frame_of(shaded(512, 512, 2, 12), shot_and_read_noise(0.002, 0.06));
  const auto deviations = [&] {
    const Estimate<PictureNoise> noise = estimate_profile(frame);
    EXPECT_TRUE(noise);
    std::vector<double> found;
    for (const ChannelProfile& channel : noise->profile.channels)
      for (const double signal : {2.0, 7.0, 12.0})
        found.push_back(std::sqrt(channel.variance(signal)));
    return found;
  };
  for (const double found : deviations()) EXPECT_LT(found, 0.25);
  for (float& v : frame.dn.values()) v = std::round(v);
  for (const double found : deviations()) {
    EXPECT_GE(found, std::sqrt(1.0 / 12));
    EXPECT_LT(found, 0.4);
  }
}

TEST(EstimateProfile, PixelsThatHoldNoLightTakeNoPart) {
  RawFrame frame = frame_of(shaded(256, 320, 30, 600), shot_and_read_noise(1.5, 3.7));
  frame.dn(77, 78) = std::numeric_limits<float>::quiet_NaN();
  const PictureNoise hole = *estimate_profile(frame);
  for (const float value : {-3.4e38f, -1e10f, 1e20f}) {
    frame.dn(77, 78) = value;
    const Estimate<PictureNoise> noise = estimate_profile(frame);
    ASSERT_TRUE(noise) << value;
    EXPECT_EQ(noise->trust, hole.trust);
    for (std::size_t k = 0; k < 16; ++k)
      EXPECT_EQ(noise->profile.channels[k].variance(300), hole.profile.channels[k].variance(300));
  }
}

TEST(EstimateProfile, RefusesWhatHasNoNoiseOrIsTooSmall) {
  RawFrame flat = frame_of(shaded(512, 512, 30, 60), shot_and_read_noise(1.5, 3.7));
  for (float& v : flat.dn.values()) v = 500;
  EXPECT_FALSE(estimate_profile(flat));
  EXPECT_FALSE(estimate_profile(frame_of(Image(64, 64, 100.0f), shot_and_read_noise(1.5, 3.7))));
}

TEST(EstimateProfile, AFrameWithoutPixelsIsRefused) {
  RawFrame frame = frame_of(Image(8, 8, 50.0F), shot_and_read_noise(1, 2));
  frame.dn = Image(0, 8);
  EXPECT_THROW(require_estimate(frame, "give a model"), InputError);
}

}  // namespace
}  // namespace malus
