// A training whose noise is that of a Noise Flow.
#include "malus/io/pair_list.h"
#include "malus/io/shard.h"
#include "malus/neural/internal/camera_noise.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/internal/validation.h"
#include "malus/neural/noise_flow.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/neural/trainer.h"
#include "malus/weights/safetensors.h"

#include <cmath>
#include <set>

#include "problem_of.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::problem_of;
using testing::scene_config;
using testing::TemporaryFolder;

constexpr double kBlackDn = 80, kWhiteDn = 4000, kRange = kWhiteDn - kBlackDn;
// Variance of the noise that known_flow() draws, of the signal's part and of none, per dB
// of gain the same.
constexpr double kSlopeDn = 1.5, kOffsetDn2 = 90;

// Without couplings a flow is a heteroscedastic Gaussian, and start_at() sets which.
NoiseFlowModel known_flow(double step_dn = 0, const char* layout = "polar-bayer-rggb") {
  NoiseFlowSensor sensor;
  sensor.layout = layout;
  sensor.black_dn.assign(static_cast<std::size_t>(SensorLayout::named(layout).channels()),
                         kBlackDn);
  sensor.white_dn = kWhiteDn;
  sensor.lowest_gain_db = 6;
  sensor.highest_gain_db = 18;
  sensor.gains_db = {6, 12, 18};
  sensor.spread_dn = step_dn;
  NoiseFlowModel model(sensor, 0, 1);
  model.network().start_at(kSlopeDn / kRange, kOffsetDn2 / (kRange * kRange));
  return model;
}

double variance_of(double signal_dn) { return kSlopeDn * signal_dn + kOffsetDn2; }

// 16384 samples: five standard errors of a variance are 5.5 %, of a mean 4 % of the deviation.
TEST(FlowNoise, ProfileIsThatOfWhatIsDrawn) {
  const NoiseProfile profile = known_flow().profile_at({.gain_db = 12.0, .iso = {}});
  ASSERT_EQ(profile.channels.size(), 16u);
  for (const ChannelProfile& channel : profile.channels) {
    for (const double signal : {0.0, 40.0, 400.0, 2000.0, 4000.0})
      EXPECT_NEAR(channel.variance(signal) / variance_of(signal), 1, 0.055) << signal;
    EXPECT_NEAR(channel.bias_dn, 0, 0.04 * std::sqrt(kOffsetDn2));
    EXPECT_EQ(channel.sigma_row_dn, 0);
  }
  EXPECT_THROW(known_flow().profile_at({.gain_db = 24.0, .iso = {}}), InputError);
}

// What recorded integers hold is told: the step, whose q²/12 the flow learned and draws lose.
TEST(FlowNoise, ProfileOfIntegersIsThatOfRecordedFrames) {
  const double q = 32;
  const NoiseProfile profile = known_flow(q).profile_at({.gain_db = 12.0, .iso = {}});
  EXPECT_EQ(profile.step_dn, q);
  for (const ChannelProfile& channel : profile.channels)
    EXPECT_NEAR(channel.variance(1000) / (variance_of(1000) - q * q / 12), 1, 0.055);
}

struct FlowTraining {
  FlowTraining() : scene(folder), config(scene_config(scene)) {
    known_flow().save(flow, {});
    config.models = {flow};
  }
  std::string refusal() const {
    return problem_of([&] { make_pair_source(config); });
  }
  TemporaryFolder folder;
  AngleScene scene;
  std::filesystem::path flow = folder / "flow.safetensors";
  TrainingConfig config;
};

// Over 30 examples of 2304 pixels: five standard errors of a variance are 2.7 %.
TEST(FlowNoise, TrainingDrawsItsDeviation) {
  FlowTraining training;
  training.config.noise.ratio_low = 2;
  training.config.noise.ratio_high = 20;
  const auto source = make_pair_source(training.config);
  double square = 0, n = 0;
  std::set<double> gains;
  for (std::uint32_t i = 0; i < 30; ++i) {
    const RawPair pair = source->pair(7, i);
    gains.insert(*pair.noisy.gain.gain_db);
    EXPECT_EQ(pair.noisy.white_dn, kWhiteDn);
    for (std::size_t k = 0; k < pair.clean_dn.size(); ++k) {
      const double clean = pair.clean_dn.values()[k], noisy = pair.noisy.dn.values()[k] - kBlackDn;
      square += (noisy - clean) * (noisy - clean) / variance_of(clean);
      n += 1;
    }
    // The noise-level input is the deviation that is drawn with.
    EXPECT_NEAR(pair.profile.channels[3].variance(100) / variance_of(100), 1, 0.055);
    const RawPair again = source->pair(7, i);
    EXPECT_EQ(again.noisy.dn, pair.noisy.dn);
  }
  EXPECT_NEAR(square / n, 1, 0.027);
  EXPECT_EQ(gains, (std::set<double>{6, 12, 18}));  // of those that it was trained at
}

