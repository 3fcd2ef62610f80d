// Columns that are lifted by offsets of known size. Truth: draws of fixed seeds.
#include "malus/denoise/column_noise.h"

#include "malus/base/random.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/frame_profile.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kReadDn = 3.0, kGainDnPerE = 0.5;
constexpr float kLargestDn = 4000;

NoiseProfile striped_profile(const char* layout, double sigma_row_dn, double sigma_column_dn) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named(layout);
  for (int k = 0; k < profile.layout.channels(); ++k) {
    ChannelProfile channel;
    channel.variance = VarianceCurve::affine(kGainDnPerE, kReadDn * kReadDn);
    channel.sigma_row_dn = sigma_row_dn;
    channel.sigma_column_dn = sigma_column_dn * (1 + 0.02 * k);
    profile.channels.push_back(channel);
  }
  return profile;
}

struct StripedFrame {
  Image dn;
  std::vector<double> row, column;  ///< offsets in deviations
};

StripedFrame striped_frame(const NoiseProfile& profile, const Image& clean,
                           std::uint64_t seed = 5) {
  StripedFrame out{clean, {}, {}};
  RandomSequence rows(seed, 0, Draw::kRow), columns(seed, 1, Draw::kRow),
      pixels(seed, 0, Draw::kPixel);
  for (int r = 0; r < clean.rows(); ++r) out.row.push_back(rows.normal());
  for (int c = 0; c < clean.cols(); ++c) out.column.push_back(columns.normal());
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c) {
      const ChannelProfile& channel =
          profile.channels[static_cast<std::size_t>(profile.layout.channel_at(r, c))];
      out.dn(r, c) +=
          static_cast<float>(std::sqrt(channel.variance(clean(r, c))) * pixels.normal() +
                             channel.sigma_row_dn * out.row[static_cast<std::size_t>(r)] +
                             channel.sigma_column_dn * out.column[static_cast<std::size_t>(c)]);
    }
  return out;
}

std::vector<float> white_of(const NoiseProfile& profile) {
  return std::vector<float>(profile.channels.size(), kLargestDn);
}

double root_mean_square(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

// Column noise of the read noise's size and a third of it, in frames with row noise. What is stated
// of 500 offsets whose errors are alike over tens of columns is true to a quarter (as of rows).
TEST(ColumnNoise, OffsetsAreFoundToTheDeviationThatIsStated) {
  for (const char* layout : {"polar-bayer-rggb", "polar-mono", "bayer-rggb", "mono"})
    for (const double sigma_dn : {1.0, 3.0}) {
      const NoiseProfile profile = striped_profile(layout, 2.0, sigma_dn);
      const StripedFrame truth = striped_frame(profile, Image(602, 500, 30.0f));
      const RowNoise columns = estimate_column_noise(truth.dn, profile, white_of(profile));
      ASSERT_EQ(columns.offset.size(), 500u);
      double stated = 0;
      for (const double deviation : columns.deviation) stated += deviation * deviation / 500;
      const double error = root_mean_square(columns.offset, truth.column);
      EXPECT_NEAR(error / std::sqrt(stated), 1.0, 0.25) << layout << sigma_dn;
      EXPECT_LT(error, sigma_dn > 2 ? 0.25 : 0.4) << layout;  // 1 before
    }
}

TEST(ColumnNoise, IsTheRowsEstimateOfTheExchangedFrame) {
  const NoiseProfile columns = striped_profile("mono", 0, 2.0),
                     rows = striped_profile("mono", 2.0, 0);
  const Image dn = striped_frame(columns, Image(131, 203, 30.0f)).dn;
  Image exchanged(dn.cols(), dn.rows());
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) exchanged(c, r) = dn(r, c);
  const RowNoise found = estimate_column_noise(dn, columns, white_of(columns)),
                 wanted = estimate_row_noise(exchanged, rows, white_of(rows));
  EXPECT_EQ(found.offset, wanted.offset);
  EXPECT_EQ(found.deviation, wanted.deviation);
}

