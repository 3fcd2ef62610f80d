// What every switch of synthesis means to each kind, and where dark frames are laid.
#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/synthesize/formation.h"
#include "malus/synthesize/model.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <set>

#include "bayer_model.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::bayer_model;
using testing::kGain;

// A camera of all kinds, to draw each.
NoiseModel camera_of_all_kinds() {
  NoiseModel model = bayer_model();
  model.gaussian = {{.gain = kGain,
                     .levels = 3,
                     .slope_dn = {0.9, 1.0, 1.1, 1.2},
                     .slope_stderr_dn = {},
                     .offset_dn2 = {9, 9, 9, 9},
                     .offset_stderr_dn2 = {},
                     .bias_dn = {-4, -5, -6, -7},
                     .warnings = {}}};
  NonparametricChannel channel;
  channel.level_dn = {0, 100};
  channel.samples = {1000, 1000};
  channel.bin_edges_dn = {-9, -6, -3, 0};
  channel.pmf.assign(2, {0.25, 0.5, 0.25});
  NonparametricCalibration levels;
  levels.gain = kGain;
  levels.channels.assign(4, channel);
  levels.sigma_row_dn = {0.5, 0.5, 0.5, 0.5};
  model.nonparametric = {levels};
  RandomSequence random(1, 0, Draw::kOther);
  model.dark_frames = {{.gain = kGain, .frames_dn = {}}};
  for (int n = 0; n < 2; ++n) {
    Image dark(64, 96);
    for (float& v : dark.values()) v = static_cast<float>(random.normal());
    model.dark_frames[0].frames_dn.push_back(std::move(dark));
  }
  return model;
}

// Every switch changes the frame or is refused.
TEST(Synthesizer, NoSettingIsIgnored) {
  const NoiseModel model = camera_of_all_kinds();
  const Image clean(32, 32, 50.0f);
  int refused = 0;
  for (const char* kind :
       {"physics", "poisson-gaussian", "gaussian", "nonparametric", "dark-frames"}) {
    SynthesisSettings usual;
    usual.kind = kind;
    const auto drawn = [&](const SynthesisSettings& settings) {
      return Synthesizer(model, settings).draw(clean, kGain, {.seed = 6}).dn;
    };
    const Image frame = drawn(usual);
    for (bool SynthesisSettings::*part :
         {&SynthesisSettings::shot, &SynthesisSettings::read, &SynthesisSettings::row,
          &SynthesisSettings::bias, &SynthesisSettings::quantization, &SynthesisSettings::debias,
          &SynthesisSettings::exact}) {
      SynthesisSettings changed = usual;
      changed.*part = !(usual.*part);
      try {
        EXPECT_NE(drawn(changed), frame) << kind;
      } catch (const InputError& error) {
        EXPECT_EQ(error.problem(), std::string("is not defined for kind ") + kind);
        ++refused;
      }
    }
    SynthesisSettings mean = usual;
    mean.parameters = "mean";  // this model's do not vary: refused or the same
    if (std::string(kind) == "physics" || std::string(kind) == "poisson-gaussian")
      EXPECT_NO_THROW(Synthesizer(model, mean));
    else
      EXPECT_THROW(Synthesizer(model, mean), InputError) << kind;
  }
  EXPECT_EQ(refused, 1 + 2 + 5 + 5);
}

// The distributions' mean when it is dark, which their denoiser takes for the bias.
TEST(Synthesizer, DebiasTakesTheBiasOfDistributions) {
  SynthesisSettings settings;
  settings.kind = "nonparametric";
  settings.debias = true;
  const auto frame = Synthesizer(camera_of_all_kinds(), settings).draw(Image(64, 64), kGain, {});
  EXPECT_DOUBLE_EQ(frame.global_bias_dn, -4.5);
}

