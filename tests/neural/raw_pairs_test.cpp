// Which sensors and which light examples are drawn with.
#include "malus/neural/internal/raw_pairs.h"

#include "malus/base/statistics.h"
#include "malus/neural/internal/camera_noise.h"

#include <algorithm>
#include <cmath>

#include "problem_of.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::scene_config;
using testing::TemporaryFolder;

double correlation_of(const std::vector<double>& x, const std::vector<double>& y) {
  const double mean_x = mean_of(x), mean_y = mean_of(y);
  double xy = 0, xx = 0, yy = 0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    xy += (x[i] - mean_x) * (y[i] - mean_y);
    xx += (x[i] - mean_x) * (x[i] - mean_x);
    yy += (y[i] - mean_y) * (y[i] - mean_y);
  }
  return xy / std::sqrt(xx * yy);
}

TEST(Sensors, AreVariedByTheStatedSpread) {
  const NoiseModel model = load_model("imx250myr-simulated");
  const GainSetting gain{12.0, {}};
  const double K = model.parameters_at(gain).K[0];
  double sum = 0, squares = 0;
  constexpr int kSensors = 2000;
  for (std::uint32_t i = 0; i < kSensors; ++i) {
    const NoiseModel sensor = jittered_sensor(model, gain, 0.3, 4, i);
    EXPECT_EQ(contradiction_in(sensor), "");
    const double x = std::log(sensor.parameters_at(gain).K[0] / K);
    sum += x;
    squares += x * x;
  }
  // Five standard errors: 0.3 / sqrt(2000) and 0.3 / sqrt(4000).
  EXPECT_NEAR(sum / kSensors, 0, 0.034);
  EXPECT_NEAR(std::sqrt(squares / kSensors), 0.3, 0.024);
}

// What an example is drawn with are draws of their own: the gain, the factor on K, the light, and
// the row noise of the frame.
TEST(Sensors, AreVariedWhateverTheirGainAndLight) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.data.example = 16;
  config.noise.ratio_high = 10;
  const auto source = make_pair_source(config);
  const NoiseModel model = load_model("imx250myr-simulated");
  constexpr std::uint64_t kSeed = 4;
  constexpr std::uint32_t kExamples = 400;
  std::vector<double> gain_db, K_factor, light;
  std::vector<std::vector<double>> rows(static_cast<std::size_t>(model.layout.channels()));
  for (std::uint32_t i = 0; i < kExamples; ++i) {
    const RawPair pair = source->pair(kSeed, i);
    const GainSetting& gain = pair.noisy.gain;
    gain_db.push_back(*gain.gain_db);
    const NoiseModel sensor = jittered_sensor(model, gain, 0.3, kSeed, i);
    K_factor.push_back(std::log(sensor.parameters_at(gain).K[0] / model.parameters_at(gain).K[0]));
    light.push_back(std::log(pair.ratio));
    const PhysicsNoise frame = model.sample_physics_at({12.0, {}}, kSeed, i);
    for (std::size_t c = 0; c < rows.size(); ++c) rows[c].push_back(frame.channels[c].sigma_row_dn);
  }
  const double error = 4.5 / std::sqrt(kExamples);
  EXPECT_NEAR(correlation_of(gain_db, K_factor), 0, error);
  EXPECT_NEAR(correlation_of(gain_db, light), 0, error);
  EXPECT_NEAR(correlation_of(light, K_factor), 0, error);
  for (const auto& row : rows) EXPECT_NEAR(correlation_of(light, row), 0, error);
}

