// malus experiment noise: how near the noise of every kind of model comes to a camera's own, gain
// by gain (001, Fig. 4 and S3).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/calibrate/frame_set.h"
#include "malus/evaluate/divergence.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/io/session.h"
#include "malus/noise/same_sensor.h"
#include "malus/synthesize/equivalent_models.h"
#include "malus/synthesize/model.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "captures.h"
#include "experiments.h"
#include "flags.h"
#include "frame_input.h"
#include "noise_stand_in.h"
#include "output_check.h"
#include "report_pages.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct NoiseExperimentArguments {
  fs::path model, session, folder, report;
  std::string camera;
  std::vector<std::string> kinds, cases;
  std::vector<fs::path> flows, pairs, pictures;
  int crop = 512, frames = 8;
};

// What frames are drawn from: a kind of the model, or a flow.
struct NoiseOfKind {
  std::string name;
  StandIn stand_in;
};

// Frames of the camera at one gain, that drawn ones are compared with.
struct CameraFrames {
  GainSetting gain;
  std::function<NoiseComparison(const StandIn& stand_in)> compare;
};

// Sums over frames of one gain; means when they are told.
struct DivergenceSum {
  double kld = 0, kld_floor = 0, jsd = 0, sqrt_jsd = 0, sqrt_jsd_floor = 0;
  int count = 0;

  void add(const NoiseDistance& pooled) {
    kld += pooled.kld_nats;
    kld_floor += kld_floor_nats(pooled.sqrt_jsd_floor * pooled.sqrt_jsd_floor);
    jsd += pooled.jsd_bits;
    sqrt_jsd += pooled.sqrt_jsd;
    sqrt_jsd_floor += pooled.sqrt_jsd_floor;
    ++count;
  }
  Json json() const {
    return {{"kld", kld / count},
            {"kld_floor", kld_floor / count},
            {"jsd", jsd / count},
            {"sqrt_jsd", sqrt_jsd / count},
            {"sqrt_jsd_floor", sqrt_jsd_floor / count}};
  }
};

// A model that tells physics alone is joined by what its calibration would find of the other kinds
// where a simulated camera has its noise; of a real camera they would be invented.
NoiseModel compared_model(const NoiseExperimentArguments& arguments, NoiseModel model,
                          const std::vector<CameraFrames>& frames) {
  if (arguments.pictures.empty()) return model;
  std::vector<GainSetting> gains;
  for (const CameraFrames& one : frames)
    if (std::ranges::find(gains, one.gain) == gains.end()) gains.push_back(one.gain);
  return with_equivalents(std::move(model), gains);
}

std::vector<NoiseOfKind> noises_of(const NoiseExperimentArguments& arguments, NoiseModel model) {
  std::vector<std::string> kinds = arguments.kinds;
  if (kinds.empty())
    for (const std::string_view name : kSynthesisKindNames) {
      const ModelKind needed = drawn_from(synthesis_kind(std::string(name)));
      if (std::ranges::count(model.kinds(), needed)) kinds.emplace_back(name);
    }
  const SensorLayout layout = model.layout;
  const auto shared = std::make_shared<const NoiseModel>(std::move(model));
  std::vector<NoiseOfKind> noises;
  for (const std::string& kind : kinds) {
    SynthesisSettings settings;
    settings.kind = kind;
    // A frame's own bias and row noise vary about the mean; drawn anew for the frame beside it, the
    // difference of two draws would count as one of the noise.
    if (drawn_from(synthesis_kind(kind)) == ModelKind::kPhysics) settings.parameters = "mean";
    noises.push_back({kind, calibrated_stand_in(shared, arguments.model, settings)});
  }
  for (const fs::path& flow : arguments.flows) {
    const std::string name =
        arguments.flows.size() == 1 ? "Noise Flow" : "Noise Flow " + flow.string();
    noises.push_back({name, flow_stand_in(flow)});
    if (!(noises.back().stand_in.levels.layout == layout))
      throw InputError(flow.string(),
                       fmt::format("is of a sensor with the layout {}, the model of {}",
                                   noises.back().stand_in.levels.layout.name(), layout.name()),
                       "give a flow of the model's camera");
  }
  return noises;
}

