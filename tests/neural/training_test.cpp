// Truth: closed forms (a scene whose angle is known), and that the same run comes out however it is
// cut into parts or shared by workers.
#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/neural/internal/checkpoint.h"
#include "malus/neural/internal/clean_scenes.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/internal/training_log.h"
#include "malus/neural/trainer.h"
#include "malus/synthesize/scene.h"

#include <cmath>
#include <fstream>
#include <numbers>

#include "problem_of.h"
#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::scene_config;
using testing::StopAfter;
using testing::TemporaryFolder;
using testing::weights_in;

// Mirrored and turned, the light's angle turns with the picture: every piece of the scene has one
// angle, 30 degrees or what the symmetry makes of it, and the mosaic shows it behind the
// polarizers where the sensor has them.
TEST(Augmentation, TurnsPolarizationWithThePicture) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const CleanScenes scenes(scene_config(scene));
  std::map<int, int> seen;
  for (std::uint32_t number = 0; number < 60; ++number) {
    const auto piece = scenes.draw(5, number);
    ASSERT_EQ(piece.size(), 3u);
    const StokesPlanes& red = piece[0];
    // Which way the light rises tells the symmetry, up to the mirror images that it cannot tell.
    const double right = red.s0(0, red.s0.cols() - 1) - red.s0(0, 0);
    const double down = red.s0(red.s0.rows() - 1, 0) - red.s0(0, 0);
    const double angle = aolp_deg_of({red.s0(3, 3), red.s1(3, 3), red.s2(3, 3)});
    EXPECT_NEAR(dolp_of({red.s0(3, 3), red.s1(3, 3), red.s2(3, 3)}), AngleScene::kDegree, 1e-3);
    if (std::abs(right) > std::abs(down)) {  // identity, half turn: 30; mirrored: 150
      EXPECT_LT(std::min(std::abs(angle - 30), std::abs(angle - 150)), 0.1) << number;
    } else {  // quarter turns: 120; transposed: 60
      EXPECT_LT(std::min(std::abs(angle - 120), std::abs(angle - 60)), 0.1) << number;
    }
    ++seen[static_cast<int>(std::lround(angle))];
    const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
    const Image mosaic = mosaic_of(piece, layout);
    const int channel = layout.channel_at(1, 1);  // R0
    ASSERT_EQ(layout.channel_name(channel), "R0");
    const double expected =
        0.5 * red.s0(1, 1) * (1 + AngleScene::kDegree * std::cos(std::numbers::pi / 90 * angle));
    EXPECT_NEAR(mosaic(1, 1), expected, 1e-3 * expected);
  }
  EXPECT_EQ(seen.size(), 4u);
}

TEST(Training, GoesOnToTheSameBitsAsAnUnbrokenRun) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  const auto worker = single_worker();
  const auto once = train(config, {folder / "once", false, false, 3}, *worker, silent_progress());
  EXPECT_EQ(once["steps"], 7);
  EXPECT_EQ(once["log"].size(), 7u);
  StopAfter stop(4);
  EXPECT_THROW(train(config, {folder / "parts", false, false, 3}, *worker, stop), Cancelled);
  const auto parts = train(config, {folder / "parts", true, false, 3}, *worker, silent_progress());
  EXPECT_EQ(parts["log"].size(), 7u);
  for (const char* file : {"weights.safetensors", "checkpoint.safetensors"}) {
    const auto a = weights_in(folder / "once" / file), b = weights_in(folder / "parts" / file);
    ASSERT_EQ(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::equal(a[i], b[i])) << file << i;
  }
  // Another seed is another run; other settings are refused, and so is a run over an old one.
  const auto other = train(config, {folder / "other", false, false, 4}, *worker, silent_progress());
  EXPECT_NE(other["log"].back()["loss"], once["log"].back()["loss"]);
  EXPECT_THROW(train(config, {folder / "once", false, false, 3}, *worker, silent_progress()),
               InputError);
  config.train.learning_rate *= 2;
  EXPECT_THROW(train(config, {folder / "once", true, false, 3}, *worker, silent_progress()),
               InputError);
}

TEST(Training, BeginsWithTheWeightsOfAnotherRun) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  const auto worker = single_worker();
  train(config, {folder / "first", false, false, 3}, *worker, silent_progress());
  // With a rate of 0 nothing moves: what comes out is what went in, whatever the seed.
  config.begin_with = folder / "first/weights.safetensors";
  config.train.learning_rate = 0;
  config.train.average = 0;
  train(config, {folder / "second", false, false, 4}, *worker, silent_progress());
  const auto a = weights_in(config.begin_with),
             b = weights_in(folder / "second/weights.safetensors");
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::equal(a[i], b[i])) << i;
  EXPECT_EQ(load_package(folder / "second/weights.safetensors").package.training["begin_with"],
            "weights.safetensors");
  config.package.settings.noise_input = "none";
  config.package.network = fitted_network(config.package.network, config.package.settings);
  try {
    train(config, {folder / "third", false, false, 4}, *worker, silent_progress());
    ADD_FAILURE() << "weights of another network were taken";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what())
                  .find("first/weights.safetensors: is of another package.noise_input than "),
              std::string::npos)
        << error.what();
  }
}

