#include "scene_scores.h"

#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/base/text.h"
#include "malus/denoise/noise_check.h"
#include "malus/evaluate/evaluation.h"
#include "malus/io/angle_pictures.h"
#include "malus/noise/raw_variance.h"
#include "malus/synthesize/scene.h"

#include <algorithm>
#include <cmath>

#include "denoise_method.h"
#include "experiments.h"
#include "flags.h"
#include "frame_input.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

// Light behind four polarizer angles, or of one picture without polarization; fractions of white.
std::vector<Planes> scene_light(const fs::path& path) {
  std::vector<Planes> angles;
  if (fs::is_directory(path)) {
    for (const Picture& picture : load_angle_pictures(path))
      angles.push_back(
          checked_light(picture, (path / fmt::format("I{}", 45 * angles.size())).string(), false));
  } else {
    const Picture picture = load_clean_picture(path);
    angles.push_back(checked_light(picture, path.string(), picture.bits > 0));
  }
  return angles;
}

// Of these commands none extrapolates a model, as what the model advises may do.
NoiseProfile profile_at(const NoiseModel& model, const GainSetting& gain, const LightCase& light) {
  try {
    return model.profile_at(gain);
  } catch (const InputError& error) {
    throw InputError(fmt::format("--cases {:g}:{:g}", light.gain, light.ratio), error.problem(),
                     "give a gain that the model knows, or a model of this one");
  }
}

SceneSums& sums_of_case(SceneScore& score, const ScoredLight& light) {
  const auto found = std::ranges::find_if(
      score.by_case, [&](const auto& known) { return known.first.name == light.name; });
  return found != score.by_case.end() ? found->second
                                      : score.by_case.emplace_back(light, SceneSums{}).second;
}

void add_to_sums(SceneSums& sums, const Evaluation& e, double seconds) {
  sums.image_psnr_db += *e.image_psnr_db;
  sums.image_ssim.add(e.image_ssim);
  sums.dolp_psnr_db.add(e.dolp_psnr_db);
  sums.aolp_psnr_db.add(e.aolp_psnr_db);
  sums.aolp_deg.add(e.aolp_circular_deg);
  sums.seconds += seconds;
  ++sums.count;
}

// The columns of 000 Table 1, and what its linear AoLP is no good measure for.
struct ScoreColumn {
  const char *key, *name, *unit;
  int digits;
};
constexpr ScoreColumn kScoreColumns[] = {{"image_psnr_db", "image PSNR", "dB", 2},
                                         {"image_ssim", "image SSIM", "1", 3},
                                         {"dolp_psnr_db", "DoLP PSNR", "dB", 2},
                                         {"aolp_psnr_db", "AoLP PSNR", "dB", 2},
                                         {"aolp_circular_deg", "AoLP circular RMS", "deg", 2},
                                         {"seconds", "time per frame", "s", 2}};

Json means_json(const SceneSums& sums) {
  const double n = std::max(sums.count, 1);
  const auto decided = [](const MeanOfDecided& m) { return m.mean() ? Json(*m.mean()) : Json(); };
  return {
      {"image_psnr_db", sums.image_psnr_db / n},     {"image_ssim", decided(sums.image_ssim)},
      {"dolp_psnr_db", decided(sums.dolp_psnr_db)},  {"aolp_psnr_db", decided(sums.aolp_psnr_db)},
      {"aolp_circular_deg", decided(sums.aolp_deg)}, {"seconds", sums.seconds / n}};
}

// In the order of the columns; nothing is done to the noisy frame, which takes no time.
Json score_cells(const SceneSums& sums) {
  const Json means = means_json(sums);
  Json cells = Json::array();
  for (const ScoreColumn& column : kScoreColumns)
    cells.push_back(column.key == std::string("seconds") && sums.seconds <= 0 ? Json()
                                                                              : means[column.key]);
  return cells;
}

using NamedSums = std::vector<std::pair<std::string, SceneSums>>;

std::string table_text(const NamedSums& rows) {
  std::string table = "| method |", line = "|---|";
  for (const ScoreColumn& column : kScoreColumns) {
    table += column.unit == std::string("1") ? fmt::format(" {} |", column.name)
                                             : fmt::format(" {} [{}] |", column.name, column.unit);
    line += "---|";
  }
  table += "\n" + line + "\n";
  for (const auto& [name, sums] : rows) {
    table += fmt::format("| {} |", name);
    const Json cells = score_cells(sums);
    for (std::size_t i = 0; i < cells.size(); ++i)
      table += cells[i].is_null()
                   ? std::string(" - |")
                   : fmt::format(" {:.{}f} |", cells[i].get<double>(), kScoreColumns[i].digits);
    table += "\n";
  }
  return table;
}

