// What training takes from files of others: shards and captured pairs that do not fit are named,
// and a run is known by what its files hold. Truth: the files that the test wrote.
#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"
#include "malus/io/shard.h"
#include "malus/neural/internal/example_pool.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/trainer.h"

#include <cmath>
#include <fstream>

#include "problem_of.h"
#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;
using testing::TemporaryFolder;

Planes grey_planes(int side, float value) {
  Planes planes(4, side, side);
  for (Image& plane : planes)
    for (float& v : plane.values()) v = value;
  return planes;
}

// One sample of 4 planes whose noisy ones may have another side than its clean ones.
struct RecordedShard {
  RecordedShard(const TemporaryFolder& folder, int clean_side, int noisy_side, float value = 300,
                const std::string& facts =
                    R"({"ratio": 1, "removed_bias_dn": 0, "gain_db": 12, "iso": null})") {
    describe(folder, model.layout, model.sensor);
    TarShard shard(folder / "shard.tar", true);
    shard.add("sample7.clean.npy", npy_bytes(grey_planes(clean_side, value)));
    shard.add("sample7.noisy.npy", npy_bytes(grey_planes(noisy_side, value)));
    shard.add("sample7.json", facts);
    shard.commit();
    config.source = "config.toml";
    config.package.settings.layout = "polar-mono";
    config.package.network =
        fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
    config.shards = {folder / "shard.tar"};
    config.models = {"imx250mzr-simulated"};
    config.data.example = 32;
    config.data.patch = 16;
    config.train.steps = 1;
    config.train.batch = 1;
  }
  // more: keys of dataset.json beside these.
  static void describe(const TemporaryFolder& folder, const SensorLayout& layout,
                       const std::string& sensor, const nlohmann::json& more = {}) {
    nlohmann::json description{{"sensor", sensor},
                               {"layout", layout.name()},
                               {"channels", layout.channel_names()},
                               {"noise", {{"amplify", false}, {"bias", true}}}};
    if (!more.is_null()) description.merge_patch(more);
    std::ofstream(folder / "dataset.json") << description;
  }
  const NoiseModel model = load_model("imx250mzr-simulated");
  TrainingConfig config;
};

TEST(ShardPairs, OfUnlikeSizesAreNamed) {
  const TemporaryFolder folder;
  for (const auto& [clean, noisy] : {std::pair{16, 12}, std::pair{12, 16}}) {
    const RecordedShard shard(folder, clean, noisy);
    const std::string line = problem_of([&] { make_pair_source(shard.config)->pair(1, 0); });
    EXPECT_NE(line.find("sample7"), std::string::npos) << line;
    EXPECT_NE(line.find("another size"), std::string::npos) << line;
  }
}

TEST(ShardPairs, OfAnotherSensorAreRefused) {
  const TemporaryFolder folder;
  const RecordedShard shard(folder, 16, 16);
  const auto refusal = [&](const SensorLayout& layout, const std::string& sensor) {
    RecordedShard::describe(folder, layout, sensor);
    return problem_of([&] { make_pair_source(shard.config); });
  };
  EXPECT_EQ(refusal(shard.model.layout, shard.model.sensor), "");
  const std::string layout = refusal(SensorLayout::named("bayer-rggb"), shard.model.sensor);
  EXPECT_NE(layout.find("have the layout bayer-rggb, the package polar-mono"), std::string::npos)
      << layout;
  const std::string sensor = refusal(shard.model.layout, "another");
  EXPECT_NE(sensor.find("drawn from a model of the sensor"), std::string::npos) << sensor;
}