// Captured pairs: each frame less its clean mosaic. The model must outlive them.
std::vector<CameraFrames> frames_of_pairs(const std::vector<RecordedPair>& pairs,
                                          const NoiseModel& model, std::uint64_t seed) {
  std::vector<CameraFrames> frames;
  for (const RecordedPair& pair : pairs) {
    const int number = static_cast<int>(frames.size());
    frames.push_back(
        {pair.gain, [pair, &model, seed, number](const StandIn& stand_in) {
           const LoadedCapture real = load_capture(pair, model, ReferenceLight::kKnown);
           const NoiseFrames own{1, [&](int) { return above_black(real.noisy); }};
           const NoiseFrames drawn{1, [&](int) {
                                     return stand_in.draw(real.clean_dn, pair.gain,
                                                          stand_in_address(seed, number),
                                                          real.noisy.bits > 0);
                                   }};
           return compare_noise(own, drawn, real.clean_dn, model.layout, {});
         }});
  }
  return frames;
}

// Dark and flat frames of a session: less their set's mean, for no model draws the lamp's shading
// and the fixed pattern.
std::vector<CameraFrames> frames_of_session(const NoiseExperimentArguments& arguments,
                                            const NoiseModel& model, std::uint64_t seed) {
  std::vector<CameraFrames> frames;
  for (const FrameSet& set : calibration_input(load_session(arguments.session)).sets) {
    if ((set.kind != FrameKind::kBias && set.kind != FrameKind::kFlat) || set.count < 2) continue;
    const int count = std::min(set.count, arguments.frames);
    frames.push_back(
        {set.gain, [set, count, &model, seed](const StandIn& stand_in) {
           RawFrame first = set.load(0);
           require_layout_of_model(first, model.layout);
           first.gain = set.gain;
           const NoiseFrames own{count, [&](int k) { return above_black(set.load(k)); }};
           NoiseComparisonSettings settings;
           settings.remove_fixed_pattern = true;
           return compare_noise(own, frames_drawn(stand_in, own, first, {}, count, seed), {},
                                model.layout, settings);
         }});
  }
  if (frames.empty())
    throw InputError(arguments.session.string(), "has no set of two or more dark or flat frames",
                     "give a session with such sets, or --pairs");
  return frames;
}

std::vector<RecordedPair> pairs_of(const NoiseExperimentArguments& arguments, std::uint64_t seed,
                                   Progress& progress) {
  std::vector<RecordedPair> pairs = open_pairs(arguments.pairs, nullptr);
  if (arguments.pictures.empty()) return pairs;
  const Model camera =
      Model::load(arguments.camera.empty() ? arguments.model.string() : arguments.camera);
  for (std::size_t i = 0; i < arguments.cases.size(); ++i) {
    const LightCase light = light_case_of(arguments.cases[i]);
    for (RecordedPair& pair :
         take_pictures(camera.description(), arguments.pictures,
                       {.gain = camera.gain_setting(light.gain),
                       .ratio = light.ratio,
                       .crop = arguments.crop},
                       arguments.folder / fmt::format("case{}", i), seed + i, progress))
      pairs.push_back(std::move(pair));
  }
  return pairs;
}

// Why a kind cannot be drawn at a gain; empty where it can.
std::string refusal_at(const NoiseOfKind& noise, const GainSetting& gain) {
  const SensorLayout& cell = noise.stand_in.levels.layout;
  try {
    noise.stand_in.draw(Image(2 * cell.rows(), 2 * cell.cols()), gain, {}, true);
  } catch (const InputError& error) {
    return error.subject() + ": " + error.problem();
  }
  return {};
}

// A cell for every gain, null where the kind cannot be drawn at it.
Json row_of(const NoiseOfKind& noise, const std::vector<GainSetting>& gains,
            const std::vector<CameraFrames>& frames, Progress& progress) {
  Json row{{"name", noise.name}, {"gains", Json::array()}};
  std::vector<std::string> left_out;
  std::string reason;
  for (const GainSetting& gain : gains) {
    if (const std::string refusal = refusal_at(noise, gain); !refusal.empty()) {
      if (left_out.empty()) reason = refusal;
      left_out.push_back(gain.text());
      row["gains"].push_back(nullptr);
      continue;
    }
    DivergenceSum sum;
    for (const CameraFrames& one : frames) {
      if (!(one.gain == gain)) continue;
      check_stop(progress);
      sum.add(one.compare(noise.stand_in).pooled);
      progress.advance(1);
    }
    row["gains"].push_back(sum.json());
  }
  if (left_out.size() == gains.size())
    throw InputError(noise.name,
                     fmt::format("can be drawn at none of the frames' gains ({})", reason),
                     "give a model of the frames' camera at their gains");
  if (!left_out.empty())
    warn(fmt::format("{} is not compared at {}: {}", noise.name, joined(left_out), reason));
  return row;
}