TEST(Training, ResidualNetworksBeginByReturningTheirBase) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const std::vector<NetworkDescription> networks = {
      {"unet", {{"width", 4}, {"levels", 2}}},
      {"nafnet",
       {{"width", 4}, {"middle_blk_num", 1}, {"enc_blk_nums", {1}}, {"dec_blk_nums", {1}}}},
      {"restormer",
       {{"dim", 8},
        {"num_blocks", {1, 1, 1, 1}},
        {"num_refinement_blocks", 1},
        {"heads", {1, 1, 1, 1}}}},
      {"uformer", {{"embed_dim", 4}, {"num_heads", {1, 1, 1, 1, 1, 1, 1, 1, 1}}}},
      {"malus", {{"dim", 8}, {"depths", {1, 1}}, {"heads", {1, 1}}}}};
  const auto worker = single_worker();
  for (const NetworkDescription& network : networks) {
    TrainingConfig config = scene_config(scene);
    config.package.settings.layout = "polar-mono";
    config.package.network = fitted_network(network, config.package.settings);
    config.models = {"imx250mzr-simulated"};
    config.train.steps = 1;
    const auto run =
        train(config, {folder / network.architecture, false, false, 3}, *worker, silent_progress());
    const auto& line = run["log"].back();
    EXPECT_NEAR(line["loss"].get<double>(), line["base_loss"].get<double>(), 1e-6)
        << network.architecture;
    EXPECT_GT(line["gradient_norm"].get<double>(), 0) << network.architecture;
  }
}

TEST(Training, HalfTheBitsGiveNearlyTheSameLoss) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.package.settings.residual = false;
  config.train.steps = 1;
  const auto worker = single_worker();
  const auto full = train(config, {folder / "full", false, false, 3}, *worker, silent_progress());
  config.train.precision = "bfloat16";
  const auto half = train(config, {folder / "half", false, false, 3}, *worker, silent_progress());
  const double loss = full["log"].back()["loss"].get<double>();
  EXPECT_NE(half["log"].back()["loss"].get<double>(), loss);
  EXPECT_NEAR(half["log"].back()["loss"].get<double>(), loss, 0.02 * loss);  // 8 bits of mantissa
  config.package.network.architecture = "restormer";
  EXPECT_THROW(train(config, {folder / "other", false, false, 3}, *worker, silent_progress()),
               InputError);
}

TEST(Training, LearnsToRemoveNoise) {
  const TemporaryFolder folder;
  const AngleScene scene(folder, 96, 96);
  TrainingConfig config = scene_config(scene);
  config.package.settings.layout = "polar-mono";
  config.package.settings.noise_input = "units";
  config.package.network =
      fitted_network({"unet", {{"width", 12}, {"levels", 2}}}, config.package.settings);
  config.models = {"imx250mzr-simulated"};
  config.noise.ratio_low = config.noise.ratio_high = 10;
  config.noise.gains = {12};
  config.train.steps = 150;
  config.train.learning_rate = 3e-3;
  config.train.average = 0.9;
  config.train.log_every = 150;
  config.validation_scenes = {scene.path};
  config.cases = {{12, 10}};
  config.validation.every = 150;
  const auto worker = single_worker();
  const auto run = train(config, {folder / "run", false, false, 1}, *worker, silent_progress());
  // A short run on a tiny network; a long one would earn several times as much.
  EXPECT_GT(run["log"].back()["validation"]["image_psnr_db"].get<double>(),
            run["noisy"]["image_psnr_db"].get<double>() + 1);
  const LoadedPackage loaded = load_package(folder / "run" / "weights.safetensors");
  EXPECT_EQ(loaded.package.training["steps"], 150);
}

TEST(Log, DropsWhatTheCheckpointDoesNotKnow) {
  const TemporaryFolder folder;
  std::ofstream(folder / "log.jsonl") << "{\"step\":1}\n{\"step\":5}\n{\"step\":\"2\"}\n{\"st";
  TrainingLog log(folder / "log.jsonl", 3);
  log.write({{"step", 4}});
  EXPECT_EQ(log.lines().size(), 2u);
  std::ifstream in(folder / "log.jsonl");
  std::string text((std::istreambuf_iterator<char>(in)), {});
  EXPECT_EQ(text, "{\"step\":1}\n{\"step\":4}\n");
}