TEST(FlowNoise, WhiteHoldsAndNothingElseIsCutOfFloatPairs) {
  FlowTraining training;
  training.config.data.exposure_low = training.config.data.exposure_high = 900;
  const RawPair bright = make_pair_source(training.config)->pair(1, 0);
  EXPECT_EQ(*std::ranges::max_element(bright.noisy.dn.values()), static_cast<float>(kWhiteDn));
  training.config.data.exposure_low = training.config.data.exposure_high = 1e-3;
  training.config.noise.ratio_low = training.config.noise.ratio_high = 100;
  double below = 0;
  const RawPair dark = make_pair_source(training.config)->pair(1, 0);
  for (const float v : dark.noisy.dn.values()) below += v < kBlackDn;
  EXPECT_NEAR(below / static_cast<double>(dark.noisy.dn.size()), 0.5, 0.06);  // 5 standard errors
}

TEST(FlowNoise, AFlowIsMixedWithACalibratedModelOfAnyKind) {
  FlowTraining training;
  training.config.models.push_back("imx250myr-simulated");
  training.config.noise.gains = {12};
  training.config.synthesis.kind = "poisson-gaussian";  // of the calibrated one
  const auto source = make_pair_source(training.config);
  int of_flow = 0;
  for (std::uint32_t i = 0; i < 40; ++i) of_flow += source->pair(3, i).noisy.white_dn == kWhiteDn;
  EXPECT_GT(of_flow, 8);  // a half of 40, 3.8 deviations below and above
  EXPECT_LT(of_flow, 32);
}

TEST(FlowNoise, SettingsOfACalibratedModelsPartsAreRefused) {
  const auto refused = [](const auto& change) {
    FlowTraining training;
    change(training.config);
    const std::string problem = training.refusal();
    EXPECT_NE(problem.find("flow.safetensors"), std::string::npos) << problem;
    return problem;
  };
  EXPECT_NE(refused([](TrainingConfig& c) { c.noise.jitter = 0.1; }).find("jitter"),
            std::string::npos);
  EXPECT_NE(refused([](TrainingConfig& c) { c.synthesis.kind = "gaussian"; }).find("kind"),
            std::string::npos);
  EXPECT_NE(refused([](TrainingConfig& c) { c.synthesis.bias = false; }).find("bias"),
            std::string::npos);
  EXPECT_NE(
      refused([](TrainingConfig& c) { c.package.settings.layout = "polar-mono"; }).find("layout"),
      std::string::npos);
  FlowTraining outside;
  outside.config.noise.gains = {24};
  EXPECT_NE(outside.refusal().find("from 6 dB to 18 dB"), std::string::npos) << outside.refusal();
  FlowTraining captured;
  captured.config.pairs = {captured.folder / "pairs.json"};
  EXPECT_NE(captured.refusal().find("captured pairs want a calibrated"), std::string::npos)
      << captured.refusal();
}

TEST(FlowNoise, ANetworkIsTrainedAndValidatedOnIt) {
  FlowTraining training;
  training.config.train.steps = 3;
  training.config.validation_scenes = {training.scene.path};
  training.config.cases = {{.gain = 12, .ratio = 10}};
  training.config.validation.crop = 32;
  training.config.validation.every = 3;
  const auto workers = single_worker();
  const auto record =
      train(training.config, {.folder = training.folder / "run"}, *workers, silent_progress());
  EXPECT_TRUE(record.contains("best_score_db"));
  EXPECT_TRUE(std::filesystem::exists(training.folder / "run/sample/noisy.npy"));
}