// The floors hardly differ between kinds: those of the first that knows the gain.
Json floor_row(const Json& rows, const char* key, std::size_t gain) {
  for (const Json& row : rows)
    if (!row["gains"][gain].is_null()) return row["gains"][gain][std::string(key) + "_floor"];
  return nullptr;
}

struct DivergenceTable {
  const char* key;
  const char* title;
};
constexpr DivergenceTable kDivergenceTables[] = {{"sqrt_jsd", "root of JSD (base 2)"},
                                                 {"kld", "KLD [nats]"}};

std::string cell_text(const Json& value) {
  return value.is_null() ? " - |" : fmt::format(" {:.4f} |", value.get<double>());
}

std::string noise_text(const Json& gains, const Json& rows) {
  std::string text;
  for (const DivergenceTable& shown : kDivergenceTables) {
    const char* key = shown.key;
    text += fmt::format("{}| {} |", text.empty() ? "" : "\n", shown.title);
    for (const Json& gain : gains) text += fmt::format(" {} |", gain["gain"].get<std::string>());
    text += "\n|---|";
    for (std::size_t i = 0; i < gains.size(); ++i) text += "---|";
    for (const Json& row : rows) {
      text += fmt::format("\n| {} |", row["name"].get<std::string>());
      for (const Json& cell : row["gains"]) text += cell_text(cell.is_null() ? Json() : cell[key]);
    }
    text += "\n| floor: two samples of one distribution |";
    for (std::size_t i = 0; i < gains.size(); ++i) text += cell_text(floor_row(rows, key, i));
    text += '\n';
  }
  return text;
}

Json noise_record(const Json& gains, const Json& rows, const std::vector<GainSetting>& settings) {
  Json record{{"title", "Noise of the models against the camera's"},
              {"tables", Json::array()},
              {"charts", Json::array()}};
  for (const DivergenceTable& shown : kDivergenceTables) {
    const char *key = shown.key, *title = shown.title;
    std::vector<std::pair<std::string, std::string>> columns;
    for (const Json& gain : gains) columns.emplace_back(gain["gain"].get<std::string>(), "1");
    Json table = record_table(title, "Means over the frames of a gain.", "noise model", columns);
    Json series = Json::array();
    const auto add = [&](const std::string& name, const auto& value_at) {
      Json cells = Json::array(), x = Json::array(), y = Json::array();
      for (std::size_t i = 0; i < gains.size(); ++i) {
        cells.push_back(value_at(i));
        if (cells.back().is_null() || !settings[i].decibel()) continue;
        x.push_back(*settings[i].decibel());
        y.push_back(cells.back());
      }
      add_record_row(table, name, cells);
      series.push_back({{"name", name}, {"x", x}, {"y", y}});
    };
    for (const Json& row : rows)
      add(row["name"].get<std::string>(),
          [&](std::size_t i) { return row["gains"][i].is_null() ? Json() : row["gains"][i][key]; });
    add("floor", [&](std::size_t i) { return floor_row(rows, key, i); });
    record["tables"].push_back(table);
    record["charts"].push_back({{"title", title},
                                {"x", {{"name", "gain"}, {"unit", "dB"}}},
                                {"y", {{"name", title}, {"unit", "1"}}},
                                {"series", series}});
  }
  return record;
}

