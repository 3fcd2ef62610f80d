// The pipeline around the noise: ratio, bias removal, amplification, switches, rounding; and the
// kinds beside physics.
#include "malus/synthesize/synthesizer.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "bayer_model.h"
#include "sample_moments.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::bayer_model;
using testing::kGain;
using testing::kSigmas;

double mean_of_image(const Image& image) {
  return std::accumulate(image.values().begin(), image.values().end(), 0.0) /
         static_cast<double>(image.size());
}

TEST(Synthesizer, RatioDimsAndAmplifyBringsTheMeanBack) {
  const Image clean(300, 400, 1000.0f);
  SynthesisSettings settings;
  settings.ratio = 10;
  settings.debias = true;
  for (const bool exact : {false, true}) {
    settings.exact = exact;
    settings.amplify = false;
    const Synthesizer dim(bayer_model(), settings);
    const auto frame = dim.draw(clean, kGain, {.seed = 1});
    // Signal 100 DN, shot variance about 105 DN², rows 0.65 DN over 150 groups.
    const double error = kSigmas * std::sqrt(105.0 / 120000 + 0.43 / 150);
    EXPECT_NEAR(mean_of_image(frame.dn), 100.0, error);
    EXPECT_DOUBLE_EQ(frame.global_bias_dn, -5.5);
    settings.amplify = true;
    const auto bright = Synthesizer(bayer_model(), settings).draw(clean, kGain, {.seed = 1});
    for (std::size_t i = 0; i < bright.dn.size(); ++i)
      ASSERT_NEAR(bright.dn.values()[i], 10.0f * frame.dn.values()[i], 1e-3);
  }
}

TEST(Synthesizer, DebiasTakesOnlyTheGlobalBias) {
  SynthesisSettings settings;
  settings.shot = settings.read = settings.row = settings.quantization = false;
  const Image clean(4, 4, 10.0f);
  const auto with = Synthesizer(bayer_model(), settings).draw(clean, kGain, {});
  EXPECT_FLOAT_EQ(with.dn(0, 0), 6.0f);
  EXPECT_FLOAT_EQ(with.dn(1, 1), 3.0f);
  settings.debias = true;
  const auto without = Synthesizer(bayer_model(), settings).draw(clean, kGain, {});
  EXPECT_FLOAT_EQ(without.dn(0, 0), 11.5f);
  EXPECT_FLOAT_EQ(without.dn(1, 1), 8.5f);
  settings.bias = false;
  const auto none = Synthesizer(bayer_model(), settings).draw(clean, kGain, {});
  EXPECT_FLOAT_EQ(none.dn(0, 0), 10.0f);
}

TEST(Synthesizer, SampledParametersVaryFromFrameToFrameAndMeanOnesDoNot) {
  SynthesisSettings settings;
  settings.shot = settings.read = settings.row = settings.quantization = false;
  const Image clean(2, 2);
  const Synthesizer sampled(bayer_model(0.3), settings);
  Moments m;
  for (std::uint32_t f = 0; f < 2000; ++f)
    m.add(static_cast<double>(sampled.draw(clean, kGain, {.seed = 2, .frame = f}).dn(0, 0)));
  EXPECT_NEAR(m.mean(), -4.0, kSigmas * 0.3 / std::sqrt(2000));
  EXPECT_NEAR(m.variance(), 0.09, kSigmas * m.variance_standard_error());
  settings.parameters = "mean";
  const Synthesizer fixed(bayer_model(0.3), settings);
  EXPECT_FLOAT_EQ(fixed.draw(clean, kGain, {.frame = 1}).dn(0, 0), -4.0f);
}

