// What a run leaves in its folder, and what it takes from there. Truth: an unbroken run in a folder
// of its own.
#include "malus/base/error.h"
#include "malus/neural/trainer.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

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

namespace fs = std::filesystem;

nlohmann::ordered_json run_in(const fs::path& folder, const TrainingConfig& config, bool resume,
                              bool force) {
  const auto worker = single_worker();
  return train(config, {folder, resume, force, 3}, *worker, silent_progress());
}

TrainingConfig validated_config(const AngleScene& scene) {
  TrainingConfig config = scene_config(scene);
  config.train.steps = 4;
  config.train.learning_rate = 1e-2;
  config.validation_scenes = {scene.path};
  config.cases = {{12, 10}};
  config.validation.every = 2;
  config.validation.crop = 48;
  return config;
}

std::vector<std::string> lines_of(const fs::path& log) {
  std::ifstream in(log);
  std::vector<std::string> lines;
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

// What the log says of validations.
std::vector<nlohmann::json> validations_of(const fs::path& log) {
  std::vector<nlohmann::json> found;
  for (const std::string& line : lines_of(log))
    if (const auto json = nlohmann::json::parse(line); json.contains("validation"))
      found.push_back(json);
  return found;
}

void expect_same_weights(const fs::path& one, const fs::path& other) {
  const auto a = weights_in(one), b = weights_in(other);
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::equal(a[i], b[i])) << i;
}

TrainingConfig one_step_config(const AngleScene& scene) {
  TrainingConfig config = scene_config(scene);
  config.train.steps = 1;
  return config;
}

TEST(RunFolder, FinishedWeightsAreNotReplacedUnasked) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const TrainingConfig config = one_step_config(scene);
  const fs::path run = folder / "run";
  run_in(run, config, false, false);
  fs::remove(run / "checkpoint.safetensors");
  for (const bool resume : {false, true})
    EXPECT_THROW(run_in(run, config, resume, false), InputError) << resume;
  EXPECT_NO_THROW(run_in(run, config, true, true));
  // A log alone is what a run leaves that was killed before its first checkpoint.
  fs::remove(run / "checkpoint.safetensors");
  fs::remove(run / "weights.safetensors");
  EXPECT_THROW(run_in(run, config, false, false), InputError);
  EXPECT_NO_THROW(run_in(run, config, true, false));
}

TEST(RunFolder, WeightsToBeginWithAreNotRemovedByTheRunThatReadsThem) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = one_step_config(scene);
  const fs::path run = folder / "run";
  run_in(run, config, false, false);
  fs::copy_file(run / "weights.safetensors", folder / "before.safetensors");
  config.begin_with = folder / "run/../run/weights.safetensors";
  EXPECT_THROW(run_in(run, config, false, true), InputError);
  expect_same_weights(run / "weights.safetensors", folder / "before.safetensors");
  EXPECT_TRUE(fs::exists(run / "checkpoint.safetensors"));
  EXPECT_NO_THROW(run_in(folder / "another", config, false, false));
}

TEST(RunFolder, ANewRunInheritsNothing) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const fs::path run = folder / "run";
  TrainingConfig config = validated_config(scene);
  run_in(run, config, false, false);
  ASSERT_TRUE(fs::exists(run / "best.safetensors"));
  ASSERT_TRUE(fs::exists(run / "sample" / "clean.npy"));
  std::ofstream(run / "sample" / "mine.txt") << "not of a run";
  const auto again = run_in(run, config, false, true);
  int starts = 0;
  for (const std::string& line : lines_of(run / "log.jsonl"))
    starts += nlohmann::json::parse(line)["step"] == 0 ? 1 : 0;
  EXPECT_EQ(starts, 1);
  EXPECT_EQ(again["log"].size(), lines_of(run / "log.jsonl").size());
  config.validation_scenes.clear();
  run_in(run, config, false, true);
  EXPECT_FALSE(fs::exists(run / "best.safetensors"));
  EXPECT_FALSE(fs::exists(run / "sample" / "clean.npy"));
  EXPECT_TRUE(fs::exists(run / "sample" / "mine.txt"));
  EXPECT_EQ(lines_of(run / "log.jsonl").size(), 4u);
}