void check_arguments(const NoiseExperimentArguments& arguments, const Common& common) {
  if (arguments.session.empty() && arguments.pairs.empty() && arguments.pictures.empty())
    throw CLI::RequiredError("one of --pairs, --session and --pictures");
  if (!arguments.pictures.empty() && (arguments.cases.empty() || arguments.folder.empty()))
    throw CLI::ValidationError("--pictures",
                               "are taken by a simulated camera; give its gains and light with "
                               "--cases GAIN:RATIO, and -o for its captures");
  std::vector<fs::path> read{arguments.model, arguments.session};
  for (const auto* files : {&arguments.flows, &arguments.pairs, &arguments.pictures})
    read.insert(read.end(), files->begin(), files->end());
  check_report_apart(arguments.report, read, {}, common.force);
}

void run_noise_experiment(const NoiseExperimentArguments& arguments, const Common& common) {
  check_arguments(arguments, common);
  const NoiseModel described = load_model(arguments.model);
  std::optional<OutputFolder> output;
  if (!arguments.folder.empty()) output.emplace(arguments.folder);
  const auto progress = make_progress(common);
  const std::vector<CameraFrames> frames =
      arguments.session.empty()
          ? frames_of_pairs(pairs_of(arguments, common.seed, *progress), described, common.seed)
          : frames_of_session(arguments, described, common.seed);
  std::vector<GainSetting> gains;
  for (const CameraFrames& one : frames)
    if (std::ranges::find(gains, one.gain) == gains.end()) gains.push_back(one.gain);
  std::ranges::sort(gains, {}, [](const GainSetting& gain) { return gain.decibel().value_or(0); });
  const auto noises = noises_of(arguments, compared_model(arguments, described, frames));
  for (const GainSetting& gain : gains) noises.front().stand_in.warn_of_gain(gain);
  progress->begin("comparing", std::ssize(noises) * std::ssize(frames));
  Json rows = Json::array(), told = Json::array();
  for (const NoiseOfKind& noise : noises) rows.push_back(row_of(noise, gains, frames, *progress));
  for (const GainSetting& gain : gains)
    told.push_back(
        {{"gain", gain.text()}, {"frames", std::ranges::count(frames, gain, &CameraFrames::gain)}});
  if (!arguments.report.empty())
    write_record_report(noise_record(told, rows, gains), arguments.report, common.force);
  print_result(
      common,
      {{"model", arguments.model.string()}, {"seed", common.seed}, {"gains", told}, {"rows", rows}},
      noise_text(told, rows));
}

}  // namespace

void add_noise_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<NoiseExperimentArguments>();
  CLI::App* command = add_command(experiment, common, "noise",
                                  "KLD and JSD of every kind of noise model against a camera's own",
                                  {.seed = true, .force = true}, [arguments, &common] {
                                    run_noise_experiment(*arguments, common);
                                  });
  command
      ->add_option("-m,--model", arguments->model,
                   "noise model of the camera: a file or a built-in name")
      ->required();
  std::vector<std::string> kinds(kSynthesisKindNames.begin(), kSynthesisKindNames.end());
  command->add_option("--kinds", arguments->kinds, "kinds to compare; otherwise all that it holds")
      ->delimiter(',')
      ->check(one_of(kinds));
  command->add_option("--flow", arguments->flows, "also these Noise Flows (.safetensors)");
  CLI::Option* pairs = command->add_option(
      "--pairs", arguments->pairs,
      "captured pairs of the camera (pairs.json of malus pairs), not those that the "
      "model was measured on");
  CLI::Option* session =
      command
          ->add_option("--session", arguments->session,
                       "in their place: dark and flat frames; each set is compared less its mean")
          ->excludes(pairs);
  CLI::Option* pictures = command
                              ->add_option("--pictures", arguments->pictures,
                                           "in their place: pictures that a simulated camera takes")
                              ->excludes(pairs)
                              ->excludes(session);
  command
      ->add_option("--camera", arguments->camera,
                   "the simulated camera: a model with physics; otherwise --model")
      ->needs(pictures);
  command
      ->add_option("--cases", arguments->cases, "its gains and low-light ratios, each GAIN:RATIO")
      ->check(accepted_by([](const std::string& text) { light_case_of(text); }))
      ->needs(pictures);
  command->add_option("-o,--output", arguments->folder, "folder of its captures")->needs(pictures);
  add_crop(*command, arguments->crop, "the pictures");
  command->add_option("--frames", arguments->frames, "frames of a session's set, at most")
      ->check(in_range(2, 100000))
      ->capture_default_str();
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace malus::app