TEST(Synthesizer, RawIsRoundedOnceAndClipped) {
  SynthesisSettings settings;
  const Synthesizer synthesizer(bayer_model(), settings);
  Image clean(64, 64, 20.0f);
  for (int c = 0; c < 64; ++c) clean(0, c) = 5000.0f, clean(2, c) = -500.0f;
  const RawFrame raw = synthesizer.draw_raw(clean, kGain, {.seed = 4}, {64, 64, 64, 64}, 4095);
  for (const float v : raw.dn.values()) ASSERT_EQ(v, std::round(v));
  for (int c = 0; c < 64; ++c) {
    ASSERT_EQ(raw.dn(0, c), 4095.0f);
    ASSERT_EQ(raw.dn(2, c), 0.0f);
  }
  // Rounding is the quantisation noise: shot, read and 1/12, not 2/12.
  SynthesisSettings dark = settings;
  dark.row = dark.shot = false;
  const Synthesizer quiet(bayer_model(), dark);
  const Image zero(600, 600);
  const RawFrame bias = quiet.draw_raw(zero, kGain, {.seed = 5}, {64, 64, 64, 64}, 4095);
  Moments m;
  for (int r = 0; r < 600; r += 2)
    for (int c = 0; c < 600; c += 2) m.add(static_cast<double>(bias.dn(r, c)));
  EXPECT_NEAR(m.mean(), 60.0, kSigmas * std::sqrt(m.variance() / 90000));
  EXPECT_NEAR(m.variance(), tukey_lambda_variance(0.1) + 1.0 / 12,
              kSigmas * m.variance_standard_error());
}

TEST(Synthesizer, AmplifiedRawKeepsBlackAndScalesWhite) {
  SynthesisSettings settings;
  settings.ratio = 4;
  settings.amplify = settings.debias = true;
  settings.shot = settings.read = settings.row = settings.bias = false;
  const Image clean(4, 4, 400.0f);
  const RawFrame raw =
      Synthesizer(bayer_model(), settings).draw_raw(clean, kGain, {}, {64, 64, 64, 64}, 1000);
  for (const float v : raw.dn.values()) ASSERT_EQ(v, 4 * 64 + 400.0f);
  EXPECT_EQ(raw.black_dn, std::vector<double>(4, 4 * 64.0));
  EXPECT_DOUBLE_EQ(raw.white_dn, 4 * 1000.0);
  settings.amplify = false;  // nothing is multiplied
  const RawFrame dim =
      Synthesizer(bayer_model(), settings).draw_raw(clean, kGain, {}, {64, 64, 64, 64}, 1000);
  EXPECT_EQ(dim.black_dn, std::vector<double>(4, 64));
  settings.amplify = true;
  settings.ratio = 1000;  // black takes a quarter of 16 bits at most
  const RawFrame far =
      Synthesizer(bayer_model(), settings).draw_raw(clean, kGain, {}, {64, 64, 64, 64}, 1000);
  EXPECT_EQ(far.black_dn, std::vector<double>(4, 16384));
  EXPECT_DOUBLE_EQ(far.white_dn, 65535);
}

// The bias of -5.5 DN is no whole code: it goes into black, and white stays where codes saturate.
TEST(Synthesizer, DebiasedRawHoldsTheBiasInItsBlack) {
  SynthesisSettings settings;
  const Image clean(8, 8, 5000.0f);
  const auto drawn = [&](double black_dn, double bright) {
    Image light = clean;
    for (int c = 0; c < 8; ++c) light(0, c) = static_cast<float>(bright);
    return Synthesizer(bayer_model(), settings)
        .draw_raw(light, kGain, {.seed = 4}, std::vector<double>(4, black_dn), 4095);
  };
  const RawFrame plain = drawn(64, 900), low = drawn(2, 900);
  settings.debias = true;
  const RawFrame raw = drawn(64, 900);
  EXPECT_EQ(raw.dn.values(), plain.dn.values());
  EXPECT_EQ(raw.black_dn, std::vector<double>(4, 64 - 5.5));
  EXPECT_EQ(raw.white_dn, 4095);
  EXPECT_EQ(raw.dn(1, 0), 4095.0f);
  // Black would lie below 0: all codes are raised.
  const RawFrame raised = drawn(2, 900);
  EXPECT_EQ(raised.black_dn, std::vector<double>(4, 2 - 5.5 + 4));
  EXPECT_EQ(raised.white_dn, 4095 + 4);
  EXPECT_EQ(raised.dn(0, 0), low.dn(0, 0) + 4.0f);
  settings.amplify = true;
  settings.ratio = 3;
  const RawFrame amplified = drawn(64, 900);
  EXPECT_EQ(amplified.black_dn, std::vector<double>(4, 3 * (64 - 5.5)));
  EXPECT_EQ(amplified.white_dn, 3 * 4095);
}