NamedSums all_sums(const std::vector<SceneScore>& scores) {
  NamedSums rows;
  for (const SceneScore& score : scores) rows.emplace_back(score.name, score.sums);
  return rows;
}

// Every case with all rows' sums of it, where there are several.
std::vector<std::pair<ScoredLight, NamedSums>> sums_by_case(const std::vector<SceneScore>& scores) {
  std::vector<std::pair<ScoredLight, NamedSums>> cases;
  if (scores.empty() || scores.front().by_case.size() < 2) return cases;
  for (std::size_t i = 0; i < scores.front().by_case.size(); ++i) {
    cases.emplace_back(scores.front().by_case[i].first, NamedSums{});
    for (const SceneScore& score : scores)
      cases.back().second.emplace_back(score.name, score.by_case[i].second);
  }
  return cases;
}

Json sums_table(const std::string& title, const std::string& note, const NamedSums& rows) {
  std::vector<std::pair<std::string, std::string>> columns;
  for (const ScoreColumn& column : kScoreColumns) columns.emplace_back(column.name, column.unit);
  Json table = record_table(title, note, "method", columns);
  for (const auto& [name, sums] : rows) add_record_row(table, name, score_cells(sums));
  return table;
}

}  // namespace

std::string name_of_scene(const fs::path& path) {
  return (path.has_filename() ? path : path.parent_path()).filename().string();
}

CleanScene load_scene(const fs::path& path, const NoiseModel& model, int crop) {
  CleanScene scene = clean_scene(path.string(), scene_light(path), model, crop);
  scene.name = name_of_scene(path);
  return scene;
}

void SceneRuns::add_options(CLI::App& command, const std::string& scenes_name,
                            const std::string& scenes_note) {
  command.add_option(scenes_name, scenes,
                     "folders with I0.png, I45.png, I90.png, I135.png; for a camera without "
                     "polarizers also pictures" +
                         scenes_note);
  command.add_option("--model", model, "noise model, a file or a built-in name")
      ->capture_default_str();
  command.add_option("--cases", cases, "gain [dB, or ISO] : low-light ratio")
      ->check(accepted_by([](const std::string& text) { light_case_of(text); }))
      ->capture_default_str();
  add_crop(command, crop, "what is scored");
}

std::vector<fs::path> SceneRuns::files_named() const {
  std::vector<fs::path> files = scenes;
  files.emplace_back(model);
  return files;
}

NoiseModel SceneRuns::load_camera() const {
  NoiseModel camera = load_model(model);
  std::vector<GainSetting> gains;
  for (const ScoredLight& light : lights(camera)) gains.push_back(light.gain);
  warn_of_untold_gain(camera, model, gains);
  return camera;
}

std::vector<ScoredLight> SceneRuns::lights(const NoiseModel& camera) const {
  std::vector<ScoredLight> list;
  for (const std::string& text : cases) {
    const LightCase light = light_case_of(text);
    list.push_back({text, camera.setting_of(light.gain), light.ratio});
  }
  return list;
}

void SceneRuns::for_each(const NoiseModel& drawn_by, std::uint64_t seed, Progress& progress,
                         const SceneRun& run) const {
  const std::vector<ScoredLight> all_lights = lights(drawn_by);
  const auto camera = std::make_shared<const NoiseModel>(drawn_by);
  progress.begin("experiment", std::ssize(scenes) * std::ssize(cases));
  for (const fs::path& path : scenes) {
    const CleanScene scene = load_scene(path, drawn_by, crop);
    for (const ScoredLight& light : all_lights) {
      check_stop(progress);
      NoisyScene noisy = make_noisy(scene, light_case_of(light.name), camera, seed++);
      run(noisy, light);
      progress.advance(1);
    }
  }
}

DenoiseSettings method_settings_of(const std::string& text) {
  DenoiseSettings settings;
  if (is_weight_file(text)) {
    settings.method = text;
    return settings;
  }
  std::size_t start = 0;
  for (int field = 0; start <= text.size(); ++field) {
    const std::size_t end = std::min(text.find('/', start), text.size());
    const std::string part = text.substr(start, end - start);
    if (field == 0) settings.method = part;
    if (field == 1) settings.profile = part;
    if (field == 2 && part == "no-row-noise")
      settings.row_noise = false;
    else if (field >= 2)
      throw InputError("the method " + text,
                       fmt::format("has a part \"{}\", which says nothing", part),
                       "give METHOD, METHOD/PROFILE or METHOD/PROFILE/no-row-noise");
    start = end + 1;
  }
  require_method(settings.method);
  if (const auto profiles = choices_of<DenoiseSettings>("profile");
      std::ranges::find(profiles, settings.profile) == profiles.end())
    throw InputError("the method " + text, fmt::format("has no profile \"{}\"", settings.profile),
                     did_you_mean(settings.profile, profiles) + "known: " + joined(profiles));
  return settings;
}

