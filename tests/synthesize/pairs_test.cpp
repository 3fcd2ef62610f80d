// References and the choice of the short frame, on frames with known flicker.
#include "malus/synthesize/pairs.h"

#include "malus/synthesize/compiled.h"

#include <cmath>
#include <limits>

#include <gtest/gtest.h>

namespace malus {
namespace {

Image scene() {
  Image image(80, 120);
  for (int r = 0; r < 80; ++r)
    for (int c = 0; c < 120; ++c)
      image(r, c) = 200.0f + 8.0f * static_cast<float>(c) + static_cast<float>(r);
  return image;
}

Image noisy_copy(const Image& clean, float factor, std::uint32_t frame) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.channels = {{.gain_dn_per_e = 0.5, .lambda = 0.1, .mu_dn = 0, .sigma_tl_dn = 1}};
  Image out = clean;
  for (float& v : out.values()) v *= factor;
  CompiledNoise(noise).apply(out.view(), out.view(), {.seed = 3, .frame = frame});
  return out;
}

TEST(FrameMean, ApproachesTheSceneAsOneOverRootN) {
  const Image clean = scene();
  FrameMean mean;
  for (std::uint32_t f = 0; f < 50; ++f) mean.add(noisy_copy(clean, 1, f));
  EXPECT_EQ(mean.count(), 50);
  const Image reference = mean.mean();
  double square = 0, expected = 0;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    square += std::pow(static_cast<double>(reference.values()[i] - clean.values()[i]), 2);
    expected += (0.5 * static_cast<double>(clean.values()[i]) + 3.3) / 50;
  }
  EXPECT_NEAR(square / expected, 1.0, 5 * std::sqrt(2.0 / 9600));
}

TEST(NearestFrame, FindsTheLeastFlickeringOne) {
  const Image clean = scene();
  const double flicker[] = {1.06, 0.97, 1.01, 0.93};
  std::vector<RelativeIntensity> intensities;
  for (std::uint32_t i = 0; i < 4; ++i) {
    const Image frame = noisy_copy(clean, static_cast<float>(flicker[i] / 10), 100 + i);
    const auto intensity = relative_intensity(frame, clean, 0, 4000);
    ASSERT_TRUE(intensity.decided());
    EXPECT_NEAR(intensity->value * 10, flicker[i], 0.005);
    intensities.push_back(*intensity);
  }
  const NearestFrame nearest = nearest_frame(intensities, 10);
  EXPECT_EQ(nearest.index, 2u);
  EXPECT_NEAR(nearest.deviation, 0.01, 0.005);
  ASSERT_TRUE(nearest.flicker);
  EXPECT_NEAR(*nearest.flicker, 0.13, 0.01);
  EXPECT_LT(nearest.flicker_of_noise.value_or(1), 0.01);
  for (RelativeIntensity& one : intensities) one.value -= 0.1;  // no light
  EXPECT_FALSE(nearest_frame(intensities, 10).flicker);
  EXPECT_FALSE(nearest_frame({intensities.front()}, 10).flicker);  // beside which there is none
}

// Frames of 3 to 7 DN under noise of 5 DN and rows of 2 DN: intensities differ by per cent without
// any flicker. Seeds are fixed; chance alone goes beyond the bound in one set of 370, and the ratio
// of squares lies within four standard errors of 1.
TEST(NearestFrame, NoiseAloneIsNoFlicker) {
  constexpr int kSets = 60;
  // Three, and what Student's t distribution of 19 degrees of freedom (20 bands) adds to them.
  constexpr double kStandardErrors = 3 + 30 / (4 * 19.0);
  const Image clean = scene();
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.row_group = 2;
  noise.channels = {
      {.gain_dn_per_e = 0.5, .lambda = 0.1, .mu_dn = 0, .sigma_tl_dn = 3, .sigma_row_dn = 2}};
  const CompiledNoise drawn(noise);
  const auto intensity = [&](std::uint32_t frame, float factor) {
    Image dim = clean;
    for (float& v : dim.values()) v *= factor;
    drawn.apply(dim.view(), dim.view(), {.seed = 5, .frame = frame});
    return *relative_intensity(dim, clean, 0, 4000);
  };
  int told = 0;
  double squares = 0, flicker = 0;
  for (std::uint32_t set = 0; set < kSets; ++set) {
    const NearestFrame two =
        nearest_frame({intensity(2 * set, 0.005F), intensity(2 * set + 1, 0.005F)}, 200);
    told += two.flicker.has_value();
    const double first = intensity(2 * set, 0.005F).value,
                 second = intensity(2 * set + 1, 0.005F).value,
                 difference = 2 * (first - second) / (first + second);
    flicker += std::abs(difference) / kSets;
    squares += std::pow(kStandardErrors * difference / two.flicker_of_noise.value(), 2) / kSets;
  }
  EXPECT_LE(told, 1);
  EXPECT_GT(flicker, 0.01);
  EXPECT_NEAR(squares, 1, 4 * std::sqrt(2.0 / kSets));
  const NearestFrame seen = nearest_frame({intensity(0, 0.005F), intensity(1, 0.008F)}, 200);
  EXPECT_NEAR(seen.flicker.value_or(0), 0.46, 0.1);
}