// They cannot be interpolated.
TEST(Synthesizer, RandomGainsOfDarkFramesAreThoseThatHaveThem) {
  NoiseModel model = load_model("imx250myr-simulated");
  for (const double gain_db : {6.0, 24.0})
    model.dark_frames.push_back(
        {.gain = {.gain_db = gain_db, .iso = {}}, .frames_dn = {Image(8, 8)}});
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  const Synthesizer dark(model, settings);
  std::set<double> gains;
  for (std::uint32_t frame = 0; frame < 40; ++frame)
    gains.insert(*dark.draw(Image(8, 8), std::nullopt, {.seed = 3, .frame = frame}).gain.gain_db);
  EXPECT_EQ(gains, (std::set{6.0, 24.0}));
}

// Not of the range that another kind was measured over.
TEST(Synthesizer, RandomGainsAreThoseOfTheKind) {
  NoiseModel model = load_model("imx250mzr-simulated");
  const NoiseModel all = camera_of_all_kinds();
  for (const double gain_db : {6.0, 12.0}) {
    model.gaussian.push_back(all.gaussian[0]);
    model.gaussian.back().gain = {gain_db, {}};
    model.nonparametric.push_back(all.nonparametric[0]);
    model.nonparametric.back().gain = {gain_db, {}};
  }
  for (const char* kind : {"physics", "gaussian", "nonparametric"}) {
    SynthesisSettings settings;
    settings.kind = kind;
    double least_db = 100, most_db = -100;
    for (std::uint32_t frame = 0; frame < 400; ++frame) {
      const double gain_db = *random_gain(model, settings, 3, frame).gain_db;
      least_db = std::min(least_db, gain_db);
      most_db = std::max(most_db, gain_db);
    }
    // Of 400 draws the outermost lie within a hundredth of the range from its ends, but for 4 % of
    // the seeds.
    const bool physics = settings.kind == "physics";
    const double low_db = physics ? 0 : 6, high_db = physics ? 30 : 12;
    EXPECT_GE(least_db, low_db) << kind;
    EXPECT_LE(most_db, high_db) << kind;
    EXPECT_NEAR(least_db, low_db, 0.01 * (high_db - low_db)) << kind;
    EXPECT_NEAR(most_db, high_db, 0.01 * (high_db - low_db)) << kind;
  }
}

// Of every kind, not at the first draw.
TEST(Model, AGainThatIsNotServedIsRefusedWhereItIsAsked) {
  const Model model(camera_of_all_kinds());
  for (const char* kind :
       {"physics", "poisson-gaussian", "gaussian", "nonparametric", "dark-frames"}) {
    SynthesisSettings settings;
    settings.kind = kind;
    EXPECT_NO_THROW(model.at_gain(*kGain.gain_db, settings)) << kind;
    EXPECT_THROW(model.at_gain(500, settings), InputError) << kind;
  }
}

TEST(Synthesizer, PatchesOfDarkFramesComeFromAnywhere) {
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  const Synthesizer dark(camera_of_all_kinds(), settings);
  std::set<std::pair<int, int>> places;
  for (std::uint32_t frame = 0; frame < 400; ++frame) {
    const DrawAddress address = dark.somewhere(32, 40, 7, frame);
    EXPECT_EQ(address.row0 % 2, 0);  // the cell's rows, and the row group's
    EXPECT_EQ(address.col0 % 2, 0);
    EXPECT_LE(address.row0, 64 - 32);
    EXPECT_LE(address.col0, 96 - 40);
    EXPECT_EQ(address.seed, 7u);
    EXPECT_EQ(address.frame, frame);
    EXPECT_EQ(dark.somewhere(32, 40, 7, frame).row0, address.row0);
    places.emplace(address.row0, address.col0);
  }
  // 400 draws from 17 x 29 places hit 493 (1 - exp(-400 / 493)) = 274 of them.
  EXPECT_GT(places.size(), 240u);
  EXPECT_EQ(dark.somewhere(64, 96, 7, 1).col0, 0);
  EXPECT_EQ(dark.somewhere(128, 200, 7, 1).row0, 0);
  settings.kind = "physics";  // noise without places
  EXPECT_EQ(Synthesizer(camera_of_all_kinds(), settings).somewhere(8, 8, 7, 3).row0, 0);
}