// A gain is drawn, or named, of the kind that the noise is of.
TEST(Sensors, GainsAreThoseOfTheKind) {
  const TemporaryFolder folder;
  NoiseModel model = load_model("imx250myr-simulated");
  for (const double gain_db : {0.0, 12.0})
    model.gaussian.push_back({.gain = {gain_db, {}},
                              .levels = 3,
                              .slope_dn = std::vector<double>(16, 0.5 + gain_db / 12),
                              .slope_stderr_dn = {},
                              .offset_dn2 = std::vector<double>(16, 4.0),
                              .offset_stderr_dn2 = {},
                              .bias_dn = {},
                              .warnings = {}});
  save_model(model, folder / "model.h5");
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.models = {folder / "model.h5"};
  config.synthesis.kind = "gaussian";
  config.noise.gains = {6};
  EXPECT_EQ(testing::problem_of([&] { make_pair_source(config); }), "");
  config.noise.gains = {6, 24};
  EXPECT_NE(testing::problem_of([&] { make_pair_source(config); }).find("gains in [noise]: 24 dB"),
            std::string::npos);
  config.models.push_back("imx250myr-simulated");  // of several it is told which
  config.synthesis.kind = "physics";
  config.noise.gains = {48};
  EXPECT_NE(testing::problem_of([&] {
              make_pair_source(config);
            }).find("gains in [noise], of " + model.sensor + ": 48 dB"),
            std::string::npos);
}

TEST(Sensors, OfAKindThatTheModelDoesNotHoldAreNamedByTheirKey) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.source = "config.toml";
  config.synthesis.kind = "gaussian";
  const std::string line = testing::problem_of([&] { make_pair_source(config); });
  EXPECT_NE(line.find("config.toml: kind in [noise]: is \"gaussian\", and imx250myr-simulated"),
            std::string::npos)
      << line;
}

// What is not drawn is not told. Raw frames are rounded, whatever is switched off.
TEST(Sensors, TellTheirNoiseAsItWasDrawn) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const auto told = [&](bool shot, bool read, bool row) {
    TrainingConfig config = scene_config(scene);
    config.noise.gains = {12};
    config.data.example = 16;
    config.synthesis.shot = shot;
    config.synthesis.read = read;
    config.synthesis.row = row;
    config.synthesis.quantization = false;
    return make_pair_source(config)->pair(4, 1).profile.channels.front();
  };
  const PhysicsNoise noise = load_model("imx250myr-simulated").physics_at({12.0, {}});
  const double rounding_dn2 = noise.quantization_dn * noise.quantization_dn / 12;
  const double read_dn2 = read_variance_dn2(noise.channels.front());
  const double electron_dn = noise.channels.front().gain_dn_per_e;
  for (const bool shot : {false, true})
    for (const bool read : {false, true}) {
      const ChannelProfile channel = told(shot, read, shot);
      const double dark_dn2 = rounding_dn2 + (read ? read_dn2 : 0);
      EXPECT_NEAR(channel.variance(0), dark_dn2, 1e-9);
      EXPECT_NEAR(channel.variance(100), dark_dn2 + (shot ? 100 * electron_dn : 0), 1e-9);
      EXPECT_EQ(channel.sigma_row_dn > 0, shot);
      // Its law, by which means are brought back.
      const auto square = [](double dn) { return (dn - 100) * (dn - 100); };
      EXPECT_NEAR(channel.distribution().expectations(square, {100.0})[0], channel.variance(100),
                  0.02 * channel.variance(100));
    }
}

// A model's maps are far larger than an example. What is drawn has no defects to fill, either: a
// profile with the model's list took ordinary pixels of examples as large as the sensor for them.
TEST(Sensors, AreDrawnWithoutTheirMapsAndDefects) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.data.example = 16;
  const RawPair plain = make_pair_source(config)->pair(4, 1);
  NoiseModel model = load_model("imx250myr-simulated");
  for (PhysicsCalibration& entry : model.physics) {
    entry.dark_shading_dn = Image(plain.noisy.dn.rows(), plain.noisy.dn.cols(), 3.0f);
    entry.prnu_map = Image(plain.noisy.dn.rows(), plain.noisy.dn.cols(), 1.0f);
  }
  model.defects = {{.row = 3, .col = 5, .kind = "hot", .value = 9}};
  save_model(model, folder / "maps.h5");
  config.models = {folder / "maps.h5"};
  const RawPair mapped = make_pair_source(config)->pair(4, 1);
  EXPECT_TRUE(std::ranges::equal(mapped.noisy.dn.values(), plain.noisy.dn.values()));
  EXPECT_TRUE(std::ranges::equal(mapped.clean_dn.values(), plain.clean_dn.values()));
  EXPECT_TRUE(mapped.profile.defects.places.empty());
}

}  // namespace
}  // namespace malus
