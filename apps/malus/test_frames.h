// What the experiments on denoising score on: clean scenes with drawn noise, or captured frames
// against their references.
#pragma once

#include "malus/io/pair_list.h"
#include "malus/noise/model.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "program.h"
#include "scene_scores.h"
#include <nlohmann/json.hpp>

namespace malus::app {

/// What the user names.
struct TestFrames {
  SceneRuns scenes;
  std::vector<std::filesystem::path> pairs;  ///< lists of malus pairs, in place of the scenes
  bool estimate_noise = false;               ///< of every frame, in place of the model's

  /// As SceneRuns, and --test-pairs.
  void add_options(CLI::App& command, const std::string& scenes_name = "SCENE",
                   const std::string& scenes_note = "");
  bool captured() const { return !pairs.empty(); }
  /// Whether --model was given: captures are of a camera that nobody can guess.
  bool model_given() const { return model_option_->count() > 0; }
  /// Throws CLI::Error where there is nothing to score on, or no noise of captures.
  void check_usage() const;
  /// Scenes, lists and model, as they were named.
  std::vector<std::filesystem::path> files_named() const;

 private:
  const CLI::Option* model_option_ = nullptr;
  std::string scenes_name_;
};

/// The same, opened: model loaded, captures looked at.
class OpenTestFrames {
 public:
  /// row_noise: in place of the model's, of scenes (with_row_noise). Throws InputError as
  /// SceneRuns::load_camera and open_pairs. `named` must stay.
  explicit OpenTestFrames(const TestFrames& named, std::optional<double> row_noise = std::nullopt);

  /// Null where captures are scored whose noise is estimated.
  const NoiseModel* model() const { return model_ ? &*model_ : nullptr; }
  /// As SceneRuns::for_each; of captures by gain, then by ratio. Pixels of a reference that tell no
  /// light (mark_unknown, malus/synthesize/pairs.h) are no numbers. Throws InputError, Cancelled.
  void for_each(std::uint64_t seed, Progress& progress, const SceneRun& run);
  /// Captures whose short frame is in these lists, too: they would be scored on what they taught.
  std::vector<std::string> shared_with(const std::vector<RecordedPair>& trained_on) const;

  /// What was scored on, for JSON: model, cases, crop; of captures their lists and names, too.
  nlohmann::ordered_json facts() const;
  /// score_record with a note of it.
  nlohmann::ordered_json record(const std::string& title,
                                const std::vector<SceneScore>& scores) const;

 private:
  struct Capture {
    RecordedPair pair;
    ScoredLight light;
    double unknown_share = 0;  ///< of the reference's pixels; known once it was scored
  };
  void open_captures();
  void run_capture(Capture& capture, const SceneRun& run) const;
  std::vector<ScoredLight> lights() const;
  std::string note() const;

  const TestFrames& named_;
  std::optional<NoiseModel> model_;
  std::vector<Capture> captures_;
};

}  // namespace malus::app