// A layout that nobody knows, a step beyond the range, gains beyond float, gains that fall, and
// more weights than are there.
TEST(FlowNoise, FilesThatDescribeThemselvesWrongAreRefusedByName) {
  const TemporaryFolder folder;
  known_flow().save(folder / "flow.safetensors", {});
  const TensorFile whole = load_tensor_file(folder / "flow.safetensors");
  const auto refused = [&](const nlohmann::json& change) {
    TensorFile file = whole;
    nlohmann::json description = nlohmann::json::parse(file.metadata.at("malus_noise_flow"));
    description.update(change);
    file.metadata["malus_noise_flow"] = description.dump();
    save_tensor_file(file, folder / "changed.safetensors");
    return problem_of([&] { NoiseFlowModel(folder / "changed.safetensors"); });
  };
  for (const nlohmann::json& change : std::initializer_list<nlohmann::json>{
           {{"layout", "bayer-rggx"}},
           {{"spread_dn", 1e30}},
           {{"highest_gain_db", 1e9}},
           {{"lowest_gain_db", 18}, {"highest_gain_db", 6}, {"gains_db", nlohmann::json::array()}},
           {{"steps", 64}, {"width", 1024}}})
    EXPECT_NE(refused(change).find("changed.safetensors: "), std::string::npos) << refused(change);
  EXPECT_NE(refused({{"steps", 64}, {"width", 1024}}).find("fewer weights"), std::string::npos);
}

// Finite, but no flow's: a mixing that nothing undoes, deviations and scales that float does not
// hold, at one end of the gains or at both.
TEST(FlowNoise, FilesWhoseDrawsAreNoNumbersAreRefusedByName) {
  const TemporaryFolder folder;
  NoiseFlowModel(known_flow().sensor(), 2, 4).save(folder / "flow.safetensors", {});
  const TensorFile whole = load_tensor_file(folder / "flow.safetensors");
  const auto refused = [&](const char* weight, float value) {
    TensorFile file = whole;
    file.tensors.at(weight) = from_torch(to_torch(file.tensors.at(weight)).fill_(value));
    save_tensor_file(file, folder / "changed.safetensors");
    return problem_of([&] { NoiseFlowModel(folder / "changed.safetensors"); });
  };
  EXPECT_EQ(refused("slope", -6), "");
  for (const auto& [weight, value] :
       std::initializer_list<std::pair<const char*, float>>{{"step_0.mixing", 0.0F},
                                                            {"step_1.mixing", 1.0F},
                                                            {"slope", 500},
                                                            {"slope_gain", 60},
                                                            {"offset", -500},
                                                            {"gain", 100},
                                                            {"gain_slope", 60}}) {
    const std::string line = refused(weight, value);
    EXPECT_NE(line.find("changed.safetensors: "), std::string::npos) << weight << ": " << line;
  }
}

// Files from before the gains were kept tell the lowest and the highest.
TEST(FlowNoise, OlderFilesHaveTheEndsOfTheirGains) {
  NoiseFlowSensor sensor;
  sensor.lowest_gain_db = sensor.highest_gain_db = 12;
  EXPECT_EQ(sensor.trained_gains(), (std::vector<GainSetting>{{.gain_db = 12.0, .iso = {}}}));
  sensor.highest_gain_db = 18;
  EXPECT_EQ(sensor.trained_gains().size(), 2u);
  sensor.gains_in_iso = true;
  EXPECT_EQ(sensor.setting_of(400).iso, 400);
}

// ISO 400 and 12 dB have one number and are two gains.
TEST(FlowNoise, AGainInAnotherUnitThanTheFlowsIsRefused) {
  NoiseFlowSensor sensor;
  sensor.gains_db = {GainSetting{.gain_db = {}, .iso = 400}.decibel().value()};
  sensor.lowest_gain_db = sensor.highest_gain_db = sensor.gains_db.front();
  const GainSetting iso{.gain_db = {}, .iso = 400}, db{.gain_db = sensor.gains_db[0], .iso = {}};
  const auto problem = [&](const GainSetting& gain) {
    return testing::problem_of([&] { sensor.require_gain(gain); });
  };
  EXPECT_EQ(problem(db), "");
  EXPECT_NE(problem(iso).find("ISO 400: is in another unit"), std::string::npos) << problem(iso);
  sensor.gains_in_iso = true;
  EXPECT_EQ(problem(iso), "");
  EXPECT_NE(problem(db).find("another unit"), std::string::npos) << problem(db);
}

}  // namespace
}  // namespace malus
