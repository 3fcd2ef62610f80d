#include "malus/denoise/row_noise.h"

#include "malus/base/random.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

struct Simulated {
  Image dn;
  std::vector<double> offset;
};

NoiseProfile profile_with(double sigma_row_dn, double slope_dn) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("polar-bayer-rggb");
  profile.row_group = 2;
  for (int k = 0; k < 16; ++k) {
    ChannelProfile channel;
    channel.variance = VarianceCurve::affine(slope_dn, 14.0);
    channel.sigma_row_dn = sigma_row_dn * (k < 8 ? 1.0 : 1.1);
    profile.channels.push_back(channel);
  }
  return profile;
}

Simulated simulate(const NoiseProfile& profile, int rows, int cols, bool picture) {
  Simulated result{Image(rows, cols), {}};
  RandomSequence draws(11, 0, Draw::kRow), pixels(11, 0, Draw::kPixel);
  for (int g = 0; g < rows / profile.row_group; ++g) result.offset.push_back(draws.normal());
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const auto& channel =
          profile.channels[static_cast<std::size_t>(profile.layout.channel_at(r, c))];
      const double clean =
          picture ? 60 + 40 * std::sin(0.11 * r + 0.05 * c) + (r > rows / 2 ? 50 : 0) : 30;
      result.dn(r, c) = static_cast<float>(
          clean + std::sqrt(channel.variance(clean)) * pixels.normal() +
          channel.sigma_row_dn * result.offset[static_cast<std::size_t>(r / profile.row_group)]);
    }
  return result;
}

const std::vector<float> kSaturatedDn(16, 4000.0f);

double rms_error(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(RowNoise, OffsetsAreFoundWithTheirDeviation) {
  const NoiseProfile profile = profile_with(1.0, 1.5);
  const Simulated truth = simulate(profile, 400, 600, false);
  const RowNoise rows = estimate_row_noise(truth.dn, profile, kSaturatedDn);
  ASSERT_EQ(rows.offset.size(), 200u);
  // 1200 pixels of 7.7 DN: 0.22 of the offsets' deviation is the floor.
  EXPECT_LT(rms_error(rows.offset, truth.offset), 0.45);
}

TEST(RowNoise, APictureIsNotTakenForRows) {
  const NoiseProfile profile = profile_with(1.0, 1.5);
  const Simulated truth = simulate(profile, 400, 600, true);
  const RowNoise rows = estimate_row_noise(truth.dn, profile, kSaturatedDn);
  // The waves lift rows by 0.7 DN against their neighbours, two thirds of the noise.
  EXPECT_LT(rms_error(rows.offset, truth.offset), 0.92);
  // The row beside the horizontal edge of 50 DN must not be lifted by more than the model's rows.
  for (const double offset : rows.offset) EXPECT_LT(std::abs(offset), 3.5);
}

TEST(RowNoise, RowsStrongerThanTheModelSaysAreStillRemoved) {
  const Simulated truth = simulate(profile_with(1.6, 1.5), 400, 600, false);
  const RowNoise rows = estimate_row_noise(truth.dn, profile_with(1.0, 1.5), kSaturatedDn);
  std::vector<double> drawn_dn = truth.offset;
  for (double& offset : drawn_dn) offset *= 1.6;
  // 1.6 DN is what was there.
  EXPECT_LT(rms_error(rows.offset, drawn_dn), 0.6);
}

// Stripes of three and a half of the model's deviations, equal along each row: nothing but their
// size tells them from row noise.
TEST(RowNoise, LevelStripesAreLeftInThePicture) {
  const NoiseProfile profile = profile_with(1.0, 1.5);
  Simulated frame = simulate(profile, 400, 600, false);
  for (int r = 0; r < 400; ++r)
    for (int c = 0; c < 600; ++c)
      frame.dn(r, c) += static_cast<float>(5 * std::sin(2 * 3.14159265358979 * r / 21.3));
  const RowNoise rows = estimate_row_noise(frame.dn, profile, kSaturatedDn);
  double taken = 0;  // along the stripes, 5 is all of them
  for (int g = 0; g < 200; ++g)
    taken += rows.offset[static_cast<std::size_t>(g)] *
             std::sin(2 * 3.14159265358979 * (2 * g + 0.5) / 21.3) / 100;
  EXPECT_LT(std::abs(taken), 1.0);
}

TEST(RowNoise, StripesThatDwarfTheNoiseAreNoRowNoise) {
  NoiseProfile profile = profile_with(0.0, 1.5);
  Simulated frame = simulate(profile, 600, 600, false);
  for (int r = 0; r < 600; ++r)
    for (int c = 0; c < 600; ++c)
      frame.dn(r, c) += static_cast<float>(40 * std::sin(2 * 3.14159265358979 * r / 21.3));
  estimate_row_deviation(frame.dn, kSaturatedDn, profile);
  EXPECT_EQ(profile.channels[0].sigma_row_dn, 0.0);
}

TEST(RowNoise, NothingWithoutRowNoiseInTheModel) {
  const Simulated truth = simulate(profile_with(1.0, 1.5), 64, 64, false);
  for (const double offset :
       estimate_row_noise(truth.dn, profile_with(0.0, 1.5), kSaturatedDn).offset)
    EXPECT_EQ(offset, 0.0);
}

TEST(RowNoise, RemovalSubtractsTheChannelsOwnShareAndLeavesSaturatedPixels) {
  const NoiseProfile profile = profile_with(2.0, 1.5);
  Image dn(4, 4, 100.0f);
  dn(0, 0) = 4000;
  dn(0, 1) = 3990;  // the next channel saturates earlier
  dn(1, 0) = 3990;
  std::vector<float> saturated_dn = kSaturatedDn;
  saturated_dn[1] = 3985;
  remove_row_noise(dn, profile, RowNoise{{1.0, -0.5}, {1, 1}},
                   SaturatedPixels(dn, profile.layout, saturated_dn));
  EXPECT_EQ(dn(0, 0), 4000.0f);
  EXPECT_EQ(dn(0, 1), 3990.0f);
  EXPECT_NEAR(dn(1, 0), 3988.0f, 1e-3);
  EXPECT_NEAR(dn(1, 1), 98.0f, 1e-4);
  EXPECT_NEAR(dn(2, 1), 101.1f, 1e-4);
}

TEST(RowNoise, DeviationAndGroupFromThePicture) {
  NoiseProfile profile = profile_with(1.5, 1.5);
  const Simulated truth = simulate(profile, 600, 600, false);
  NoiseProfile unknown = profile_with(0.0, 1.5);
  unknown.row_group = 1;
  estimate_row_deviation(truth.dn, kSaturatedDn, unknown);
  EXPECT_EQ(unknown.row_group, 2);
  EXPECT_NEAR(unknown.channels[0].sigma_row_dn, 1.5, 0.25);
}

}  // namespace
}  // namespace malus