// Two calibrations of one sensor differ by their files alone.
TEST(ShardPairs, OfAnotherModelOfTheSensorAreToldAndOfNoSensorRefused) {
  const TemporaryFolder folder;
  RecordedShard shard(folder, 16, 16);
  NoiseModel model = shard.model;
  shard.config.models = {folder / "model.h5"};
  const auto complaints = [&](const std::string& print) {
    save_model(model, folder / "model.h5", true);
    RecordedShard::describe(
        folder, model.layout, model.sensor,
        {{"model_fingerprint", print.empty() ? file_fingerprint(folder / "model.h5") : print}});
    return make_pair_source(shard.config)->complaints();
  };
  EXPECT_TRUE(complaints("").empty());
  ASSERT_EQ(complaints("0123456789abcdef").size(), 1u);
  EXPECT_NE(complaints("0123456789abcdef")[0].find("another noise model of"), std::string::npos);
  model.sensor.clear();
  EXPECT_TRUE(complaints("").empty());
  EXPECT_NE(problem_of([&] { complaints("0123456789abcdef"); }).find("another noise model than"),
            std::string::npos);
}

TEST(ShardPairs, TellTheNoiseThatTheyWereDrawnWith) {
  const TemporaryFolder folder;
  RecordedShard shard(folder, 16, 16);
  const auto profile = [&](const nlohmann::json& noise) {
    RecordedShard::describe(folder, shard.model.layout, shard.model.sensor, {{"noise", noise}});
    return make_pair_source(shard.config)->pair(1, 0).profile;
  };
  const NoiseProfile all = shard.model.profile_at({.gain_db = 12, .iso = {}});
  const double step_dn = shard.model.quantization_dn;
  const NoiseProfile part = profile({{"read", false}, {"row", false}});
  EXPECT_NEAR(part.channels[0].variance(0), step_dn * step_dn / 12, 1e-9);
  EXPECT_EQ(part.channels[0].sigma_row_dn, 0);
  EXPECT_EQ(part.channels[0].bias_dn, all.channels[0].bias_dn);
  const ChannelProfile dark = profile({{"shot", false}, {"quantization", false}}).channels[0];
  EXPECT_NEAR(dark.variance(500), all.channels[0].variance(0) - step_dn * step_dn / 12, 1e-9);
  // Nothing is left that a network could be told.
  const nlohmann::json none{{"read", false}, {"shot", false}, {"quantization", false}};
  EXPECT_NE(problem_of([&] { profile(none); }).find("package wants a level"), std::string::npos);
  PackageSettings& settings = shard.config.package.settings;
  settings.domain = "linear";
  settings.noise_input = "none";
  settings.row_noise = false;
  EXPECT_EQ(problem_of([&] { profile(none); }), "");
}

// [data] memory is reckoned with `example`.
TEST(ShardPairs, AreCutToExamples) {
  const TemporaryFolder folder;
  const RecordedShard shard(folder, 100, 100);
  const RawPair pair = make_pair_source(shard.config)->pair(1, 0);
  for (const Image& image : {pair.clean_dn, pair.noisy.dn}) {
    EXPECT_EQ(image.rows(), 32);
    EXPECT_EQ(image.cols(), 32);
  }
}

TEST(ShardPairs, FactsThatNoCameraHasAreNamed) {
  for (const auto& [facts, words] :
       {std::pair{R"({"ratio": 1, "removed_bias_dn": 0, "gain_db": 240, "iso": null})", "gain_db"},
        {R"({"ratio": 1, "removed_bias_dn": 0, "gain_db": "12", "iso": null})", "cannot be read"},
        {R"({"ratio": 1, "removed_bias_dn": 1e300, "gain_db": 12, "iso": null})", "1e+300"}}) {
    const TemporaryFolder folder;
    const RecordedShard shard(folder, 16, 16, 300, facts);
    const std::string line = problem_of([&] { make_pair_source(shard.config)->pair(1, 0); });
    EXPECT_NE(line.find("sample7"), std::string::npos) << line;
    EXPECT_NE(line.find(words), std::string::npos) << line;
  }
}