// Noise of 17 DN times ten about a signal of 20: over the camera's own black of 82 a fifth of the
// pixels would be cut off at 0, and the mean would be twice the signal.
TEST(Synthesizer, AmplifiedRawKeepsTheNoiseBelowBlack) {
  const NoiseModel model = load_model("builtin:imx250myr-simulated");
  SynthesisSettings settings;
  settings.ratio = 10;
  settings.amplify = settings.debias = true;
  settings.parameters = "mean";
  const GainSetting gain{.gain_db = 24.0, .iso = {}};
  const Image clean(512, 512, 20.0f);
  const Synthesizer synthesizer(model, settings);
  const RawFrame raw =
      synthesizer.draw_raw(clean, gain, {.seed = 2}, model.black_dn, model.white_dn);
  const Image dn = synthesizer.draw(clean, gain, {.seed = 2}).dn;
  Moments rounded, plain;
  std::int64_t cut = 0;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    rounded.add(raw.dn.values()[i] - raw.black_dn[0]);
    plain.add(static_cast<double>(dn.values()[i]));
    cut += raw.dn.values()[i] == 0;
  }
  EXPECT_LT(cut, 10);
  // Row noise leaves the mean of 256 row groups; both frames share the rows' draws.
  const double row = 10 * model.physics_at(gain).channels[0].sigma_row_dn / 16;
  EXPECT_NEAR(rounded.mean(), 20, kSigmas * (row + std::sqrt(rounded.variance() / 262144)));
  EXPECT_NEAR(rounded.mean(), plain.mean(), kSigmas * std::sqrt(2 * plain.variance() / 262144));
  EXPECT_NEAR(rounded.variance(), plain.variance(),
              kSigmas * (rounded.variance_standard_error() + plain.variance_standard_error()));
}

// More gains than tables are held, in turn and from several threads at once: every frame is what a
// fresh synthesizer draws.
TEST(Synthesizer, KeptTablesDrawWhatFreshOnesDraw) {
  const NoiseModel model = load_model("builtin:imx250myr-simulated");
  Image clean(24, 40);
  for (int r = 0; r < 24; ++r)
    for (int c = 0; c < 40; ++c) clean(r, c) = static_cast<float>(r * c);
  SynthesisSettings settings;
  settings.ratio = 3;
  settings.debias = settings.amplify = true;
  for (const char* kind : {"physics", "poisson-gaussian"}) {
    settings.kind = kind;
    const Synthesizer kept(model, settings);
    constexpr int kFrames = 60;
    std::vector<Image> drawn(kFrames, clean);
    parallel_for(0, kFrames, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (std::ptrdiff_t f = begin; f < end; ++f) {
        const auto number = static_cast<std::uint32_t>(f);
        Image& frame = drawn[static_cast<std::size_t>(f)];
        std::optional<GainSetting> gain;
        if (f % 3 != 0) gain = GainSetting{.gain_db = static_cast<double>(f % 12), .iso = {}};
        kept.draw_into(frame, frame, gain, {.seed = 5, .frame = number});  // in place
      }
    });
    for (int f = 0; f < kFrames; ++f) {
      std::optional<GainSetting> gain;
      if (f % 3 != 0) gain = GainSetting{.gain_db = static_cast<double>(f % 12), .iso = {}};
      const auto fresh =
          Synthesizer(model, settings)
              .draw(clean, gain, {.seed = 5, .frame = static_cast<std::uint32_t>(f)});
      ASSERT_EQ(drawn[static_cast<std::size_t>(f)].values(), fresh.dn.values()) << kind << f;
    }
  }
}

