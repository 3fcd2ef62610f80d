// malus pairs: training pairs from a captured session (000 section 4).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/frame_stack.h"
#include "malus/io/gain_json.h"
#include "malus/io/picture_file.h"
#include "malus/io/session.h"
#include "malus/noise/model.h"
#include "malus/noise/raw_variance.h"
#include "malus/noise/same_sensor.h"
#include "malus/synthesize/pairs.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "flags.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

// Lamps flicker by some per cent, and exposures are not off by more: beyond this a pair is no pair.
constexpr double kMostDeviation = 0.2;

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct PairsArguments {
  fs::path session, folder, model;
  std::optional<double> ratio;
};

// Groups of one scene: the label `level`, or none.
struct Scene {
  const FrameGroup* reference = nullptr;
  std::vector<const FrameGroup*> shorts;
};

struct PairJob {
  const PairsArguments& arguments;
  const Common& common;
  const Session& session;
  const std::optional<NoiseModel>& model;
  Progress& progress;
  std::vector<fs::path>& written;  ///< pictures, of no use without the list that comes last
};

std::string scene_name(const std::optional<int>& label) {
  return label ? fmt::format("scene{:03}", *label) : "scene";
}

// The noise of a frame that its reference is the mean of would be in both.
void refuse_shared_frames(const Session& session, const std::string& name, const Scene& scene) {
  std::set<fs::path> of_reference;
  for (const fs::path& path : scene.reference->paths) of_reference.insert(frame_identity(path));
  for (const FrameGroup* group : scene.shorts)
    for (const fs::path& path : group->paths)
      if (of_reference.contains(frame_identity(path)))
        throw InputError(
            session.source.string(),
            fmt::format("{}: {} is named as reference and as short frame", name, path.string()),
            "name every file once: the reference is of other frames");
}

std::map<std::optional<int>, Scene> scenes_of(const Session& session) {
  std::map<std::optional<int>, Scene> scenes;
  for (const FrameGroup& group : session.groups) {
    if (group.kind == FrameKind::kReference) {
      Scene& scene = scenes[group.level];
      if (scene.reference != nullptr)
        throw InputError(session.source.string(),
                         fmt::format("{} has two reference groups", scene_name(group.level)),
                         "tell scenes apart by `level`");
      scene.reference = &group;
    } else if (group.kind == FrameKind::kShort) {
      scenes[group.level].shorts.push_back(&group);
    }
  }
  for (const auto& [label, scene] : scenes) {
    if (scene.reference == nullptr || scene.shorts.empty())
      throw InputError(session.source.string(),
                       fmt::format("{} has no {} frames", scene_name(label),
                                   scene.reference == nullptr ? "reference" : "short"),
                       "give [[frames]] of kind reference and short with the same level");
    refuse_shared_frames(session, scene_name(label), scene);
  }
  if (scenes.empty())
    throw InputError(session.source.string(), "has no frames of kind reference and short",
                     "pairs need both");
  return scenes;
}

struct PairFiles {
  fs::path reference, noisy;
};

PairFiles files_of_pair(const fs::path& folder, const std::string& name) {
  return {folder / (name + "_reference.tif"), folder / (name + "_short.tif")};
}

fs::path list_of_pairs(const fs::path& folder) { return folder / "pairs.json"; }

std::string pair_name(const std::optional<int>& label, std::size_t number) {
  return fmt::format("{}_{:02}", scene_name(label), number);
}

// Before the work refuses what exists already, and what would replace a file that is read.
void check_pair_files(const PairsArguments& arguments, const Session& session,
                      const std::map<std::optional<int>, Scene>& scenes, bool force) {
  std::vector<fs::path> read = files_read(session);
  read.push_back(arguments.model);
  check_output_apart("-o", list_of_pairs(arguments.folder), read, {}, force);
  for (const auto& [label, scene] : scenes)
    for (std::size_t k = 0; k < scene.shorts.size(); ++k) {
      const PairFiles files = files_of_pair(arguments.folder, pair_name(label, k));
      check_output_apart("-o", files.reference, read, {}, force);
      check_output_apart("-o", files.noisy, read, {}, force);
    }
}

std::vector<GainSetting> gains_of(const Session& session) {
  std::vector<GainSetting> gains;
  for (const FrameGroup& group : session.groups)
    if (group.kind == FrameKind::kReference || group.kind == FrameKind::kShort)
      gains.push_back(group.gain);
  return gains;
}

NoiseProfile profile_at(const PairJob& job, const GainSetting& gain) {
  return naming_model(job.arguments.model, [&] { return job.model->profile_at(gain); });
}

// DN above black, and above the mean bias where a model tells it.
RawFrame load_above_bias(const PairJob& job, const FrameGroup& group, const fs::path& path) {
  RawFrame frame = load_session_frame(job.session, group, path);
  subtract_black(frame);
  if (!job.model) return frame;
  const NoiseProfile profile = profile_at(job, frame.gain);
  require_layout_of_model(frame, profile.layout);
  subtract_bias(frame.dn, profile);
  frame.white_dn -= highest_bias_dn(profile);
  return frame;
}

