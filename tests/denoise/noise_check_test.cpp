// Truth: frames of a camera with known noise; fixed seeds.
#include "malus/denoise/noise_check.h"

#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>
#include <string>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kFrameSide = 256;

// Of a camera whose converter makes steps of 1 DN.
PhysicsNoise stepped_camera(double gain_dn_per_e, double read_e = 1.5) {
  return equal_channels("polar-mono", {gain_dn_per_e, 0.14, 0.0, read_e * gain_dn_per_e, 0.0});
}

NoiseProfile rounded_profile(PhysicsNoise noise) {
  noise.quantization_dn = 1;
  return profile_of(noise);
}

Denoised run(const PhysicsNoise& noise, const NoiseProfile& profile, float light_dn) {
  Image clean(kFrameSide, kFrameSide);
  for (int r = 0; r < kFrameSide; ++r)
    for (int c = 0; c < kFrameSide; ++c)
      clean(r, c) = light_dn * (1 + 0.3f * static_cast<float>(std::sin(0.01 * (r + c))));
  RawFrame frame = drawn_frame(clean, noise, {.black_dn = 20}, 3);
  for (float& dn : frame.dn.values()) dn = std::round(dn);
  return denoise_frame(frame, profile, {.profile = "fast"}, silent_progress(), true);
}

std::string complaint(const Denoised& result) {
  return result.noise ? noise_complaint(*result.noise) : "";
}

TEST(NoiseCheck, HasNothingAgainstTheRightNoise) {
  for (const double gain : {0.05, 0.2, 1.0, 4.0})
    for (const float electrons : {2.0f, 20.0f, 400.0f}) {
      const PhysicsNoise noise = stepped_camera(gain);
      const auto light_dn = static_cast<float>(gain) * electrons;
      EXPECT_EQ(complaint(run(noise, rounded_profile(noise), light_dn)), "")
          << gain << " " << electrons;
    }
}

// A few pixels in a thousand change their code, and a bias that is no whole number hides the step:
// the noise that such a frame shows is hardly any.
TEST(NoiseCheck, HasNothingAgainstNoiseThatRoundingHides) {
  PhysicsNoise noise = stepped_camera(0.05, 2.5);
  for (std::size_t c = 0; c < noise.channels.size(); ++c)
    noise.channels[c].mu_dn = 0.003 * static_cast<double>(c + 1);
  for (const float light_dn : {0.05f, 0.1f, 0.15f}) {
    const Denoised result = run(noise, rounded_profile(noise), light_dn);
    ASSERT_TRUE(result.noise);
    EXPECT_LT(result.noise->frame_sd_dn, 0.7 * result.noise->profile_sd_dn) << light_dn;
    EXPECT_EQ(complaint(result), "") << light_dn;
  }
}

TEST(NoiseCheck, NamesNoiseOfAnotherGain) {
  const NoiseProfile profile = rounded_profile(stepped_camera(1.0));
  EXPECT_NE(complaint(run(stepped_camera(4.0), profile, 400)).find("check gain"),
            std::string::npos);
  EXPECT_NE(complaint(run(stepped_camera(0.2), profile, 400)).find("check gain"),
            std::string::npos);
}

// A clean picture in a frame's place. Frames of one value, and small ones, tell nothing.
TEST(NoiseCheck, AFrameWithoutNoiseIsNone) {
  PhysicsNoise noise = stepped_camera(4.0);
  for (std::size_t k = 0; k < noise.channels.size(); ++k)
    noise.channels[k].mu_dn = 0.5 * static_cast<double>(k);
  const NoiseProfile profile = profile_of(noise);
  const auto checked = [&](int side, float wave_dn) {
    RawFrame frame;
    frame.layout = profile.layout;
    frame.black_dn.assign(profile.channels.size(), 20);
    frame.white_dn = 4095;
    frame.dn = Image(side, side);
    for (int r = 0; r < side; ++r)
      for (int c = 0; c < side; ++c)
        frame.dn(r, c) = 420 + wave_dn * static_cast<float>(std::sin(0.025 * c));
    return denoise_frame(frame, profile, {.profile = "fast"});
  };
  const Denoised clean = checked(kFrameSide, 300);
  ASSERT_TRUE(clean.noise);
  EXPECT_EQ(clean.noise->frame_sd_dn, 0);
  EXPECT_NE(complaint(clean).find("no noise at all"), std::string::npos);
  for (const float dn : clean.dn_above_black.values()) ASSERT_TRUE(std::isfinite(dn));
  EXPECT_EQ(complaint(checked(kFrameSide, 0)), "");
  EXPECT_EQ(complaint(checked(64, 300)), "");
}