TEST(RelativeIntensity, LeavesOutWhatIsSaturatedAndSaysWhenNothingIsLeft) {
  Image reference = scene(), frame = scene();
  for (int r = 0; r < 80; ++r)
    for (int c = 60; c < 120; ++c) frame(r, c) = 1.0f;  // above 680 DN of the reference: wrong
  frame(0, 0) = std::numeric_limits<float>::quiet_NaN();
  const auto found = relative_intensity(frame, reference, 0, 670);
  ASSERT_TRUE(found.decided());
  EXPECT_NEAR(found->value, 1.0, 1e-9);
  EXPECT_FALSE(relative_intensity(frame, reference, 5000, 6000).decided());
}

TEST(ClippedShare, CountsFromALittleBelowWhite) {
  Image reference(10, 10);
  reference(0, 0) = 979;
  reference(0, 1) = 981;
  reference(0, 2) = 1000;
  reference(0, 3) = std::numeric_limits<float>::quiet_NaN();
  EXPECT_DOUBLE_EQ(clipped_share(reference, 1000), 0.02);
  EXPECT_DOUBLE_EQ(clipped_share(reference, 1100), 0.0);
}

TEST(MarkUnknown, LeavesWhatTellsTheLight) {
  Image reference(2, 4);
  reference(0, 0) = 979;
  reference(0, 1) = 981;
  reference(0, 2) = -30;
  reference(0, 3) = std::numeric_limits<float>::infinity();
  reference(1, 1) = 500;
  const DefectList defects{2, 4, {{1, 1}, {0, 1}}}, of_another_size{4, 4, {{1, 1}}};
  Image spoiled = reference;
  EXPECT_EQ(mark_unknown(spoiled, 1000, defects), 3);
  EXPECT_TRUE(std::isnan(spoiled(0, 1)) && std::isnan(spoiled(1, 1)));
  EXPECT_EQ(spoiled(0, 0), 979);
  EXPECT_EQ(spoiled(0, 2), -30);
  Image clipped = reference;
  EXPECT_EQ(mark_unknown(clipped, 1000, of_another_size), 2);
  EXPECT_EQ(clipped(1, 1), 500);
  EXPECT_DOUBLE_EQ(clipped_share(reference, 1000), 2.0 / 8);  // what else is unknown was finite
}

TEST(LightOfReference, IsWithoutBiasAndOverTheRatio) {
  const NoiseModel model = load_model("imx250mzr-simulated");
  const GainSetting gain{.gain_db = 24, .iso = {}};
  const NoiseProfile bias = model.profile_at(gain);
  ASSERT_NE(bias.channels[0].bias_dn, bias.channels[1].bias_dn);
  Image reference(4, 4, 100.0f);
  reference(3, 3) = std::numeric_limits<float>::quiet_NaN();
  const Image held = light_of_reference(reference, 8, &model, gain),
              none_held = light_of_reference(reference, 8, &model),
              not_known = light_of_reference(reference, 8, nullptr, gain);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) {
      if (r == 3 && c == 3) continue;
      const auto k = static_cast<std::size_t>(bias.layout.channel_at(r, c));
      EXPECT_FLOAT_EQ(held(r, c), static_cast<float>((100 - bias.channels[k].bias_dn) / 8));
      EXPECT_EQ(none_held(r, c), 12.5f);
      EXPECT_EQ(not_known(r, c), 12.5f);
    }
  EXPECT_TRUE(std::isnan(held(3, 3)));
}

TEST(GainRatio, IsMeasuredWhereProfilesHoldGains) {
  NoiseProfile one, other;
  one.channels.resize(2);
  other.channels.resize(2);
  one.channels[0].gain_dn_per_e = 3;
  one.channels[1].gain_dn_per_e = 5;
  other.channels[0].gain_dn_per_e = 1;
  other.channels[1].gain_dn_per_e = 1.5;
  ASSERT_TRUE(gain_ratio(one, other).has_value());
  EXPECT_DOUBLE_EQ(*gain_ratio(one, other), 3.2);
  other.channels[0].gain_dn_per_e = other.channels[1].gain_dn_per_e = 0;
  EXPECT_FALSE(gain_ratio(one, other).has_value());
  EXPECT_FALSE(gain_ratio(other, one).has_value());
}

TEST(GainRatio, OfDecibelsIsOfAmplitudes) {
  const GainSetting none, six{6.0, {}}, twenty_six{26.0, {}};
  EXPECT_DOUBLE_EQ(gain_ratio(twenty_six, six), 10);
  EXPECT_DOUBLE_EQ(gain_ratio(six, twenty_six), 0.1);
  EXPECT_DOUBLE_EQ(gain_ratio(none, six), 1);
  EXPECT_DOUBLE_EQ(gain_ratio(six, none), 1);
}

}  // namespace
}  // namespace malus