TEST(ShardPairs, SmallerThanAPatchAreNamed) {
  const TemporaryFolder folder;
  RecordedShard shard(folder, 16, 16);
  shard.config.data.example = shard.config.data.patch = 64;
  const auto worker = single_worker();
  const std::string line = problem_of([&] {
    train(shard.config, {folder / "run", false, false, 1}, *worker, silent_progress());
  });
  EXPECT_NE(line.find("sample7"), std::string::npos) << line;
}

// A pair of the camera's gain with files beside the list.
TrainingConfig recorded_list(const TemporaryFolder& folder, float value = 300) {
  for (const char* name : {"short.npy", "reference.npy"}) {
    Image image(64, 64);
    for (float& v : image.values()) v = value;
    SaveOptions save;
    save.force = true;
    save_picture(folder / name, image, save);
  }
  std::ofstream(folder / "pairs.json")
      << R"({"pairs": [{"short": "short.npy", "reference": "reference.npy", "ratio": 1,)"
      << R"( "gain_db": 12, "iso": null}]})";
  TrainingConfig config;
  config.source = "config.toml";
  config.package.settings.layout = "polar-mono";
  config.pairs = {folder / "pairs.json"};
  config.models = {"imx250mzr-simulated"};
  return config;
}

// One sample of a shard among three captured pairs of one list: a quarter of the examples.
TEST(RecordedPairs, AreMixedWithShardsByTheirNumbers) {
  const TemporaryFolder folder;
  TrainingConfig config = recorded_list(folder);
  const std::string pair =
      R"({"short": "short.npy", "reference": "reference.npy", "ratio": 1, "gain_db": 12, "iso": null})";
  std::ofstream(folder / "pairs.json")
      << R"({"pairs": [)" << pair << "," << pair << "," << pair << "]}";
  EXPECT_TRUE(make_pair_source(config)->shares().is_null());
  config.shards = RecordedShard(folder, 16, 16).config.shards;
  config.data.example = 16;
  const auto source = make_pair_source(config);
  EXPECT_EQ(source->shares()["samples of shards"]["share"], 0.25);
  EXPECT_EQ(source->shares()["captured pairs"]["size"], 3);
  int of_shard = 0;
  for (std::uint32_t i = 0; i < 400; ++i)
    of_shard += source->pair(5, i).noisy.source.find("sample7") != std::string::npos ? 1 : 0;
  EXPECT_NEAR(of_shard, 100, 5 * std::sqrt(400 * 0.25 * 0.75));
}

// What `malus pairs` writes without a model: the reference's bias is that of its own gain.
TEST(RecordedPairs, BiasThatAReferenceHoldsIsTakenOff) {
  const TemporaryFolder folder;
  const TrainingConfig config = recorded_list(folder);
  const NoiseProfile profile =
      load_model("imx250mzr-simulated").profile_at({.gain_db = 24, .iso = {}});
  const auto light = [&](const char* more) {
    std::ofstream(folder / "pairs.json")
        << R"({"pairs": [{"short": "short.npy", "reference": "reference.npy", "ratio": 10,)"
        << R"( "gain_db": 12, "iso": null)" << more << "}]}";
    return make_pair_source(config)->pair(1, 0).clean_dn(0, 0);
  };
  ASSERT_NE(profile.channels[0].bias_dn, 0);
  EXPECT_FLOAT_EQ(light(""), 30);
  EXPECT_FLOAT_EQ(
      light(R"(, "bias_removed": true, "reference_gain": {"gain_db": 24, "iso": null})"), 30);
  EXPECT_FLOAT_EQ(
      light(R"(, "bias_removed": false, "reference_gain": {"gain_db": 24, "iso": null})"),
      (300 - static_cast<float>(profile.channels[0].bias_dn)) / 10);
}