// A frame cannot have more noise than it shows; of print it shows less than there is.
TEST(NoiseCheck, NoMoreNoiseIsSureThanTheFrameShows) {
  EXPECT_EQ(sure_noise_share(std::nullopt), 1);
  EXPECT_EQ(sure_noise_share(NoiseCheck{.frame_sd_dn = std::nan(""), .profile_sd_dn = 2}), 1);
  EXPECT_EQ(sure_noise_share(NoiseCheck{.frame_sd_dn = 3, .profile_sd_dn = 2}), 1);
  EXPECT_DOUBLE_EQ(sure_noise_share(NoiseCheck{.frame_sd_dn = 1, .profile_sd_dn = 2}), 0.25);
  const NoiseCheck print{.frame_sd_dn = 1.6, .profile_sd_dn = 2, .texture_share = 0.9};
  EXPECT_EQ(sure_noise_share(print), 1);
  const NoiseCheck smoothed{.frame_sd_dn = 0.4, .profile_sd_dn = 2, .texture_share = 1};
  EXPECT_NEAR(sure_noise_share(smoothed), 0.0711, 1e-4);
}

// Waves of half the deviation that the profile tells, of which the frame has two thirds:
// what it leaves of them is no noise to be averaged.
TEST(NoiseCheck, WhereNoiseIsToldTooLargeDetailStays) {
  const PhysicsNoise noise = stepped_camera(4.0);
  Image clean(kFrameSide, kFrameSide);
  for (int r = 0; r < kFrameSide; ++r)
    for (int c = 0; c < kFrameSide; ++c)
      clean(r, c) = 400 + 30 * static_cast<float>(std::sin(0.25 * r) * std::sin(0.2 * c));
  const RawFrame frame = drawn_frame(clean, noise, {.black_dn = 20}, 3);
  const auto squared_error_over_stated = [&](double deviation, double strength) {
    PhysicsNoise told = noise;
    for (PhysicsChannel& channel : told.channels) {
      channel.gain_dn_per_e *= deviation * deviation;
      channel.sigma_tl_dn *= deviation;
    }
    const Denoised result =
        denoise_frame(frame, profile_of(told), {.strength = strength}, silent_progress(), true);
    double square = 0, stated = 0;
    for (std::size_t i = 0; i < clean.size(); ++i) {
      square += std::pow(double{result.dn_above_black.values()[i]} - clean.values()[i], 2);
      stated += double{result.variance_dn2->values()[i]};
    }
    return square / stated;
  };
  EXPECT_LT(squared_error_over_stated(1.5, 1), 2);
  EXPECT_LT(squared_error_over_stated(1, 1.5), 2);
}

// Pixels of one signal that all round alike say nothing of where in the step it lies.
TEST(NoiseCheck, WhatRoundingHidesIsStated) {
  const PhysicsNoise noise = stepped_camera(0.05);
  for (const float light_dn : {0.1f, 0.2f, 0.3f, 0.4f}) {
    const Denoised result = run(noise, rounded_profile(noise), light_dn);
    double square = 0, stated = 0;
    for (int r = 0; r < kFrameSide; ++r)
      for (int c = 0; c < kFrameSide; ++c) {
        const double light = light_dn * (1 + 0.3 * std::sin(0.01 * (r + c)));
        square += std::pow(result.dn_above_black(r, c) - light, 2);
        stated += (*result.variance_dn2)(r, c);
      }
    EXPECT_LT(square, 1.5 * stated) << light_dn;
    EXPECT_LT(stated, 0.1 * kFrameSide * kFrameSide) << light_dn;  // a step's own: 1/12
  }
}

// A disc in a frame: what fills the places without a number has next to no noise.
TEST(NoiseCheck, HolesAreNoNoiseOfTheFrame) {
  const PhysicsNoise noise = stepped_camera(1.0);
  RawFrame frame = drawn_frame(Image(kFrameSide, kFrameSide, 400.0f), noise, {.black_dn = 20}, 3);
  for (int r = 0; r < kFrameSide; ++r)
    for (int c = 0; c < kFrameSide; ++c) {
      float& dn = frame.dn(r, c);
      dn = std::hypot(r - 128, c - 128) < 90 ? std::round(dn)
                                             : std::numeric_limits<float>::quiet_NaN();
    }
  const Denoised result = denoise_frame(frame, rounded_profile(noise), {.profile = "fast"});
  EXPECT_EQ(complaint(result), "");
  ASSERT_TRUE(result.noise);
  EXPECT_NEAR(result.noise->frame_sd_dn / result.noise->profile_sd_dn, 1, 0.1);
}

}  // namespace
}  // namespace malus