// An offset cancels in differences along its own line, but for rounding to single precision.
TEST(ColumnNoise, RowsAndColumnsAreFoundApart) {
  const NoiseProfile profile = striped_profile("polar-mono", 3.0, 3.0);
  StripedFrame both = striped_frame(profile, Image(300, 260, 0.0f));
  Image rows_alone = both.dn, columns_alone = both.dn;
  for (int r = 0; r < both.dn.rows(); ++r)
    for (int c = 0; c < both.dn.cols(); ++c) {
      const auto k = static_cast<std::size_t>(profile.layout.channel_at(r, c));
      const auto row = 3.0 * both.row[static_cast<std::size_t>(r)],
                 column =
                     profile.channels[k].sigma_column_dn * both.column[static_cast<std::size_t>(c)];
      rows_alone(r, c) -= static_cast<float>(column);
      columns_alone(r, c) -= static_cast<float>(row);
    }
  // Below zero light the variance is the same for all: nothing else tells the frames apart.
  for (Image* dn : {&both.dn, &rows_alone, &columns_alone})
    for (float& v : dn->values()) v -= 60;
  const std::vector<float> white = white_of(profile);
  EXPECT_LT(root_mean_square(estimate_row_noise(both.dn, profile, white).offset,
                             estimate_row_noise(rows_alone, profile, white).offset),
            1e-5);
  EXPECT_LT(root_mean_square(estimate_column_noise(both.dn, profile, white).offset,
                             estimate_column_noise(columns_alone, profile, white).offset),
            1e-5);
}

TEST(ColumnNoise, StripesOfThePictureStay) {
  constexpr double kPi = 3.14159265358979;
  const NoiseProfile profile = striped_profile("polar-bayer-rggb", 0, 1.0);
  Image clean(600, 400, 30.0f);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c)
      clean(r, c) += static_cast<float>(5 * std::sin(2 * kPi * c / 21.3));
  const RowNoise columns =
      estimate_column_noise(striped_frame(profile, clean).dn, profile, white_of(profile));
  double taken = 0;  // along the stripes, 5 is all of them
  for (int c = 0; c < 400; ++c)
    taken += columns.offset[static_cast<std::size_t>(c)] * std::sin(2 * kPi * c / 21.3) / 200;
  EXPECT_LT(std::abs(taken), 1.0);
}

// Edges down the whole picture, 16 to 28 columns apart, that lift columns by two and a half of the
// camera's deviations: no column stands out, but neighbours are alike.
TEST(ColumnNoise, FaintEdgesOfThePictureAreNotTakenForIt) {
  for (const char* layout : {"polar-bayer-rggb", "polar-mono", "bayer-rggb"}) {
    const NoiseProfile profile = striped_profile(layout, 0, 2.0);
    Image clean(512, 640, 200.0f);
    for (int c = 0, edge = 16, lifted = 0; c < clean.cols(); ++c) {
      if (c == edge) {
        lifted = !lifted;
        edge += 16 + c * 7 % 13;
      }
      for (int r = 0; r < clean.rows(); ++r) clean(r, c) += lifted ? 5.0f : 0.0f;
    }
    const StripedFrame truth = striped_frame(profile, clean);
    const RowNoise columns = estimate_column_noise(truth.dn, profile, white_of(profile));
    double stated = 0;
    for (const double deviation : columns.deviation) stated += deviation * deviation / 640;
    const double error = root_mean_square(columns.offset, truth.column);
    EXPECT_LT(error, 1.0) << layout;  // 1: that of taking nothing off
    EXPECT_LT(error / std::sqrt(stated), 1.25) << layout;
  }
}

TEST(ColumnNoise, RemovalSubtractsTheChannelsOwnShareAndLeavesSaturatedPixels) {
  const NoiseProfile profile = striped_profile("bayer-rggb", 0, 2.0);
  Image dn(2, 3, 100.0f);
  dn(1, 0) = kLargestDn;
  remove_column_noise(dn, profile, RowNoise{{1.0, -0.5, 2.0}, {1, 1, 1}},
                      SaturatedPixels(dn, profile.layout, white_of(profile)));
  EXPECT_NEAR(dn(0, 0), 98, 1e-4);
  EXPECT_NEAR(dn(0, 1), 100 + 0.5 * 2 * 1.02, 1e-4);
  EXPECT_NEAR(dn(0, 2), 96, 1e-4);
  EXPECT_EQ(dn(1, 0), kLargestDn);
  EXPECT_NEAR(dn(1, 1), 100 + 0.5 * 2 * 1.06, 1e-4);
}