TEST(Synthesizer, MissingKindsAndUndefinedCombinationsAreRefused) {
  SynthesisSettings settings;
  settings.kind = "gaussian";
  EXPECT_THROW(Synthesizer(bayer_model(), settings), InputError);
  settings.kind = "poisson-gaussian";
  settings.exact = true;
  EXPECT_THROW(Synthesizer(bayer_model(), settings), InputError);
  settings.exact = false;
  const Synthesizer synthesizer(bayer_model(), settings);
  const Image clean(2, 2);
  EXPECT_THROW(synthesizer.draw(clean, GainSetting{.gain_db = 30.0, .iso = {}}, {}), InputError);
}

TEST(Synthesizer, SettingsOutOfTheirRangeAreRefused) {
  SynthesisSettings settings;
  EXPECT_NO_THROW(Synthesizer(bayer_model(), settings));
  settings.ratio = 0;  // light would be divided by it
  EXPECT_THROW(Synthesizer(bayer_model(), settings), InputError);
}

// The calibrated offset is a recorded frame's, its rounding included: a synthesized frame, rounded
// or not, has just that variance; without quantisation it has q²/12 less. 240,000 pixels: five
// standard errors of a variance are 1.4 %, a q²/12 of it 2.7 % and more.
TEST(Synthesizer, GaussianFramesAreRoundedOnce) {
  Image clean(600, 400);
  for (std::size_t i = 0; i < clean.size(); ++i)  // all phases of the lattice
    clean.values()[i] = 100.0f + static_cast<float>(i % 97) / 97.0f;
  NoiseModel model = bayer_model();
  GaussianCalibration g;
  g.gain = kGain;
  g.slope_dn.assign(4, 0.004);
  g.bias_dn.assign(4, 0.0);
  for (const double step : {1.0, 4.0}) {
    const double rounding = step * step / 12, offset = 7 * rounding;
    model.quantization_dn = step;
    g.offset_dn2.assign(4, offset);
    model.gaussian = {g};
    SynthesisSettings settings;
    settings.kind = "gaussian";
    const auto variance = [&](const Image& dn, double black) {
      Moments noise;
      for (std::size_t i = 0; i < dn.size(); ++i)
        noise.add(dn.values()[i] - clean.values()[i] - black);
      return noise.variance();
    };
    const double expected = 0.004 * 100.5 + offset,
                 error = kSigmas * expected * std::sqrt(2.0 / 240000);
    const Synthesizer synthesizer(model, settings);
    EXPECT_NEAR(
        variance(synthesizer.draw_raw(clean, kGain, {.seed = 3}, model.black_dn, 4095).dn, 64),
        expected, error);
    EXPECT_NEAR(variance(synthesizer.draw(clean, kGain, {.seed = 3}).dn, 0), expected, error);
    settings.quantization = false;
    EXPECT_NEAR(variance(Synthesizer(model, settings).draw(clean, kGain, {.seed = 3}).dn, 0),
                expected - rounding, error);
  }
}

// The same of distributions: normal, with the rounding of their frames in them, on narrow bins.
TEST(Synthesizer, NonparametricFramesAreRoundedOnce) {
  Image clean(600, 400);
  for (std::size_t i = 0; i < clean.size(); ++i)
    clean.values()[i] = 100.0f + static_cast<float>(i % 97) / 97.0f;
  NoiseModel model = bayer_model();
  for (const double step : {1.0, 4.0}) {
    model.quantization_dn = step;
    const double sd = std::sqrt(7.0 / 12) * step;
    NonparametricChannel channel;
    channel.level_dn = {0, 50, 150};
    channel.samples = {1000, 1000, 1000};
    for (int i = -60; i <= 60; ++i) channel.bin_edges_dn.push_back(0.1 * i * sd);
    std::vector<double> pmf;
    for (int i = -60; i < 60; ++i)
      pmf.push_back(0.5 *
                    (std::erf(0.1 * (i + 1) / std::sqrt(2)) - std::erf(0.1 * i / std::sqrt(2))));
    channel.pmf.assign(3, pmf);
    NonparametricCalibration n;
    n.gain = kGain;
    n.channels.assign(4, channel);
    model.nonparametric = {n};
    SynthesisSettings settings;
    settings.kind = "nonparametric";
    const Synthesizer synthesizer(model, settings);
    const auto variance = [&](const Image& dn, double black) {
      Moments noise;
      for (std::size_t i = 0; i < dn.size(); ++i)
        noise.add(dn.values()[i] - clean.values()[i] - black);
      return noise.variance();
    };
    const double expected = level_moments(channel, 1).variance_dn2,
                 error = kSigmas * expected * std::sqrt(2.0 / 240000);
    EXPECT_NEAR(
        variance(synthesizer.draw_raw(clean, kGain, {.seed = 3}, model.black_dn, 4095).dn, 64),
        expected, error);
    EXPECT_NEAR(variance(synthesizer.draw(clean, kGain, {.seed = 3}).dn, 0), expected, error);
  }
}

