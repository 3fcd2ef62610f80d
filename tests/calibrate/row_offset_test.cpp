// Offsets of rows whose pixels have noise of unlike width, and the levels measured in such rows.
#include "malus/calibrate/internal/row_offset.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"

#include <cmath>
#include <limits>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Sixteen values from dark to bright, their variances expected right or a factor two wrong, offsets
// known to be there, to be absent, or not known at all. 20000 groups: a mean square of 2 v²/20000
// has a relative standard error of 1 %.
TEST(RowOffset, SquaresAreUnbiasedAndResidualsKeepTheirVariance) {
  constexpr int kValues = 16, kGroups = 20000;
  for (const double row : {0.0, 1.5})
    for (const double wrong : {1.0, 2.0})
      for (const bool known : {true, false}) {
        RandomSequence random(3, 0, Draw::kOther);
        RowOffset offset(known ? row * row : std::numeric_limits<double>::infinity());
        std::vector<double> variance(kValues), expected(kValues), value(kValues);
        for (std::size_t i = 0; i < kValues; ++i) {
          variance[i] = 4.0 + 30.0 * static_cast<double>(i);
          expected[i] = variance[i] * (i % 2 ? wrong : 1.0);
        }
        std::vector<Moments> square(kValues), residual(kValues);
        for (int group = 0; group < kGroups; ++group) {
          const double common = row * random.normal();
          for (std::size_t i = 0; i < kValues; ++i)
            value[i] = common + std::sqrt(variance[i]) * random.normal();
          offset.fit(value, expected);
          for (std::size_t i = 0; i < kValues; ++i) {
            square[i].add(offset.square_dn2(i) / variance[i]);
            residual[i].add(offset.residual_dn(i) / std::sqrt(variance[i]));
          }
        }
        for (std::size_t i = 0; i < kValues; ++i) {
          EXPECT_NEAR(square[i].mean(), 1.0, 4.5 * std::sqrt(square[i].variance() / kGroups))
              << i << " " << row << " " << wrong << " " << known;
          // With the expected variances' error only to second order.
          EXPECT_NEAR(residual[i].variance(), 1.0, wrong > 1 ? 0.2 : 0.045)
              << i << " " << row << " " << wrong << " " << known;
          if (wrong == 1.0) {
            EXPECT_NEAR(square[i].variance() * offset.freedom(i), 2.0, 0.3)
                << i << " " << row << " " << known;
          }
        }
      }
}

TEST(RowOffset, WithoutRowNoiseNothingIsTakenOff) {
  RowOffset offset(0.0);
  offset.fit({3.0, -1.0, 40.0}, {1.0, 2.0, 500.0});
  EXPECT_EQ(offset.raw_dn(0), 3.0);
  EXPECT_EQ(offset.residual_dn(2), 40.0);
  EXPECT_EQ(offset.square_dn2(1), 1.0);
}

// Two values: the old formula, of equal variances.
TEST(RowOffset, TwoValuesShareTheirVariance) {
  RowOffset offset(std::numeric_limits<double>::infinity());
  offset.fit({3.0, -1.0}, {1.0, 1.0});
  EXPECT_NEAR(offset.square_dn2(0), 8.0, 1e-9);
  EXPECT_NEAR(offset.residual_dn(1), -std::sqrt(8.0), 1e-9);
}

// A burst of a ramp along the rows or down the columns: the darkest levels were 34 % too wide along
// the rows. Their 20000 samples have a relative standard error of 1 %.
TEST(RowOffset, DarkPixelsKeepTheirNoiseBesideBrightOnesOfTheirRow) {
  testing::SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 20;
  camera.flat_levels = 0;
  camera.dsnu_dn = 0;
  camera.gains.push_back(testing::polar_gain(0, "mono", 1));
  for (const double row : {0.0, 0.8})
    for (const bool along : {false, true}) {
      PhysicsNoise& noise = camera.gains.front().noise;
      noise.channels[0] = {
          .gain_dn_per_e = 0.6, .lambda = 0.14, .sigma_tl_dn = 1.4, .sigma_row_dn = row};
      CalibrationInput input = testing::simulated_session(camera);
      FrameSet burst = input.sets.front();
      burst.kind = FrameKind::kBurst;
      burst.count = 160;
      burst.load = [along, noise](int i) {
        RawFrame out;
        out.black_dn = {80};
        out.white_dn = 4095;
        out.dn = Image(128, 128);
        for (int r = 0; r < 128; ++r)
          for (int c = 0; c < 128; ++c)
            out.dn(r, c) = static_cast<float>(3500.0 / 127 * (along ? c : r));
        add_noise_exact(noise, out.dn, out.dn, DrawAddress{5, static_cast<std::uint32_t>(i), 0, 0});
        for (float& v : out.dn.values()) v = std::round(v + 80);
        return out;
      };
      input.sets.push_back(burst);
      const NoiseModel model =
          calibrate(input, {.level_samples = 5000},
                    {ModelKind::kPhysics, ModelKind::kNonparametric}, silent_progress());
      const NonparametricChannel& channel = model.nonparametric.at(0).channels.at(0);
      for (std::size_t level = 1; level < 8; ++level) {
        const double truth = pixel_variance_dn2(noise.channels[0], channel.level_dn[level], 1.0);
        EXPECT_NEAR(level_moments(channel, level).variance_dn2, truth,
                    truth * (4.5 * std::sqrt(2.0 / static_cast<double>(channel.samples[level]))))
            << channel.level_dn[level] << " " << row << " " << along;
      }
    }
}

}  // namespace
}  // namespace malus