RawFrame raw_of(const NoiseProfile& profile, Image dn) {
  RawFrame frame;
  frame.layout = profile.layout;
  frame.black_dn.assign(profile.channels.size(), 0.0);
  frame.white_dn = kLargestDn;
  frame.white_known = true;
  frame.source = "test";
  frame.dn = std::move(dn);
  return frame;
}

struct ErrorOfFrame {
  double squared = 0, stated = 0;
};

ErrorOfFrame error_of(const Denoised& result, const Image& clean) {
  ErrorOfFrame out;
  const auto pixels = static_cast<double>(clean.size());
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c) {
      out.squared += std::pow(double{result.dn_above_black(r, c)} - clean(r, c), 2) / pixels;
      out.stated += (*result.variance_dn2)(r, c) / pixels;
    }
  return out;
}

TEST(ColumnNoise, WhatIsLeftOfItIsStated) {
  const NoiseProfile profile = striped_profile("polar-mono", 0, 3.0);
  const Image clean(256, 256, 50.0f);
  const Image dn = striped_frame(profile, clean).dn;
  for (const char* method : {"nl-ridge", "bm3d"}) {
    const auto denoised = [&](bool removed) {
      return denoise_frame(raw_of(profile, dn), profile,
                           {.method = method, .column_noise = removed}, silent_progress(), true);
    };
    const Denoised with = denoised(true), without = denoised(false);
    const ErrorOfFrame removed = error_of(with, clean), left = error_of(without, clean);
    EXPECT_GT(left.squared, 6) << method;  // of 9; 256 draws, and the filter takes some
    EXPECT_NEAR(std::sqrt(left.squared / left.stated), 1, 0.25) << method;
    EXPECT_LT(removed.squared, 0.2 * left.squared) << method;
    EXPECT_LT(removed.squared / removed.stated, 1.5) << method;
    EXPECT_NEAR(with.column_noise_removed_dn, 3, 0.6) << method;
    EXPECT_EQ(without.column_noise_removed_dn, 0) << method;
  }
}

TEST(ColumnNoise, NothingChangesWithoutItInTheModel) {
  const NoiseProfile profile = striped_profile("polar-mono", 2.0, 0);
  const Image dn = striped_frame(profile, Image(96, 96, 50.0f)).dn;
  const auto denoised = [&](bool removed) {
    return denoise_frame(raw_of(profile, dn), profile, {.profile = "fast", .column_noise = removed},
                         silent_progress(), true);
  };
  const Denoised with = denoised(true), without = denoised(false);
  EXPECT_TRUE(std::ranges::equal(with.dn_above_black.values(), without.dn_above_black.values()));
  EXPECT_TRUE(std::ranges::equal(with.variance_dn2->values(), without.variance_dn2->values()));
  EXPECT_EQ(with.column_noise_removed_dn, 0);
}

// Of a calibration that found the read noise to be half column noise.
NoiseModel striped_model() {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  model.black_dn.assign(4, 0.0);
  model.white_dn = kLargestDn;
  model.quantization_dn = 0;
  PhysicsCalibration p;
  p.gain.gain_db = 0;
  p.K.mean.assign(4, kGainDnPerE);
  p.lambda.mean.assign(4, 0.14);
  p.mu.mean.assign(4, 0.0);
  p.sigma_tl.mean.assign(4, 1.0);
  const double shape = read_noise_dn(p).front();
  p.sigma_tl.mean.assign(4, std::sqrt(2.0) * kReadDn / shape);
  p.sigma_column.mean.assign(4, kReadDn);
  p.sigma_column.standard_error.assign(4, 0.01 * kReadDn);
  model.physics.push_back(p);
  return model;
}