// A reference that is so bright in its upper left quarter.
void save_bright_corner(const TemporaryFolder& folder, double corner_dn) {
  Image reference(64, 64, 300.0f);
  for (int r = 0; r < 32; ++r)
    for (int c = 0; c < 32; ++c) reference(r, c) = static_cast<float>(corner_dn);
  SaveOptions save;
  save.force = true;
  save_picture(folder / "reference.npy", reference, save);
}

double white_of_camera() {
  const NoiseModel model = load_model("imx250mzr-simulated");
  return white_above_black(model.white_dn, model.black_dn);
}

TEST(RecordedPairs, WhiteOfAReferenceIsNotKnown) {
  const TemporaryFolder folder;
  const TrainingConfig config = recorded_list(folder);
  save_bright_corner(folder, white_of_camera());
  const Image clean_dn = make_pair_source(config)->pair(1, 0).clean_dn;
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c)
      if (r < 32 && c < 32)
        EXPECT_TRUE(std::isnan(clean_dn(r, c)));
      else
        EXPECT_EQ(clean_dn(r, c), 300);
  save_bright_corner(folder, 0.9 * white_of_camera());
  EXPECT_EQ(make_pair_source(config)->pair(1, 0).clean_dn(0, 0),
            static_cast<float>(0.9 * white_of_camera()));
}

// A display shows no more than white, so there white is what it should show.
TEST(RecordedPairs, WhiteIsATargetOfDisplayedPicturesAlone) {
  const TemporaryFolder folder;
  TrainingConfig config = recorded_list(folder);
  std::ofstream(folder / "pairs.json")
      << R"({"pairs": [{"short": "short.npy", "reference": "reference.npy", "ratio": 1,)"
      << R"( "gain_db": null, "iso": 1600}]})";
  config.models = {"nikon-d850"};
  const NoiseModel camera = load_model("nikon-d850");
  save_bright_corner(folder, white_above_black(camera.white_dn, camera.black_dn));
  PackageSettings& settings = config.package.settings;
  settings.layout = camera.layout.name();
  settings.domain = "linear";
  settings.residual = false;
  for (const char* target : {"rgb", "srgb"}) {
    settings.target = target;
    const RawPair pair = make_pair_source(config)->pair(1, 0);
    const torch::Tensor planes = make_example(pair, config.package).target;
    ASSERT_EQ(planes.sizes(), torch::IntArrayRef({3, 64, 64}));
    torch::Tensor unknown = torch::zeros({3, 64, 64}, torch::kBool);
    if (settings.target == "rgb") unknown.slice(1, 0, 32).slice(2, 0, 32).fill_(true);
    EXPECT_TRUE(torch::equal(planes.isnan(), unknown)) << target;
  }
}

TEST(RecordedPairs, ThatAreWhiteAllOverAreNamed) {
  const TemporaryFolder folder;
  const TrainingConfig config = recorded_list(folder, static_cast<float>(white_of_camera()));
  const std::string line = problem_of([&] { make_pair_source(config)->pair(1, 0); });
  EXPECT_NE(line.find("reference.npy: tells no light"), std::string::npos) << line;
}

// Whatever a reference holds where it is at white, the losses are the same.
TEST(RecordedPairs, WhiteOfAReferenceIsNotTaught) {
  const TemporaryFolder folder;
  TrainingConfig config = recorded_list(folder);
  config.package.network =
      fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
  config.data.example = config.data.patch = 64;
  config.train.steps = 3;
  config.train.batch = 1;
  const auto worker = single_worker();
  config.train.log_every = 1;
  const auto losses_of = [&](const char* run, double corner_dn) {
    save_bright_corner(folder, corner_dn);
    const auto record = train(config, {folder / run, false, false, 1}, *worker, silent_progress());
    std::vector<double> losses;
    for (const auto& line : record["log"]) losses.push_back(line["loss"].get<double>());
    return losses;
  };
  const auto white = losses_of("white", white_of_camera());
  EXPECT_EQ(white.size(), 3u);
  EXPECT_EQ(white, losses_of("whiter", 1.5 * white_of_camera()));
  EXPECT_LT(2 * white.front(), losses_of("grey", 0.5 * white_of_camera()).front());
}

