// Truth: rounded samples of known light, whose variance the normal law gives (rounding.h).
#include "malus/denoise/internal/within_codes.h"

#include "malus/base/random.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/rounding.h"

#include <cmath>
#include <functional>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kCodesSide = 96;
constexpr double kCodesBlackDn = 16;

using CodesLight = std::function<double(int, int)>;

RawFrame frame_of_codes(const CodesLight& light_dn, double sd_dn) {
  RandomSequence random(7, 0, Draw::kOther);
  RawFrame frame;
  frame.layout = SensorLayout::named("mono");
  frame.dn = Image(kCodesSide, kCodesSide);
  for (int r = 0; r < kCodesSide; ++r)
    for (int c = 0; c < kCodesSide; ++c)
      frame.dn(r, c) =
          static_cast<float>(std::round(kCodesBlackDn + light_dn(r, c) + sd_dn * random.normal()));
  frame.bits = 8;
  frame.black_dn = {kCodesBlackDn};
  frame.white_dn = 255;
  frame.black_known = frame.white_known = true;
  return frame;
}

NoiseProfile profile_of_codes(double sd_dn) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("mono");
  profile.step_dn = 1;
  profile.channels.push_back({.variance = VarianceCurve::affine(0, sd_dn * sd_dn + 1.0 / 12)});
  return profile;
}

VarianceCurve curve_of(const CodesLight& light_dn, double sd_dn, bool from_picture = false) {
  NoiseProfile profile = profile_of_codes(sd_dn);
  profile.estimated_from_picture = from_picture;
  Denoised report;
  const PreparedFrame frame = prepare_frame(frame_of_codes(light_dn, sd_dn), profile, {}, report);
  return internal::with_noise_between_codes(profile, frame).channels[0].variance;
}

CodesLight light_of_one_place(double dn) {
  return [dn](int, int) { return dn; };
}

// The share of samples in the other code has an error of 1 %, the variance no more than 5 %.
TEST(WithinCodes, EvenLightBetweenTwoCodesShowsItsNoise) {
  for (const double sd : {0.15, 0.25, 0.35})
    for (const double dn : {5.5, 7.4}) {
      const double true_dn2 = rounded_variance(1, dn, sd * sd);
      ASSERT_GT(true_dn2, 1.1 * (sd * sd + 1.0 / 12));
      EXPECT_NEAR(curve_of(light_of_one_place(dn), sd)(std::floor(dn) + 0.5), true_dn2,
                  0.05 * true_dn2)
          << sd << " " << dn;
    }
}

TEST(WithinCodes, NothingElseDoes) {
  RandomSequence random(8, 0, Draw::kOther);
  const auto grain = [&random](int, int) { return 6.3 + 0.6 * random.normal(); };
  const auto ramp = [](int r, int c) { return 2 + 0.05 * r + 0.03 * c; };
  const auto stripes = [](int, int c) { return c / 3 % 2 ? 6.9 : 5.1; };
  const auto board = [](int r, int c) { return (r + c) % 2 ? 5.8 : 5.2; };
  const auto is_as_told = [](const VarianceCurve& curve, double sd) {
    for (double dn = 0; dn < 12; dn += 0.25)
      if (curve(dn) != sd * sd + 1.0 / 12) return false;
    return true;
  };
  EXPECT_TRUE(is_as_told(curve_of(light_of_one_place(6), 0.25), 0.25)) << "on a code";
  EXPECT_TRUE(is_as_told(curve_of(grain, 0.25), 0.25));
  EXPECT_TRUE(is_as_told(curve_of(ramp, 0.25), 0.25));
  EXPECT_TRUE(is_as_told(curve_of(stripes, 0.25), 0.25));
  EXPECT_TRUE(is_as_told(curve_of(board, 0.25), 0.25));
  EXPECT_TRUE(is_as_told(curve_of(light_of_one_place(5.5), 0.5), 0.5)) << "noise of half a step";
  EXPECT_TRUE(is_as_told(curve_of(light_of_one_place(5.5), 0.25, true), 0.25))
      << "the picture's own";
}

// Without a model such light came out 7 to 16 dB better.
TEST(WithinCodes, LightBetweenTwoCodesIsAveraged) {
  constexpr double kDn = 5.5, kSd = 0.25;
  const Image result = denoise_frame(frame_of_codes(light_of_one_place(kDn), kSd),
                                     profile_of_codes(kSd), {.profile = "fast"})
                           .dn_above_black;
  double squares = 0;
  for (const float dn : result.values()) squares += std::pow(dn - kDn, 2);
  EXPECT_LT(squares / static_cast<double>(result.size()), 0.006);  // of 0.25, and was 0.02
}

// Noise that may not be there cannot be relied on to average rounding out; the picture is the same.
TEST(WithinCodes, NoiseThatIsAGuessLeavesMoreOfRoundingInTheStatedError) {
  constexpr double kTold = 0.29 * 0.29, kSure = 0.01;
  NoiseProfile profile = profile_of_codes(std::sqrt(kTold));
  const RawFrame frame =
      frame_of_codes([](int r, int c) { return 5 + 0.01 * r + std::sin(0.05 * c); }, 0.14);
  const auto denoised = [&] { return denoise_frame(frame, profile, {}, silent_progress(), true); };
  const Denoised sure = denoised();
  profile.channels[0].guessed_dn2 = kTold - kSure;
  const Denoised guess = denoised();
  EXPECT_EQ(guess.dn_above_black.values(), sure.dn_above_black.values());
  const double more = undithered_variance(1, kSure) - undithered_variance(1, kTold);
  EXPECT_GT(more, 0.02);
  for (std::size_t i = 0; i < sure.variance_dn2->values().size(); ++i)
    EXPECT_NEAR(guess.variance_dn2->values()[i] - sure.variance_dn2->values()[i], more, 1e-5);
}

}  // namespace
}  // namespace malus