// Ends a run before its first step, as a kill does.
class KilledBeforeTheFirstStep final : public Progress {
 public:
  void begin(std::string_view stage, std::int64_t) override {
    if (stage == "training") throw std::runtime_error("killed");
  }
  void advance(std::int64_t) override {}
  void warn(std::string_view) override {}
  bool stop_requested() const override { return false; }
};

TEST(RunFolder, TheRunThatWasToBeReplacedIsNotGoneOnWith) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const fs::path run = folder / "run";
  TrainingConfig config = scene_config(scene);
  config.train.steps = 2;
  run_in(run, config, false, false);
  config.train.steps = 3;
  const auto worker = single_worker();
  KilledBeforeTheFirstStep kill;
  EXPECT_THROW(train(config, {run, false, true, 3}, *worker, kill), std::runtime_error);
  EXPECT_FALSE(fs::exists(run / "checkpoint.safetensors"));
  EXPECT_FALSE(fs::exists(run / "weights.safetensors"));
  run_in(run, config, true, false);
  EXPECT_EQ(lines_of(run / "log.jsonl").size(), 3u);
}

// A long validation must not lose the steps before it.
TEST(RunFolder, TheCheckpointIsSavedBeforeTheValidation) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = validated_config(scene);
  config.validation.every = 4;
  run_in(folder / "run", config, false, false);
  EXPECT_LE(fs::last_write_time(folder / "run" / "checkpoint.safetensors"),
            fs::last_write_time(folder / "run" / "best.safetensors"));
}

TEST(RunFolder, KilledWhileItValidatesARunGoesOnWithTheValidation) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const TrainingConfig config = validated_config(scene);
  run_in(folder / "once", config, false, false);
  const fs::path parts = folder / "parts";
  {
    const auto worker = single_worker();
    StopAfter stop(3);  // its first advance is that of no step
    EXPECT_THROW(train(config, {parts, false, false, 3}, *worker, stop), Cancelled);
  }
  // As if it had been killed then: the checkpoint is there, what the validation writes is not.
  std::string kept;
  for (const std::string& line : lines_of(parts / "log.jsonl"))
    if (line.find("validation") == std::string::npos) kept += line + "\n";
  std::ofstream(parts / "log.jsonl") << kept;
  fs::remove(parts / "best.safetensors");
  run_in(parts, config, true, false);
  EXPECT_EQ(validations_of(parts / "log.jsonl"), validations_of(folder / "once" / "log.jsonl"));
  EXPECT_EQ(validations_of(parts / "log.jsonl").size(), 2u);
  for (const char* file : {"weights.safetensors", "best.safetensors", "checkpoint.safetensors"})
    expect_same_weights(parts / file, folder / "once" / file);
}

// The best score so far is known although the checkpoint was saved before that validation.
TEST(RunFolder, AWorseValidationAfterAnInterruptionReplacesNoBest) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const TrainingConfig config = validated_config(scene);
  const auto once = run_in(folder / "once", config, false, false);
  ASSERT_EQ(load_package(folder / "once" / "best.safetensors").package.training["steps"], 2);
  {
    const auto worker = single_worker();
    StopAfter stop(3);  // its first advance is that of no step
    EXPECT_THROW(train(config, {folder / "parts", false, false, 3}, *worker, stop), Cancelled);
  }
  const auto parts = run_in(folder / "parts", config, true, false);
  EXPECT_EQ(parts["best_score_db"], once["best_score_db"]);
  expect_same_weights(folder / "parts" / "best.safetensors", folder / "once" / "best.safetensors");
}

// The stages that a run went through.
class Stages final : public Progress {
 public:
  void begin(std::string_view stage, std::int64_t) override { begun.emplace_back(stage); }
  void advance(std::int64_t) override {}
  void warn(std::string_view) override {}
  bool stop_requested() const override { return false; }
  bool has(const std::string& stage) const {
    return std::find(begun.begin(), begun.end(), stage) != begun.end();
  }
  std::vector<std::string> begun;
};

