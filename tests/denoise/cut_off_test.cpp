#include "malus/denoise/cut_off.h"

#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/denoise/frame_profile.h"
#include "malus/noise/physics.h"

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kCutSlopeDn = 0.4, kCutReadDn = 1.2;
constexpr int kCutBand = 64;  // columns of one light

double cut_light_of(int col) {
  return 0.25 * std::pow(2.0, col / kCutBand) - 0.25;
}  // 0, 0.25, 0.75, ...

// Bands of light from 0 up, twice as bright in every other channel, as a camera without a black
// level writes them.
RawFrame cut_off_frame(double black_dn, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> read(0.0, kCutReadDn);
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn.assign(4, black_dn);
  frame.white_dn = 4095;
  frame.bits = 12;
  frame.black_known = frame.white_known = frame.layout_known = true;
  frame.source = "dark";
  frame.dn = Image(512, 8 * kCutBand);
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const double light = cut_light_of(c) * (frame.layout.channel_at(r, c) % 2 ? 2 : 1);
      double dn = black_dn + read(random);
      if (light > 0)
        dn += kCutSlopeDn * std::poisson_distribution<int>(light / kCutSlopeDn)(random);
      frame.dn(r, c) = static_cast<float>(std::max(std::round(dn), 0.0));
    }
  return frame;
}

NoiseProfile uncut_profile() {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("polar-mono");
  profile.step_dn = 1;
  profile.channels.assign(
      4, {.variance = VarianceCurve::affine(kCutSlopeDn, kCutReadDn * kCutReadDn + 1.0 / 12)});
  return profile;
}

// Largest error of a band's mean, away from its edges, of channels 0 and 1.
double worst_cut_band(const Image& dn, const SensorLayout& layout) {
  double worst = 0;
  for (int band = 0; band < 8; ++band)
    for (int channel = 0; channel < 2; ++channel) {
      double sum = 0, count = 0;
      for (int r = 16; r < dn.rows() - 16; ++r)
        for (int c = band * kCutBand + 16; c < (band + 1) * kCutBand - 16; ++c)
          if (layout.channel_at(r, c) == channel) {
            sum += dn(r, c);
            count += 1;
          }
      worst = std::max(
          worst, std::abs(sum / count - cut_light_of(band * kCutBand) * (channel == 1 ? 2 : 1)));
    }
  return worst;
}

// A band's mean has an error of 0.04 DN (the slope of the inverse and all), of which 3.5 hold the
// worst of 16 with a probability of 0.993; the clipped mean is 0.46 DN too high at no light.
TEST(CutOff, DarkPlacesComeOutAsDarkAsTheyAre) {
  for (const char* method : {"nl-ridge", "bm3d", "vst-bm3d"}) {
    const Denoised result =
        denoise_frame(cut_off_frame(0, 3), uncut_profile(), {.method = method, .profile = "fast"});
    EXPECT_LT(worst_cut_band(result.dn_above_black, uncut_profile().layout), 0.14) << method;
    EXPECT_TRUE(result.cut_off_undone);
    EXPECT_GT(result.cut_off_share, 0.1);
  }
}

// They filter the pixels as they are: nothing there knows of a law.
TEST(CutOff, MethodsThatDoNotStabiliseUndoNothingAndSayNothingElse) {
  for (const char* method : {"paper-bm3d", "paper-mbm3d"}) {
    const Denoised result =
        denoise_frame(cut_off_frame(0, 3), uncut_profile(), {.method = method, .profile = "fast"});
    EXPECT_FALSE(result.cut_off_undone) << method;
    EXPECT_GT(result.cut_off_share, 0.1) << method;
  }
}

TEST(CutOff, FarBelowTheBlackLevelNothingChanges) {
  const RawFrame frame = cut_off_frame(60, 3);
  EXPECT_FALSE(measure_cut_off(frame).any());
  const Denoised result = denoise_frame(frame, uncut_profile(), {.profile = "fast"});
  EXPECT_FALSE(result.cut_off_undone);
  EXPECT_EQ(result.cut_off_share, 0);
}

// Of a mean of frames their share at 0 is worked out; what lies below 0 was not cut off there.
TEST(CutOff, OfAMeanIsWorkedOut) {
  constexpr int kFrames = 16;
  for (const double black_dn : {0.0, 60.0}) {
    RawFrame mean = cut_off_frame(black_dn, 30);
    double at_zero = 0;
    for (int f = 0; f < kFrames; ++f) {
      const RawFrame one = cut_off_frame(black_dn, 30 + static_cast<std::uint64_t>(f));
      for (std::size_t i = 0; i < mean.dn.size(); ++i) {
        if (f == 0) mean.dn.values()[i] = 0;
        mean.dn.values()[i] += one.dn.values()[i] / kFrames;
      }
      at_zero += measure_cut_off(one).mean_share() / kFrames;
    }
    mean.bits = 0;
    NoiseProfile profile = uncut_profile();
    for (ChannelProfile& channel : profile.channels)
      channel.variance = channel.variance.scaled(1.0 / kFrames);
    EXPECT_EQ(cut_off_share_of_mean(mean, profile), 0);  // of one frame
    mean.mean_of = kFrames;
    const double share = cut_off_share_of_mean(mean, profile);
    EXPECT_NEAR(share, at_zero, 0.4 * at_zero) << black_dn;
    if (black_dn > 0) continue;
    EXPECT_GT(share, 0.05);
    const Denoised result = denoise_frame(mean, profile, {.profile = "fast"});
    EXPECT_EQ(result.frames_cut_off_share, share);
    const std::vector<std::string> lines = frame_complaints(result, true);
    ASSERT_EQ(lines.size(), 1u);
    EXPECT_NE(lines[0].find("frames that it is the mean of"), std::string::npos) << lines[0];
    mean.dn(3, 3) = -1;
    EXPECT_EQ(cut_off_share_of_mean(mean, profile), 0);
  }
}

