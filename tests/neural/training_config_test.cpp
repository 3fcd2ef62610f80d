// What a training configuration may say. Truth: the settings that the test wrote.
#include "malus/neural/training_config.h"

#include "malus/io/picture_file.h"
#include "malus/neural/trainer.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "problem_of.h"
#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;
using testing::TemporaryFolder;

// One that says nothing of an example is refused, and named.
TEST(Settings, OfPicturesAreRefusedWhereThereAreNone) {
  const TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  save_picture(folder / "frame.npy", Image(64, 64, 300.0F));
  std::ofstream(folder / "pairs.json")
      << R"({"pairs": [{"short": "frame.npy", "reference": "frame.npy", "ratio": 1,)"
      << R"( "gain_db": 12, "iso": null}]})";
  std::ofstream(folder / "config.toml")
      << "[network]\narchitecture = \"unet\"\n[package]\nlayout = \"polar-mono\"\n"
      << "[data]\npairs = [\"pairs.json\"]\nexample = 64\npatch = 32\npool = 2\n"
      << "[noise]\nmodels = [\"imx250mzr-simulated\"]\n[train]\nbatch = 1\n";
  const auto load = [&](std::vector<std::string> settings,
                        const std::vector<std::filesystem::path>& pairs = {}) {
    return problem_of([&] {
      load_training_config(folder / "config.toml",
                           {.pairs = pairs, .models = {}, .settings = std::move(settings)});
    });
  };
  const std::string validation = R"(validation.scenes=["scene"])",
                    cases = R"(validation.cases=["12:10"])";
  EXPECT_EQ(load({}), "");
  EXPECT_EQ(load({"noise.extrapolate_gain=true"}), "");
  for (const auto& [setting, key] : {std::pair{"noise.jitter=0.2", "jitter in [noise]"},
                                     {"noise.gains=[6]", "gains in [noise]"},
                                     {"noise.read=false", "read in [noise]"},
                                     {"data.zoom=2", "zoom in [data]"},
                                     {"data.tone=linear", "tone in [data]"}}) {
    const std::string line = load({setting});
    EXPECT_NE(line.find(std::string(key) + " means nothing to shards"), std::string::npos) << line;
    EXPECT_EQ(load({setting, R"(data.scenes=["scene"])"}), "");
    EXPECT_EQ(load({setting}, {folder / "pairs.json"}), "");
  }
  EXPECT_EQ(load({"noise.read=false", validation, cases}), "");
  EXPECT_NE(load({"noise.ratio_low=0.5", validation, cases}), "");
}

TEST(Settings, AreNamedByTheKeyThatIsWrong) {
  const TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  std::ofstream(folder / "config.toml")
      << "[network]\narchitecture = \"unet\"\nlevels = 2\n[package]\nlayout = \"polar-mono\"\n"
      << "[data]\nscenes = [\"scene\"]\nexample = 64\npatch = 32\npool = 2\n"
      << "[noise]\nmodels = [\"imx250mzr-simulated\"]\n[train]\nbatch = 1\n";
  const auto load = [&](const char* setting) {
    return problem_of([&] {
      load_training_config(folder / "config.toml",
                           {.pairs = {}, .models = {}, .settings = {setting}});
    });
  };
  for (const auto& [setting, key] :
       {std::pair{"network.levels=9", "levels in [network]"},
        {"package.amplification=ratio", "amplification in [package] means nothing"}}) {
    const std::string line = load(setting);
    EXPECT_NE(line.find(key), std::string::npos) << line;
  }
}

TEST(Settings, AWarmUpLongerThanTheTrainingIsTold) {
  struct Told final : Progress {
    int warnings = 0;
    void begin(std::string_view, std::int64_t) override {}
    void advance(std::int64_t) override {}
    bool stop_requested() const override { return false; }
    void warn(std::string_view line) override {
      warnings += line.find("warm_up = ") != std::string_view::npos ? 1 : 0;
    }
  };
  const TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = testing::scene_config(scene);
  config.train.steps = config.train.batch = 1;
  const auto worker = single_worker();
  for (const int warm_up : {0, 1}) {
    config.train.warm_up = warm_up;
    Told told;
    train(config, {folder / "run", false, true, 1}, *worker, told);
    EXPECT_EQ(told.warnings, warm_up);
  }
}

// The pool, and the two generations that are made ahead of it.
TEST(Memory, CountsTheGenerationsThatAreMadeAhead) {
  const TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  // 4 planes out, 5 in: 9 * 4 bytes * 512 * 512 / 4 = 2.25 MiB for each example.
  std::ofstream(folder / "config.toml")
      << "[network]\narchitecture = \"unet\"\n[package]\nlayout = \"polar-mono\"\n"
      << "[data]\nscenes = [\"scene\"]\nexample = 512\npatch = 32\npool = 8\nmemory = 18\n"
      << "[noise]\nmodels = [\"imx250mzr-simulated\"]\n[train]\nbatch = 1\n";
  const auto load = [&](const char* setting) {
    return problem_of([&] {
      load_training_config(folder / "config.toml",
                           {.pairs = {}, .models = {}, .settings = {setting}});
    });
  };
  EXPECT_EQ(load("data.pool=6"), "");
  EXPECT_NE(load("data.pool=7").find("would take up to 21 MiB"), std::string::npos);
}

}  // namespace
}  // namespace malus
