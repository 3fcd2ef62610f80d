// Clean scenes with a camera's noise, and how near a denoiser comes to them: what the
// experiments on denoising share.
#pragma once

#include "malus/evaluate/evaluation.h"
#include "malus/noise/model.h"
#include "malus/synthesize/scene_frames.h"

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "denoiser_by_ratio.h"
#include "program.h"
#include <nlohmann/json.hpp>

namespace malus::app {

/// As parsed_light_case; throws InputError.
LightCase light_case_of(const std::string& text);

/// clean_scene of a folder with I0, I45, I90, I135, or of one picture (of integers: sRGB; of
/// floats: linear). Throws InputError.
CleanScene load_scene(const std::filesystem::path& path, const NoiseModel& model, int crop);

/// Sums over frames.
struct SceneSums {
  double image_psnr_db = 0, seconds = 0;
  MeanOfDecided image_ssim = {}, dolp_psnr_db = {}, aolp_psnr_db = {}, aolp_deg = {};
  int count = 0;
};

/// The light that a frame was taken in.
struct ScoredLight {
  std::string name;  ///< "12:10": gain in its unit and low-light ratio, as --cases has them
  GainSetting gain;
  double ratio = 1;
};

/// Of all frames, and of those of each light, which its name tells apart; in the order of the runs.
struct SceneScore {
  std::string name;
  SceneSums sums = {};
  std::vector<std::pair<ScoredLight, SceneSums>> by_case = {};
};

/// One noisy frame of a scene.
struct NoisyScene {
  RawFrame frame;
  NoiseProfile profile;
  /// Its pixels that are no numbers are not known, and no score counts them; one at least is known.
  const CleanScene* clean = nullptr;
  double ratio = 1;     ///< light of the clean scene over that of the frame
  double range_dn = 0;  ///< white above black, in the light of the clean scene
  bool drawn = true;    ///< its noise is of the profile's model; else it is a camera's own
};
/// The same seed gives the same frame.
NoisyScene make_noisy(const CleanScene& scene, const LightCase& light,
                      const std::shared_ptr<const NoiseModel>& camera, std::uint64_t seed);

/// What is done with each frame.
using SceneRun = std::function<void(NoisyScene& noisy, const ScoredLight& light)>;

/// What an experiment on clean scenes goes through.
struct SceneRuns {
  std::vector<std::filesystem::path> scenes;
  std::string model = "imx250myr-simulated";
  std::vector<std::string> cases{"12:10", "12:60", "24:10"};  ///< of light_case_of
  int crop = 512;

  /// Scenes and model, as they were named.
  std::vector<std::filesystem::path> files_named() const;
  /// The scenes under the name that is given (may be left out, as far as this asks), --model,
  /// --cases, --crop.
  void add_options(CLI::App& command, const std::string& scenes_name = "SCENE",
                   const std::string& scenes_note = "");
  /// The model; says on stderr what gains it is taken for if it does not tell its own. Throws
  /// InputError.
  NoiseModel load_camera() const;
  /// The cases, with gains in the model's unit.
  std::vector<ScoredLight> lights(const NoiseModel& model) const;
  /// Every case of every scene in turn, as the model draws it; seeds count up from the first.
  /// Throws InputError, Cancelled.
  void for_each(const NoiseModel& drawn_by, std::uint64_t seed, Progress& progress,
                const SceneRun& run) const;
};

/// Adds what is left of the frame's noise: of the frame itself without a denoiser. Says on stderr
/// where a camera's own noise is not that of the profile.
void add_to_score(SceneScore& score, const NoisyScene& scene, const ScoredLight& light,
                  DenoiserByRatio* denoiser);

/// Means as JSON, as a table for people, and as a record that a report shows (docs/report.md): over
/// all cases and, but in the first table, of each.
nlohmann::ordered_json score_json(const std::vector<SceneScore>& scores);
std::string score_text(const std::vector<SceneScore>& scores);
/// The same, and where there are several cases a table of each.
std::string score_text_by_case(const std::vector<SceneScore>& scores);
/// of: what the means are over, "scenes" or "frames"; note: what they are.
nlohmann::ordered_json score_record(const std::string& title, const std::string& of,
                                    const std::string& note, const std::vector<SceneScore>& scores);

/// "12 dB at 1/10 and 1/60 of the light; 24 dB at 1/10 of the light".
std::string cases_text(const std::vector<ScoredLight>& lights);

/// The last part of a path, of "scenes/holiday/", too.
std::string name_of_scene(const std::filesystem::path& path);

/// "bm3d", "bm3d/fast", "bm3d/normal/no-row-noise", "folder/weights.safetensors". Throws InputError
/// on words that are none; the file is not looked for.
DenoiseSettings method_settings_of(const std::string& text);

}  // namespace malus::app