TEST(Synthesizer, DarkFramesThatRepeatAreSaid) {
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  const Synthesizer dark(camera_of_all_kinds(), settings);
  EXPECT_EQ(dark.repetition(64, 96), "");
  EXPECT_EQ(dark.repetition(65, 97), "");  // what is no whole cell
  EXPECT_NE(dark.repetition(66, 96), "");
  EXPECT_NE(dark.repetition(64, 192), "");
  settings.kind = "gaussian";
  EXPECT_EQ(Synthesizer(camera_of_all_kinds(), settings).repetition(640, 960), "");
}

// K 0.5, and one dark frame of 2 DN.
NoiseModel even_dark_model(int side) {
  NoiseModel model = bayer_model();
  model.dark_frames = {{.gain = kGain, .frames_dn = {Image(side, side, 2.0f)}}};
  for (auto& calibration : model.physics)
    for (auto& K : calibration.K.mean) K = 0.5;
  return model;
}

// At K 0.5 half of the sums of a code and a number of electrons lie in the middle of a step, where
// rounding alone always goes the same way.
TEST(Synthesizer, RoundedDarkFramesKeepTheMeanOfTheLight) {
  constexpr int kSide = 256;
  const NoiseModel model = even_dark_model(kSide);
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  for (const float light_dn : {1.0f, 3.0f, 20.0f}) {
    const std::vector<double> black(4, 64.0);
    const RawFrame frame =
        Synthesizer(model, settings)
            .draw_raw(Image(kSide, kSide, light_dn), kGain, {.seed = 5}, black, 4095);
    double sum = 0;
    for (const float dn : frame.dn.values()) sum += dn - 66;
    const double variance = 0.5 * light_dn + 1.0 / 6;
    EXPECT_NEAR(sum / (kSide * kSide), light_dn, 4 * std::sqrt(variance) / kSide) << light_dn;
  }
}

// Two pixels share a block of random words (pixel_words): what goes before the rounding of one is
// not the shot noise of the other.
TEST(Synthesizer, PixelsOfRoundedDarkFramesHaveNothingInCommon) {
  constexpr int kSide = 512;
  const NoiseModel model = even_dark_model(kSide);
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  const RawFrame frame =
      Synthesizer(model, settings)
          .draw_raw(Image(kSide, kSide, 1.0f), kGain, {.seed = 8}, {64, 64, 64, 64}, 4095);
  double sum_a = 0, sum_b = 0, square_a = 0, square_b = 0, product = 0, pairs = 0;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide / 2; ++c) {
      const double a = frame.dn(r, c), b = frame.dn(r, kGroupColumns * (c / 16) + 16 + c % 16);
      sum_a += a, sum_b += b, square_a += a * a, square_b += b * b, product += a * b, ++pairs;
    }
  const double covariance = product / pairs - sum_a * sum_b / pairs / pairs,
               variance_a = square_a / pairs - sum_a * sum_a / pairs / pairs,
               variance_b = square_b / pairs - sum_b * sum_b / pairs / pairs;
  EXPECT_LT(std::abs(covariance) / std::sqrt(variance_a * variance_b), 5 / std::sqrt(pairs));
}

// The last rows of an int overflowed it, and a negative row was a bug of malus by its message.
TEST(Synthesizer, PlacesOffAnySensorAreRefused) {
  const NoiseModel model = camera_of_all_kinds();
  const Image clean(4, 8, 100.0f);
  for (const char* kind : {"physics", "gaussian", "nonparametric"}) {
    SynthesisSettings settings;
    settings.kind = kind;
    const auto draw = [&, synthesizer = Synthesizer(model, settings)](int row0, int col0) {
      synthesizer.draw(clean, kGain, {.row0 = row0, .col0 = col0});
    };
    EXPECT_NO_THROW(draw(kLastPosition - 3, kLastPosition - 7)) << kind;
    EXPECT_THROW(draw(kLastPosition - 2, 0), InputError) << kind;
    EXPECT_THROW(draw(0, kLastPosition - 6), InputError) << kind;
    EXPECT_THROW(draw(-4, 0), InputError) << kind;
    EXPECT_THROW(draw(std::numeric_limits<int>::max(), 0), InputError) << kind;
  }
}