RawFrame reference_of(const PairJob& job, const FrameGroup& group) {
  FrameMean mean;
  RawFrame last;
  for (const fs::path& path : group.paths) {
    check_stop(job.progress);
    last = load_above_bias(job, group, path);
    if (mean.count() > 0 && (last.dn.rows() != mean.rows() || last.dn.cols() != mean.cols()))
      throw InputError(path.string(), "has another size than the reference frames before it",
                       "check the session's paths");
    mean.add(last.dn);
    job.progress.advance(1);
  }
  last.dn = mean.mean();
  return last;
}

// As measured where a model holds it, else by the decibels.
double gain_ratio_of(const PairJob& job, const GainSetting& reference, const GainSetting& other) {
  if (job.model)
    if (const auto measured = gain_ratio(profile_at(job, reference), profile_at(job, other)))
      return *measured;
  return gain_ratio(reference, other);
}

double ratio_of(const PairJob& job, const FrameGroup& reference, const FrameGroup& group) {
  if (job.arguments.ratio) return *job.arguments.ratio;
  if (!reference.exposure_s || !group.exposure_s)
    throw InputError(job.session.source.string(),
                     "reference or short frames without exposure_s, nor do the files tell it: the "
                     "ratio is not known",
                     "give exposure_s to both, or --ratio");
  return *reference.exposure_s / *group.exposure_s * gain_ratio_of(job, reference.gain, group.gain);
}

void warn_of_pair(const Json& pair) {
  constexpr double kMuchClipped = 1e-3;
  if (const double off = pair["deviation"].get<double>(); std::abs(off) > kMostDeviation)
    warn(
        fmt::format("{}: the light is {:+.0f} % off the reference over {:g}: another scene, or a "
                    "wrong exposure, gain or --ratio",
                    pair["name"].get<std::string>(), 100 * off, pair["ratio"].get<double>()));
  if (const double clipped = pair["reference_clipped_share"].get<double>(); clipped > kMuchClipped)
    warn(
        fmt::format("{}: {} % of the reference's pixels are at white, where it is darker than the "
                    "scene; expose the reference shorter",
                    pair["name"].get<std::string>(), percent_text(clipped)));
}

Json number_or_null(const std::optional<double>& number) { return number ? Json(*number) : Json(); }

std::string flicker_text(const Json& pair) {
  if (const Json& flicker = pair["flicker"]; !flicker.is_null())
    return fmt::format("{:.2f} %", 100 * flicker.get<double>());
  if (const Json& noise = pair["flicker_of_noise"]; !noise.is_null())
    return fmt::format("not seen above the noise ({:.2f} %)", 100 * noise.get<double>());
  return "unknown";
}

// A reference is taken for what the light is: it has more of it than the short frames.
void refuse_longer_shorts(const PairJob& job, const std::string& name, const FrameGroup& reference,
                          const FrameGroup& group) {
  constexpr double kRounding = 1.01;  // of the exposures that files tell
  if (!reference.exposure_s || !group.exposure_s) return;
  if (*group.exposure_s <= kRounding * *reference.exposure_s) return;
  throw InputError(job.session.source.string(),
                   fmt::format("{}: short frames of {:g} s, longer than their reference of {:g} s",
                               name, *group.exposure_s, *reference.exposure_s),
                   "the reference has the longer exposure: check kinds and exposures");
}

// As the camera wrote it, where integers of 16 bits hold that; else as every float file of a frame,
// above black.
void save_short(const fs::path& path, RawFrame frame, SaveOptions save) {
  constexpr float kHighest = 65535;
  const bool held = frame.bits > 0 && std::ranges::all_of(frame.dn.values(), [](float v) {
                      return v >= 0 && v <= kHighest;
                    });
  if (!held) {
    subtract_black(frame);
    frame.bits = 0;
  }
  save.type = held ? SampleType::kUint16 : SampleType::kFloat;
  save_frame(path, frame, save);
}