TEST(RunFolder, AFinishedRunIsToldAtOnce) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const fs::path run = folder / "run";
  TrainingConfig config = validated_config(scene);
  const auto first = run_in(run, config, false, false);
  const auto again = [&] {
    Stages stages;
    const auto worker = single_worker();
    auto record = train(config, {run, true, false, 3}, *worker, stages);
    EXPECT_EQ(record.contains("finished_before"), stages.begun.empty());
    record.erase("finished_before");
    EXPECT_EQ(record, first);
    return stages;
  };
  const auto written = fs::last_write_time(run / "weights.safetensors");
  EXPECT_TRUE(again().begun.empty());
  EXPECT_EQ(fs::last_write_time(run / "weights.safetensors"), written);
  // Whatever is missing is made again.
  for (const char* file : {"weights.safetensors", "sample/clean.npy", "log.jsonl"}) {
    fs::remove(run / file);
    Stages stages;
    const auto worker = single_worker();
    const auto record = train(config, {run, true, false, 3}, *worker, stages);
    EXPECT_TRUE(stages.has("training")) << file;
    EXPECT_EQ(record["noisy"], first["noisy"]) << file;
    EXPECT_TRUE(fs::exists(run / file));
  }
  fs::copy_file(run / "best.safetensors", run / "weights.safetensors",
                fs::copy_options::overwrite_existing);
  EXPECT_EQ(load_package(run / "best.safetensors").package.training["steps"], 2);
  Stages stages;
  const auto worker = single_worker();
  train(config, {run, true, false, 3}, *worker, stages);
  EXPECT_TRUE(stages.has("training"));
}

// Does something else once, between two steps.
class BetweenSteps final : public Progress {
 public:
  explicit BetweenSteps(std::function<void()> act) : act_(std::move(act)) {}
  void begin(std::string_view stage, std::int64_t) override { training_ = stage == "training"; }
  void advance(std::int64_t) override {
    if (!training_) return;
    if (const auto act = std::exchange(act_, nullptr)) act();
  }
  void warn(std::string_view) override {}
  bool stop_requested() const override { return false; }

 private:
  std::function<void()> act_;
  bool training_ = false;
};

TEST(RunFolder, TwoRunsDoNotWriteIntoOneFolder) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const TrainingConfig config = validated_config(scene);
  const fs::path run = folder / "run";
  // As a killed run leaves it.
  fs::create_directories(run);
  std::ofstream(run / ".lock").close();
  int refused = 0;
  BetweenSteps progress([&] {
    TrainingConfig other = config;
    other.train.steps = 2;
    for (const bool resume : {false, true})
      for (const bool force : {false, true}) try {
          run_in(run, other, resume, force);
        } catch (const InputError& error) {
          refused += std::string(error.what()).find("another training") != std::string::npos;
        }
  });
  const auto worker = single_worker();
  train(config, {run, false, false, 3}, *worker, progress);
  EXPECT_EQ(refused, 4);
  EXPECT_FALSE(fs::exists(run / ".lock"));
  run_in(folder / "alone", config, false, false);
  EXPECT_EQ(lines_of(run / "log.jsonl").size(), lines_of(folder / "alone" / "log.jsonl").size());
  for (const char* file : {"weights.safetensors", "best.safetensors", "checkpoint.safetensors"})
    expect_same_weights(run / file, folder / "alone" / file);
  EXPECT_NO_THROW(run_in(run, config, true, false));
}

TEST(RunFolder, TheLightOfTheExamplesIsMeasuredOnce) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  const TrainingConfig config = scene_config(scene);
  const auto worker = single_worker();
  {
    StopAfter stop(4);
    EXPECT_THROW(train(config, {folder / "run", false, false, 3}, *worker, stop), Cancelled);
  }
  Stages stages;
  train(config, {folder / "run", true, false, 3}, *worker, stages);
  EXPECT_TRUE(stages.has("training"));
  EXPECT_FALSE(stages.has("light of the examples"));
  run_in(folder / "once", config, false, false);
  EXPECT_EQ(load_package(folder / "run" / "weights.safetensors").package.brightest,
            load_package(folder / "once" / "weights.safetensors").package.brightest);
}

}  // namespace
}  // namespace malus