LightCase light_case_of(const std::string& text) {
  if (const auto light = parsed_light_case(text)) return *light;
  throw InputError(
      "the case " + text, "is not GAIN:RATIO",
      "e.g. 12:60: gain 12 (dB; ISO where the model holds ISO) and a sixtieth of the light");
}

NoisyScene make_noisy(const CleanScene& scene, const LightCase& light,
                      const std::shared_ptr<const NoiseModel>& camera, std::uint64_t seed) {
  const NoiseModel& model = *camera;
  NoiseProfile profile = profile_at(model, model.setting_of(light.gain), light);
  return {noisy_frame(scene, light, camera, seed), std::move(profile), &scene, light.ratio,
          white_above_black(model.white_dn, model.black_dn)};
}

void add_to_score(SceneScore& score, const NoisyScene& scene, const ScoredLight& light,
                  DenoiserByRatio* denoiser) {
  Image test_dn;
  double seconds = 0;
  if (denoiser) {
    const FrameDenoiser& opened = denoiser->at(scene.ratio);
    const Stopwatch stopwatch;
    Denoised result = opened(scene.frame, scene.profile, silent_progress());
    seconds = stopwatch.seconds();
    if (!scene.drawn && result.noise)
      if (const std::string line = noise_complaint(*result.noise); !line.empty())
        warn_of(scene.frame.source, line);
    test_dn = std::move(result.dn_above_black);
  } else {
    test_dn = above_black(scene.frame);
    subtract_bias(test_dn, scene.profile);
  }
  for (float& v : test_dn.values()) v *= static_cast<float>(scene.ratio);
  const Evaluation e =
      evaluate_mosaics(scene.clean->clean_dn, test_dn, scene.frame.layout, scene.range_dn);
  add_to_sums(score.sums, e, seconds);
  add_to_sums(sums_of_case(score, light), e, seconds);
}

Json score_json(const std::vector<SceneScore>& scores) {
  Json list = Json::array();
  for (const SceneScore& score : scores) {
    Json row{{"name", score.name}};
    row.update(means_json(score.sums));
    row["by_case"] = Json::array();
    for (const auto& [light, sums] : score.by_case) {
      Json one{{"case", light.name}};
      one.update(means_json(sums));
      row["by_case"].push_back(std::move(one));
    }
    list.push_back(std::move(row));
  }
  return list;
}

std::string score_text(const std::vector<SceneScore>& scores) {
  return table_text(all_sums(scores));
}

std::string score_text_by_case(const std::vector<SceneScore>& scores) {
  std::string text = score_text(scores);
  for (const auto& [light, rows] : sums_by_case(scores))
    text += fmt::format("\n{}:\n\n{}", cases_text({light}), table_text(rows));
  return text;
}

std::string cases_text(const std::vector<ScoredLight>& lights) {
  std::vector<std::pair<std::string, std::vector<std::string>>> lights_of_gain;
  for (const ScoredLight& light : lights) {
    const std::string gain = light.gain.text();
    if (lights_of_gain.empty() || lights_of_gain.back().first != gain)
      lights_of_gain.push_back({gain, {}});
    lights_of_gain.back().second.push_back(light.ratio == 1 ? "all"
                                                            : fmt::format("1/{:g}", light.ratio));
  }
  std::string words;
  for (const auto& [gain, shares] : lights_of_gain) {
    std::string list;
    for (std::size_t i = 0; i < shares.size(); ++i)
      list += (i == 0 ? "" : i + 1 == shares.size() ? " and " : ", ") + shares[i];
    words += fmt::format("{}{} at {} of the light", words.empty() ? "" : "; ", gain, list);
  }
  return words;
}

Json score_record(const std::string& title, const std::string& of, const std::string& note,
                  const std::vector<SceneScore>& scores) {
  Json tables =
      Json::array({sums_table(fmt::format("Means over {} and cases", of), note, all_sums(scores))});
  for (const auto& [light, rows] : sums_by_case(scores))
    tables.push_back(
        sums_table(fmt::format("Means over {}, {}", of, cases_text({light})), "", rows));
  return {{"title", title}, {"tables", std::move(tables)}};
}

}  // namespace malus::app