Json write_pair(const PairJob& job, const std::string& name, const RawFrame& reference,
                const FrameGroup& reference_group, const FrameGroup& group) {
  refuse_longer_shorts(job, name, reference_group, group);
  const double ratio = ratio_of(job, reference_group, group);
  const double top = 0.9 * white_above_black(reference.white_dn, reference.black_dn);
  std::vector<RelativeIntensity> intensities;
  for (const fs::path& path : group.paths) {
    check_stop(job.progress);
    const RawFrame frame = load_above_bias(job, group, path);
    if (frame.dn.rows() != reference.dn.rows() || frame.dn.cols() != reference.dn.cols())
      throw InputError(path.string(), "has another size than its reference",
                       "check the session's paths");
    const auto intensity = relative_intensity(frame.dn, reference.dn, 0.0, top);
    if (!intensity)
      throw InputError(path.string(),
                       "cannot be compared with its reference: " + intensity.reason(),
                       "expose the reference between black and saturation");
    intensities.push_back(*intensity);
    job.progress.advance(1);
  }
  const NearestFrame nearest = nearest_frame(intensities, ratio);
  const fs::path chosen = group.paths[nearest.index];
  SaveOptions save;
  save.force = job.common.force;
  const PairFiles files = files_of_pair(job.arguments.folder, name);
  RawFrame clean = reference;
  clean.white_dn = white_above_black(clean.white_dn, clean.black_dn);
  std::fill(clean.black_dn.begin(), clean.black_dn.end(), 0.0);
  clean.bits = 0;
  save.type = SampleType::kFloat;
  // The list goes first: wherever this run is stopped, no list speaks for frames of another.
  if (save.force) fs::remove(list_of_pairs(job.arguments.folder));
  job.written.insert(job.written.end(), {files.reference, files.noisy});
  save_frame(files.reference, clean, save);
  save_short(files.noisy, load_session_frame(job.session, group, chosen), save);
  Json entry{
      {"name", name},
      {"reference", files.reference.filename().string()},
      {"short", files.noisy.filename().string()},
      {"source", chosen.string()},
      {"ratio", ratio},
      {"reference_frames", reference_group.paths.size()},
      {"reference_clipped_share",
       clipped_share(reference.dn, white_above_black(reference.white_dn, reference.black_dn))},
      {"candidates", Json::array()},
      {"deviation", nearest.deviation},
      {"flicker", number_or_null(nearest.flicker)},
      {"flicker_of_noise", number_or_null(nearest.flicker_of_noise)},
      {"bias_removed", job.model.has_value()},
      {"reference_gain", gain_json(reference.gain)}};
  for (const RelativeIntensity& one : intensities) entry["candidates"].push_back(one.value);
  entry.update(gain_json(group.gain));
  return entry;
}

// Every pair of every scene, to its files, to the list and to what is said.
void write_scenes(const PairJob& job, const std::map<std::optional<int>, Scene>& scenes,
                  Json& pairs, std::string& text) {
  for (const auto& [label, scene] : scenes) {
    const RawFrame reference = reference_of(job, *scene.reference);
    for (std::size_t k = 0; k < scene.shorts.size(); ++k) {
      const std::string name = pair_name(label, k);
      pairs.push_back(write_pair(job, name, reference, *scene.reference, *scene.shorts[k]));
      const Json& last = pairs.back();
      warn_of_pair(last);
      text += fmt::format("{}: ratio {:g}, {}, light {:+.2f} % off, flicker {}\n", name,
                          last["ratio"].get<double>(),
                          counted(std::ssize(last["candidates"]), "candidate"),
                          100 * last["deviation"].get<double>(), flicker_text(last));
    }
  }
}

void run_pairs(const PairsArguments& arguments, const Common& common) {
  const Session session = with_settings_of_files(load_session(arguments.session));
  const auto scenes = scenes_of(session);
  std::optional<NoiseModel> model;
  if (!arguments.model.empty()) model = load_model(arguments.model);
  if (model) warn_of_untold_gain(*model, arguments.model, gains_of(session));
  const OutputFolder output(arguments.folder);
  check_pair_files(arguments, session, scenes, common.force);
  std::int64_t steps = 0;
  for (const auto& [label, scene] : scenes) {
    steps += static_cast<std::int64_t>(scene.reference->paths.size());
    for (const FrameGroup* group : scene.shorts)
      steps += static_cast<std::int64_t>(group->paths.size());
  }
  const auto progress = make_progress(common);
  progress->begin("pairs", steps);
  std::vector<fs::path> written;
  const PairJob job{arguments, common, session, model, *progress, written};
  Json pairs = Json::array();
  std::string text;
  Json result;
  try {
    write_scenes(job, scenes, pairs, text);
    result = {{"session", arguments.session.string()}, {"pairs", pairs}};
    write_file(list_of_pairs(arguments.folder), json_utf8(result, 2) + "\n", common.force);
  } catch (...) {
    std::error_code ignored;
    for (const fs::path& path : written) fs::remove(path, ignored);
    throw;
  }
  print_result(common, result, text);
}

}  // namespace

void add_pairs(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<PairsArguments>();
  CLI::App* command =
      add_command(app, common, "pairs", "Training pairs from a captured session", {.force = true},
                  [arguments, &common] { run_pairs(*arguments, common); });
  command->add_option("SESSION", arguments->session, "session file with reference and short frames")
      ->required();
  command->add_option("-o,--output", arguments->folder, "folder of the pairs")->required();
  command->add_option("--model", arguments->model,
                      "noise model whose mean bias is subtracted before frames are compared, and "
                      "whose K tells how gains compare; without one the references hold their "
                      "bias, as the list says, and training takes it off by its own model");
  command
      ->add_option("--ratio", arguments->ratio,
                   "light of the reference over that of the short frames; otherwise from "
                   "exposure and gain")
      ->check(positive_number());
}

}  // namespace malus::app