// A frame of synthesis holds the columns' variance in its pixels: for it the profile must say so.
TEST(ColumnNoise, IsToldApartWhereTheFrameShowsIt) {
  const NoiseModel model = striped_model();
  const GainSetting gain{0.0, {}};
  const NoiseProfile apart = striped_profile("polar-mono", 0, kReadDn);
  Image waves(256, 256);
  for (int r = 0; r < waves.rows(); ++r)
    for (int c = 0; c < waves.cols(); ++c)
      waves(r, c) = static_cast<float>(30 + 20 * std::sin(0.05 * r) * std::cos(0.04 * c));
  const NoiseProfile real =
      denoising_profile(raw_of(apart, striped_frame(apart, waves).dn), model, gain);
  NoiseProfile in_pixels = striped_profile("polar-mono", 0, 0);
  for (ChannelProfile& channel : in_pixels.channels)
    channel.variance = VarianceCurve::affine(kGainDnPerE, 2 * kReadDn * kReadDn);
  const NoiseProfile drawn =
      denoising_profile(raw_of(apart, striped_frame(in_pixels, waves).dn), model, gain);
  for (std::size_t k = 0; k < 4; ++k) {
    EXPECT_NEAR(real.channels[k].sigma_column_dn, kReadDn, 1e-9);
    EXPECT_NEAR(real.channels[k].variance(0), kReadDn * kReadDn, 1e-9);
    EXPECT_EQ(drawn.channels[k].sigma_column_dn, 0);
    EXPECT_NEAR(drawn.channels[k].variance(0), 2 * kReadDn * kReadDn, 1e-9);
  }
  // Too few columns tell nothing: the calibration is believed.
  EXPECT_TRUE(
      denoising_profile(raw_of(apart, Image(256, 40, 30.0f)), model, gain).has_column_noise());
}

// What the profile of synthesis leaves in, frame_profile's takes out.
TEST(ColumnNoise, IsTakenOutWithTheFramesProfile) {
  const NoiseModel model = striped_model();
  const GainSetting gain{0.0, {}};
  Image waves(256, 256);
  for (int r = 0; r < waves.rows(); ++r)
    for (int c = 0; c < waves.cols(); ++c)
      waves(r, c) = static_cast<float>(40 + 20 * std::sin(r / 37.0) + 15 * std::cos(c / 51.0));
  const NoiseProfile camera = striped_profile("polar-mono", 0, kReadDn);
  const RawFrame frame = raw_of(camera, striped_frame(camera, waves).dn);
  const auto squared_error = [&](const NoiseProfile& profile) {
    return error_of(denoise_frame(frame, profile, {}, silent_progress(), true), waves).squared;
  };
  const FrameProfile made = frame_profile(frame, model, gain);
  EXPECT_EQ(made.left_out, "");
  EXPECT_LT(squared_error(made.profile), 0.25 * squared_error(model.profile_at(gain)));
}

// As of a camera whose picture fills only a part of its frame: what fills the rest is no row's or
// column's, and measures nothing.
TEST(ColumnNoise, HolesTakeNoPartInOffsets) {
  const NoiseProfile profile = striped_profile("polar-mono", 2.0, 2.0);
  RawFrame frame;
  frame.layout = profile.layout;
  frame.black_dn.assign(profile.channels.size(), 0.0);
  frame.white_dn = kLargestDn;
  frame.white_known = true;
  frame.dn = striped_frame(profile, Image(256, 256, 30.0f)).dn;
  const Denoised whole = denoise_frame(frame, profile, {.profile = "fast"});
  const auto corner = [](int r, int c) { return r < 128 && c < 128; };
  for (int r = 0; r < 256; ++r)
    for (int c = 0; c < 256; ++c)
      if (!corner(r, c)) frame.dn(r, c) = std::numeric_limits<float>::quiet_NaN();
  const Denoised part = denoise_frame(frame, profile, {.profile = "fast"});
  // Half of the rows and columns are known.
  EXPECT_GT(part.row_noise_removed_dn, 0.6 * whole.row_noise_removed_dn);
  EXPECT_GT(part.column_noise_removed_dn, 0.6 * whole.column_noise_removed_dn);
  double whole_error = 0, part_error = 0;
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 128; ++c) {
      whole_error += std::pow(whole.dn_above_black(r, c) - 30, 2);
      part_error += std::pow(part.dn_above_black(r, c) - 30, 2);
    }
  EXPECT_LT(part_error, 2 * whole_error);
  for (const double mean_dn : part.mean_dn) EXPECT_NEAR(mean_dn, 30, 1);
}

}  // namespace
}  // namespace malus