// The noise of the same scene with a black level far above 0, within a tenth.
TEST(CutOff, NoiseOfAPictureIsThatBeforeItWasCutOff) {
  const Estimate<PictureNoise> cut = estimate_profile(cut_off_frame(0, 4));
  ASSERT_TRUE(cut);
  for (const ChannelProfile& channel : cut->profile.channels) {
    EXPECT_NEAR(channel.variance(0), kCutReadDn * kCutReadDn + 1.0 / 12, 0.15);
    EXPECT_NEAR(channel.variance(20), kCutReadDn * kCutReadDn + 1.0 / 12 + 20 * kCutSlopeDn, 1.0);
  }
}

TEST(CutOff, ModelsOfDarkFramesThatWereCutOffToo) {
  NoiseProfile profile = uncut_profile();
  for (ChannelProfile& channel : profile.channels) {  // of max(0, round(1.2 n)), drawn: 4e6 pixels
    channel.bias_dn = 0.4642;
    channel.variance = VarianceCurve::affine(kCutSlopeDn, 0.5456);
  }
  profile.dark_was_cut_off = true;
  const Denoised result = denoise_frame(cut_off_frame(0, 5), profile, {.profile = "fast"});
  EXPECT_LT(worst_cut_band(result.dn_above_black, profile.layout), 0.14);
}

// The law that is fitted to what was cut off has tails that no noise has (here a deviation of 1.2
// DN where 0.74 showed).
TEST(CutOff, WhatDarkFramesShowedIsTakenAsMeasuredNotFromTheLaw) {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  model.quantization_dn = 1;
  model.black_dn.assign(4, 0.0);
  PhysicsCalibration p;
  p.gain.gain_db = 0;
  p.K.mean.assign(4, kCutSlopeDn);
  p.mu.mean.assign(4, 0.4642);
  p.lambda.mean.assign(4, -0.3);
  p.sigma_tl.mean.assign(4, 1.0);
  p.sigma_tl.mean.assign(4, 1.2 / read_noise_dn(p).front());
  p.temporal_sd_dark_dn.assign(4, std::sqrt(0.5456));
  p.dark_zero_share.assign(4, 0.66);
  model.physics.push_back(p);
  const RawFrame frame = cut_off_frame(0, 5);
  const NoiseProfile profile = denoising_profile(frame, model, p.gain);
  EXPECT_NEAR(profile.channels[0].variance(0), 0.5456, 1e-9);
  EXPECT_NEAR(profile.channels[0].variance(100), 0.5456 + 100 * kCutSlopeDn, 1e-9);
  const Denoised result = denoise_frame(frame, profile, {.profile = "fast"});
  EXPECT_LT(worst_cut_band(result.dn_above_black, profile.layout), 0.14);
}

TEST(CutOff, OneCodeThatHoldsNoLightMakesNoSignedCodes) {
  RawFrame frame = cut_off_frame(0, 3);
  frame.dn(77, 78) = -2147483648.0f;
  EXPECT_GT(measure_cut_off(frame).mean_share(), 0.1);
}

// A masked border shows no noise: it stays at 0, and is no sign of a camera that cuts off.
TEST(CutOff, PlacesWithoutNoiseStayAtZero) {
  RawFrame masked = cut_off_frame(60, 6);
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < masked.dn.cols(); ++c) masked.dn(r, c) = 0;
  masked.black_dn.assign(4, 0.0);
  EXPECT_FALSE(measure_cut_off(masked).any());

  RawFrame both = cut_off_frame(0, 6);
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < both.dn.cols(); ++c) both.dn(r, c) = 0;
  const Denoised result = denoise_frame(both, uncut_profile(), {.profile = "fast"});
  ASSERT_TRUE(result.cut_off_undone);
  for (int r = 0; r < 100; ++r)
    for (int c = 0; c < both.dn.cols(); ++c)
      ASSERT_NEAR(result.dn_above_black(r, c), 0.0f, 0.05f) << r << " " << c;
}

// Noise of a fifth of a step is rounded to 0, not cut off there: nothing is undone, and it is said.
TEST(CutOff, RoundedNoiseIsLeftAndSaid) {
  NoiseProfile profile = uncut_profile();
  for (ChannelProfile& channel : profile.channels)
    channel.variance = VarianceCurve::affine(0, 0.04 + 1.0 / 12);
  Denoised result = denoise_frame(cut_off_frame(0, 8), profile, {.profile = "fast"});
  EXPECT_FALSE(result.cut_off_undone);
  result.saturated_pixels = result.nonfinite_pixels = 0;
  const std::vector<std::string> said = frame_complaints(result, true);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("the light there and its DoLP come out wrong; raise the camera's black"),
            std::string::npos);
}

TEST(CutOff, FloatsAndSignedCodesAreNotCutOff) {
  RawFrame frame = cut_off_frame(0, 7);
  frame.bits = 0;
  EXPECT_FALSE(measure_cut_off(frame).any());
  frame.bits = 15;
  frame.dn(100, 100) = -1;
  EXPECT_FALSE(measure_cut_off(frame).any());
}

}  // namespace
}  // namespace malus