// Between two gains there are no codes that rounding could give back: signal zero, too, is rounded
// once.
TEST(Synthesizer, NonparametricDarkFramesBetweenGainsAreRoundedOnce) {
  NonparametricChannel channel;
  channel.level_dn = {0, 150};
  channel.samples = {1000, 1000};
  NoiseModel model = bayer_model();
  model.quantization_dn = 1;
  for (const double gain_db : {0.0, 6.0}) {
    const double sd = gain_db > 0 ? 1.2 : 0.8;
    channel.bin_edges_dn.clear();
    std::vector<double> pmf;
    for (int i = -40; i <= 40; ++i) channel.bin_edges_dn.push_back(0.1 * i * sd);
    for (int i = -40; i < 40; ++i)
      pmf.push_back(0.5 *
                    (std::erf(0.1 * (i + 1) / std::sqrt(2)) - std::erf(0.1 * i / std::sqrt(2))));
    channel.pmf.assign(2, pmf);
    NonparametricCalibration n;
    n.gain = {.gain_db = gain_db, .iso = {}};
    n.channels.assign(4, channel);
    model.nonparametric.push_back(n);
  }
  SynthesisSettings settings;
  settings.kind = "nonparametric";
  const GainSetting between{.gain_db = 3.0, .iso = {}};
  const Image clean(600, 400);
  const RawFrame frame =
      Synthesizer(model, settings).draw_raw(clean, between, {.seed = 3}, model.black_dn, 4095);
  Moments noise;
  for (const float v : frame.dn.values()) noise.add(static_cast<double>(v) - 64);
  const auto expected = level_moments(model.nonparametric_at(between).channels[0], 0);  // unrounded
  EXPECT_NEAR(noise.variance(), expected.variance_dn2 + 1.0 / 12,
              kSigmas * noise.variance_standard_error());
}

// Above the brightest level, too, where the distribution is widened.
TEST(Synthesizer, NonparametricFramesAboveTheLevelsAreRoundedOnce) {
  Image clean(600, 400);
  for (std::size_t i = 0; i < clean.size(); ++i)
    clean.values()[i] = 400.0f + static_cast<float>(i % 97) / 97.0f;
  NonparametricChannel channel;
  channel.level_dn = {0, 150};
  channel.samples = {1000, 1000};
  channel.bin_edges_dn = {-1.5, -0.5, 0.5, 1.5};
  channel.pmf.assign(2, {0.25, 0.5, 0.25});
  NonparametricCalibration n;
  n.gain = kGain;
  n.channels.assign(4, channel);
  n.K.assign(4, 0.002);
  NoiseModel model = bayer_model();
  model.quantization_dn = 1;
  model.nonparametric = {n};
  SynthesisSettings settings;
  settings.kind = "nonparametric";
  const RawFrame frame =
      Synthesizer(model, settings).draw_raw(clean, kGain, {.seed = 3}, model.black_dn, 4095);
  Moments noise;
  for (std::size_t i = 0; i < clean.size(); ++i)
    noise.add(frame.dn.values()[i] - clean.values()[i] - 64);
  const double expected = level_moments(channel, 1).variance_dn2 + 0.002 * (400.5 - 150);
  EXPECT_NEAR(noise.variance(), expected, kSigmas * noise.variance_standard_error());
}

}  // namespace
}  // namespace malus
