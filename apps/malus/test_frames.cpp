#include "test_frames.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/middle.h"
#include "malus/image/window.h"
#include "malus/noise/sensor_window.h"
#include "malus/synthesize/pairs.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <system_error>
#include <utility>

#include "captures.h"
#include "denoise_checks.h"
#include "flags.h"
#include "frame_input.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr std::string_view kEstimateRemedy = "take a larger crop, or leave --estimate-noise out";

// Exposures that files round, and gains as they were measured, make ratios that differ a little.
double round_ratio(double ratio) { return *decimal_number(fmt::format("{:.3g}", ratio)); }

ScoredLight light_of_pair(const RecordedPair& pair) {
  const GainSetting& gain = pair.gain;
  const double ratio = round_ratio(pair.ratio);
  const std::string number = gain.iso       ? fmt::format("{:g}", *gain.iso)
                             : gain.gain_db ? fmt::format("{:g}", *gain.gain_db)
                                            : "unknown";
  return {fmt::format("{}:{:g}", number, ratio), gain, ratio};
}

// The noise of a whole short frame as `malus denoise` knows it. What the model knows of single
// pixels is of such a frame, or it is not there: a window of a larger one may have its size.
NoiseProfile profile_of_capture(const RawFrame& noisy, const NoiseModel& model) {
  FrameProfile made = frame_profile(noisy, model, noisy.gain);
  if (made.left_out.empty()) return std::move(made.profile);
  warn_of(
      noisy.source,
      fmt::format("{} x {} pixels are another size than that of the model's sensor: its defects "
                  "and maps of the fixed pattern are left out; take pairs of whole frames",
                  noisy.dn.cols(), noisy.dn.rows()));
  made.profile.defects = {};
  made.profile.pattern = nullptr;
  return std::move(made.profile);
}

double require_white(const RawFrame& reference, const RawFrame& noisy) {
  if (const auto white_dn = white_of_reference(reference, noisy)) return *white_dn;
  throw InputError(reference.source, "does not tell its white level, nor does the short frame",
                   "give the camera's model with --model");
}

// Marks what the reference does not tell; returns the share of all pixels.
double mark_and_tell(RawFrame& reference, double white_dn, const DefectList& defects) {
  constexpr double kMuchUnknown = 1e-3;
  const auto unknown = static_cast<double>(mark_unknown(reference.dn, white_dn, defects));
  const double share = unknown / static_cast<double>(reference.dn.size());
  if (share > kMuchUnknown)
    warn_of(reference.source,
            fmt::format("{} % of its pixels do not tell the light (at white, no numbers, or "
                        "defects of the sensor); no score counts them",
                        percent_text(share)));
  return share;
}

}  // namespace

void TestFrames::add_options(CLI::App& command, const std::string& scenes_name,
                             const std::string& scenes_note) {
  scenes.add_options(command, scenes_name, scenes_note);
  scenes_name_ = scenes_name;
  model_option_ = command.get_option("--model");
  command
      .add_option("--test-pairs", pairs,
                  "in place of scenes: captured pairs to score on (pairs.json of malus pairs); "
                  "--model is their camera's" +
                      scenes_note)
      ->excludes(command.get_option(scenes_name))
      ->excludes(command.get_option("--cases"));
}

void TestFrames::check_usage() const {
  if (!captured() && scenes.scenes.empty())
    throw CLI::RequiredError("one of " + scenes_name_ + " and --test-pairs");
  if (captured() && !model_given() && !estimate_noise)
    throw CLI::ValidationError("--test-pairs", "give the noise model of their camera with --model");
}

std::vector<fs::path> TestFrames::files_named() const {
  std::vector<fs::path> files = scenes.files_named();
  files.insert(files.end(), pairs.begin(), pairs.end());
  return files;
}

OpenTestFrames::OpenTestFrames(const TestFrames& named, std::optional<double> row_noise)
    : named_(named) {
  if (named.captured()) {
    open_captures();
    return;
  }
  model_ = named.scenes.load_camera();
  if (row_noise) model_ = with_row_noise(std::move(*model_), *row_noise);
}

void OpenTestFrames::open_captures() {
  if (named_.model_given()) model_ = load_model(named_.scenes.model);
  std::vector<GainSetting> gains;
  for (RecordedPair& pair : open_pairs(named_.pairs, model())) {
    gains.push_back(pair.gain);
    captures_.push_back({.pair = std::move(pair), .light = {}});
    captures_.back().light = light_of_pair(captures_.back().pair);
    if (const fs::path& reference = captures_.back().pair.reference;
        !model_ && captures_.back().pair.bias_at)
      warn_of(reference.string(),
              "holds the sensor's bias, which counts as light where no model tells it (--model)");
  }
  if (model_) {
    warn_of_untold_gain(*model_, named_.scenes.model, gains);
    for (const GainSetting& gain : gains)
      warn_of_model(*model_, gain, named_.scenes.model, /*undone=*/true);
  }
  const auto place = [](const Capture& capture) {
    constexpr double kFirst = -std::numeric_limits<double>::infinity();
    return std::pair{capture.light.gain.decibel().value_or(kFirst), capture.light.ratio};
  };
  std::ranges::stable_sort(captures_, {}, place);
}