TEST(RecordedPairs, AGainThatTheModelDoesNotKnowIsToldWithItsPair) {
  const TemporaryFolder folder;
  const TrainingConfig config = recorded_list(folder);
  std::ofstream(folder / "pairs.json")
      << R"({"pairs": [{"name": "night_00", "short": "short.npy", "reference": "reference.npy",)"
      << R"( "ratio": 1, "gain_db": 99, "iso": null}]})";
  const std::string line = problem_of([&] { make_pair_source(config); });
  EXPECT_NE(line.find("pairs.json: night_00 at 99 dB: "), std::string::npos) << line;
  EXPECT_EQ(line.find("extrapolate"), std::string::npos) << line;
}

TEST(RecordedPairs, NeedAModelOfThePackagesLayout) {
  const TemporaryFolder folder;
  RecordedShard shard(folder, 16, 16);
  TrainingConfig pairs = recorded_list(folder);
  for (TrainingConfig* config : {&shard.config, &pairs}) {
    config->models = {"imx250myr-simulated"};
    const std::string line = problem_of([&] { make_pair_source(*config); });
    EXPECT_NE(line.find("is of a sensor with the layout polar-bayer-rggb"), std::string::npos)
        << line;
  }
}

TEST(Contents, AreThoseOfShardsPairsAndModels) {
  const TemporaryFolder one, moved;
  const auto shard = [](const TemporaryFolder& folder, float value) {
    return config_json(RecordedShard(folder, 16, 16, value).config);
  };
  EXPECT_EQ(shard(one, 300), shard(moved, 300));
  EXPECT_NE(shard(one, 300), shard(one, 301));
  const auto pairs = [](const TemporaryFolder& folder, float value) {
    return config_json(recorded_list(folder, value));
  };
  EXPECT_EQ(pairs(one, 300), pairs(moved, 300));
  EXPECT_NE(pairs(one, 300), pairs(one, 301));
  const auto model = [](const TemporaryFolder& folder, const char* camera) {
    TrainingConfig config;
    save_model(load_model(camera), folder / "model.h5", true);
    config.models = {folder / "model.h5"};
    return config_json(config);
  };
  EXPECT_EQ(model(one, "nikon-d850"), model(moved, "nikon-d850"));
  EXPECT_NE(model(one, "nikon-d850"), model(one, "canon-5d4"));
}

TEST(Contents, OfAnotherKindAreAnotherRun) {
  const TemporaryFolder folder;
  const auto worker = single_worker();
  train(RecordedShard(folder, 16, 16, 300).config, {folder / "run", false, false, 1}, *worker,
        silent_progress());
  const std::string line = problem_of([&] {
    train(RecordedShard(folder, 16, 16, 301).config, {folder / "run", true, false, 1}, *worker,
          silent_progress());
  });
  EXPECT_NE(line.find("belongs to a run with other files of data.shards"), std::string::npos)
      << line;
}

TEST(Contents, OfACheckpointThatTellsNoneAreNotAskedFor) {
  const TemporaryFolder folder;
  const RecordedShard shard(folder, 16, 16);
  const auto worker = single_worker();
  const auto run = [&](bool resume) {
    train(shard.config, {folder / "run", resume, false, 1}, *worker, silent_progress());
  };
  run(false);
  TensorFile checkpoint = load_tensor_file(folder / "run/checkpoint.safetensors");
  std::string& text = checkpoint.metadata.at("malus_checkpoint");
  auto facts = nlohmann::json::parse(text);
  ASSERT_EQ(facts["description"].erase("contents"), 1u);
  text = facts.dump();
  save_tensor_file(checkpoint, folder / "run/checkpoint.safetensors");
  EXPECT_NO_THROW(run(true));
}

}  // namespace
}  // namespace malus