TEST(Config, NamesWhatIsWrong) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const std::string good =
      "[network]\narchitecture = \"unet\"\nwidth = 4\n[data]\nscenes = [\"scene\"]\nexample = 48\n"
      "patch = 32\n[noise]\nmodels = [\"imx250myr-simulated\"]\n[train]\nsteps = 5\n";
  const auto load = [&](const std::string& text) {
    std::ofstream(folder / "config.toml") << text;
    return load_training_config(folder / "config.toml");
  };
  EXPECT_EQ(load(good).package.network.settings["in_channels"], 17);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string text = good;
    text.replace(text.find(from), from.size(), to);
    return text;
  };
  for (const auto& [from, to, word] : std::vector<std::array<const char*, 3>>{
           {"unet", "unett", "unet"},
           {"width = 4", "widht = 4", "width"},
           {"width = 4", "width = \"a\"", "width"},
           {"[\"scene\"]", "[\"nothing*\"]", "nothing"},
           {"patch = 32", "patch = 30", "patch"},
           {"patch = 32", "patch = 64", "patch"},
           {"steps = 5", "steps = 0", "steps"},
           {"steps = 5", "loss = \"l2\"", "loss"},
           {"models = [\"imx250myr-simulated\"]", "ratio_low = 5", "ratio_low"},
           {"[noise]", "[noise]\nratio = 5", "ratio"},
           {"[train]", "[trian]", "trian"}}) {
    try {
      load(with(from, to));
      ADD_FAILURE() << to << " was taken";
    } catch (const InputError& error) {
      const std::string text = error.what();
      EXPECT_NE(text.find(word), std::string::npos) << text;
      EXPECT_EQ(text.find('\n'), std::string::npos) << text;
    }
  }
}

TEST(Config, NamesFileLineAndValues) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const auto problem = [&](const std::string& package, const std::string& models,
                           const std::vector<std::string>& settings = {}) {
    std::ofstream(folder / "c.toml") << "[network]\narchitecture = \"unet\"\n[package]\n"
                                     << package << "\n[data]\n"
                                     << "scenes = [\"scene\"]\nexample = 48\npatch = 32\n[noise]\n"
                                     << models << '\n';
    const std::string line = testing::problem_of([&] {
      load_training_config(folder / "c.toml", {.pairs = {}, .models = {}, .settings = settings});
    });
    const std::size_t name = line.find("c.toml:");
    return name == line.npos ? line : line.substr(name);
  };
  const std::string layout = "layout = \"polar-mono\"", model = "models = [\"nikon-d850\"]";
  EXPECT_EQ(problem(layout, model), "");
  EXPECT_EQ(problem("layout = \"polar\"", model)
                .find("c.toml:4: layout in [package]: layout "
                      "\"polar\": is no known sensor layout"),
            0u);
  EXPECT_EQ(problem("target = \"rgb\"", model).find("c.toml:4: target in [package]: target = "),
            0u);
  EXPECT_EQ(problem(layout, "models = [\"nobody\"]").find("c.toml:10: models in [noise]: nobody: "),
            0u);
  EXPECT_EQ(problem(layout, "").find("c.toml:9: models in [noise] is missing"), 0u);
  EXPECT_EQ(problem(layout, model, {"data.patch=63"})
                .find("set data.patch=63: patch in [data] = "
                      "63 is not made of whole cells"),
            0u);
  EXPECT_EQ(problem(layout, model, {"data.example=16"}),
            "c.toml:8: patch in [data] = 32 is larger than example = 16; make example as large, or "
            "patch smaller");
  EXPECT_NE(problem(layout, model, {"network.levels=40"}).find("set network.levels=40: levels in "),
            std::string::npos);
}

TEST(Config, TakesTheNamedSizesAndTheLossOfTheLayout) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const auto load = [&](const std::string& network, const std::string& more) {
    std::ofstream(folder / "config.toml")
        << "[network]\narchitecture = \"" << network << "\n[package]\nlayout = \"bayer-rggb\"\n"
        << "[data]\nscenes = [\"scene\"]\nexample = 48\npatch = 32\n[noise]\n"
        << "models = [\"nikon-d850\"]\n[train]\nsteps = 5\n"
        << more;
    return load_training_config(folder / "config.toml");
  };
  const TrainingConfig plain = load("malus-base\"", "");
  EXPECT_EQ(plain.train.loss, "l1");
  EXPECT_EQ(plain.package.network.architecture, "malus");
  EXPECT_EQ(plain.package.network.settings["dim"], 48);
  EXPECT_EQ(load("malus-base\"\ndim = 16", "").package.network.settings["dim"], 16);
  EXPECT_EQ(load("malus-base\"\ndim = 16", "").package.network.settings["depths"][3], 6);
  EXPECT_EQ(load("uformer-t\"", "").package.network.settings["embed_dim"], 16);
  EXPECT_EQ(load("nafnet-32\"", "").package.network.architecture, "nafnet");
  const auto problem = [&](const std::string& network, const std::string& more) {
    try {
      load(network, more);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("was taken");
  };
  EXPECT_NE(problem("unet\"", "loss = \"both\"").find("config.toml:13"), std::string::npos);
  EXPECT_NE(problem("malus-bose\"", "").find("\"malus-base\"?"), std::string::npos);
}

}  // namespace
}  // namespace malus