void OpenTestFrames::for_each(std::uint64_t seed, Progress& progress, const SceneRun& run) {
  const SceneRun with_profile = [&](NoisyScene& noisy, const ScoredLight& light) {
    if (named_.estimate_noise)
      noisy.profile = require_estimate(noisy.frame, kEstimateRemedy).profile;
    run(noisy, light);
  };
  if (!named_.captured()) return named_.scenes.for_each(*model_, seed, progress, with_profile);
  progress.begin("experiment", std::ssize(captures_));
  for (Capture& capture : captures_) {
    check_stop(progress);
    run_capture(capture, with_profile);
    progress.advance(1);
  }
}

void OpenTestFrames::run_capture(Capture& capture, const SceneRun& run) const {
  const RecordedPair& pair = capture.pair;
  NoisyScene noisy{
      .frame = load_short(pair, model()), .profile = {}, .ratio = pair.ratio, .drawn = false};
  RawFrame& frame = noisy.frame;
  warn_of_guesses(frame);
  RawFrame reference = load_reference(pair, frame);
  if (model_) noisy.profile = profile_of_capture(frame, *model_);
  noisy.range_dn = require_white(reference, frame);
  capture.unknown_share = mark_and_tell(reference, noisy.range_dn, noisy.profile.defects);
  const MosaicWindow window = middle_window(frame.dn.rows(), frame.dn.cols(), frame.layout,
                                            named_.scenes.crop, noisy.profile.row_group);
  if (window.rows == 0 || window.cols == 0)
    throw InputError(frame.source, "is smaller than a cell and row group of its sensor",
                     "leave the pair out, or take a larger --crop");
  if (!noisy.profile.defects.places.empty() || noisy.profile.pattern)
    cut_to_window(noisy.profile, {window.row0, window.col0}, window.rows, window.cols,
                  frame.source);
  frame.dn = part_of(frame.dn, window);
  const CleanScene clean{pair.name, light_of_reference(part_of(reference.dn, window), /*ratio=*/1,
                                                       model(), pair.bias_at)};
  if (std::ranges::none_of(clean.clean_dn.values(), [](float v) { return std::isfinite(v); }))
    throw InputError(reference.source, "tells no light in the pixels that would be scored",
                     "expose the reference below white, or leave the pair out");
  noisy.clean = &clean;
  run(noisy, capture.light);
}

std::vector<ScoredLight> OpenTestFrames::lights() const {
  if (!named_.captured()) return named_.scenes.lights(*model_);
  std::vector<ScoredLight> list;
  for (const Capture& capture : captures_)
    if (list.empty() || list.back().name != capture.light.name) list.push_back(capture.light);
  return list;
}

std::vector<std::string> OpenTestFrames::shared_with(
    const std::vector<RecordedPair>& trained_on) const {
  std::error_code unknown;
  std::set<fs::path> taught;
  for (const RecordedPair& pair : trained_on)
    taught.insert(fs::weakly_canonical(pair.noisy, unknown));
  std::vector<std::string> names;
  for (const Capture& capture : captures_)
    if (taught.contains(fs::weakly_canonical(capture.pair.noisy, unknown)))
      names.push_back(capture.pair.name);
  return names;
}

Json OpenTestFrames::facts() const {
  Json json{{"model", model_ ? Json(named_.scenes.model) : Json()}, {"cases", Json::array()}};
  for (const ScoredLight& light : lights()) json["cases"].push_back(light.name);
  json["crop"] = named_.scenes.crop;
  if (!named_.captured()) return json;
  json["test_pairs"] = Json::array();
  for (const fs::path& list : named_.pairs) json["test_pairs"].push_back(list.string());
  json["captures"] = Json::array();
  for (const Capture& capture : captures_)
    json["captures"].push_back({{"name", capture.pair.name},
                                {"short", capture.pair.noisy.string()},
                                {"case", capture.light.name},
                                {"ratio", capture.pair.ratio},
                                {"unknown_share", capture.unknown_share}});
  return json;
}

std::string OpenTestFrames::note() const {
  const SceneRuns& scenes = named_.scenes;
  std::vector<std::string> names;
  for (const fs::path& scene : scenes.scenes) names.push_back(name_of_scene(scene));
  for (const fs::path& list : named_.pairs) names.push_back(list.string());
  const std::string what =
      named_.captured() ? counted(std::ssize(captures_), "captured frame") + " against references:"
                        : "Scenes:";
  const std::string noise = named_.captured() && named_.estimate_noise ? "noise estimated from each"
                                                                       : "noise of " + scenes.model;
  return fmt::format("{} {}, of each at most the middle {} x {} pixels. {}; {}.", what,
                     joined(names), scenes.crop, scenes.crop, cases_text(lights()), noise);
}

Json OpenTestFrames::record(const std::string& title, const std::vector<SceneScore>& scores) const {
  return score_record(title, named_.captured() ? "frames" : "scenes", note(), scores);
}

}  // namespace malus::app