TEST(Synthesizer, DarkFramesKeepTheirPlaceOnTheSensor) {
  NoiseModel model = bayer_model();
  Image dark(4, 6);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 6; ++c) dark(r, c) = static_cast<float>(10 * r + c);
  model.dark_frames = {{.gain = kGain, .frames_dn = {dark}}};
  SynthesisSettings settings;
  settings.kind = "dark-frames";
  settings.shot = false;
  const Image clean(3, 3, 100.0f);
  const auto frame = Synthesizer(model, settings)
                         .draw(clean, kGain, {.seed = 0, .frame = 0, .row0 = 3, .col0 = 4});
  EXPECT_EQ(frame.dn(0, 0), 134.0f);  // row 3, column 4
  EXPECT_EQ(frame.dn(0, 2), 130.0f);  // column 6 comes round to 0
  EXPECT_EQ(frame.dn(1, 1), 105.0f);  // row 4 comes round to 0
}

// Maps make models large: one is not copied for every ratio that is drawn with.
TEST(Synthesizer, SharesTheModelThatItIsGiven) {
  const auto model = std::make_shared<const NoiseModel>(camera_of_all_kinds());
  EXPECT_EQ(&Synthesizer(model, {}).model(), model.get());
  EXPECT_EQ(model->setting_of(12), (GainSetting{12.0, {}}));
  NoiseModel photo;
  photo.dark_frames = {{.gain = {{}, 400.0}, .frames_dn = {}}};
  EXPECT_EQ(photo.setting_of(400), (GainSetting{{}, 400.0}));
}

// A fraction of a code above signal zero there are no codes to give back; at zero, where the output
// is not rounded, the rounding is missing.
TEST(Synthesizer, NonparametricNoiseNearSignalZeroIsThatOfRoundedFrames) {
  constexpr double kSd = 0.6;
  NonparametricChannel channel;
  channel.level_dn = {0, 1000};
  channel.samples = {1000, 1000};
  for (int i = -40; i <= 40; ++i) channel.bin_edges_dn.push_back(0.1 * i);
  for (const double variance : {kSd * kSd, kSd * kSd + 1.0 / 12}) {
    const double sd = std::sqrt(variance) * std::numbers::sqrt2;
    std::vector<double> pmf;
    for (int i = -40; i < 40; ++i)
      pmf.push_back(0.5 * (std::erf(0.1 * (i + 1) / sd) - std::erf(0.1 * i / sd)));
    channel.pmf.push_back(pmf);
  }
  NoiseModel model = bayer_model();
  model.quantization_dn = 1;
  NonparametricCalibration n;
  n.gain = {.gain_db = 0.0, .iso = {}};
  n.channels.assign(4, channel);
  model.nonparametric.push_back(n);
  SynthesisSettings settings;
  settings.kind = "nonparametric";
  Synthesizer synthesizer(model, settings);
  for (const float signal : {0.3F, 0.5F}) {
    const RawFrame frame =
        synthesizer.draw_raw(Image(600, 400, signal), n.gain, {.seed = 3}, model.black_dn, 4095);
    Moments noise;
    for (const float v : frame.dn.values()) noise.add(static_cast<double>(v) - 64);
    EXPECT_NEAR(noise.variance(), kSd * kSd + 1.0 / 12, 0.01) << signal;
  }
  const SyntheticFrame dark = synthesizer.draw(Image(600, 400), n.gain, {.seed = 3});
  Moments noise;
  for (const float v : dark.dn.values()) noise.add(static_cast<double>(v));
  EXPECT_NEAR(noise.variance(), kSd * kSd + 1.0 / 12, 0.01);
}

}  // namespace
}  // namespace malus
