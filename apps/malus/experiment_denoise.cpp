// malus experiment denoise: clean polarization scenes, a camera's noise, every denoising method,
// and how near each comes: the shape of 000 Table 1 without networks.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/denoise/denoiser.h"
#include "malus/evaluate/evaluation.h"
#include "malus/io/picture_file.h"
#include "malus/noise/model.h"
#include "malus/synthesize/synthesizer.h"

#include <chrono>
#include <memory>
#include <vector>

#include "experiments.h"
#include "flags.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct Case {
  double gain_db, ratio;
};

struct Arguments {
  std::vector<fs::path> scenes;
  fs::path report;
  std::string model = "imx250myr-simulated";
  std::vector<std::string> methods, cases{"12:10", "12:60", "24:10"};
  int crop = 512;
};

struct Scene {
  std::string name;
  Image clean_dn;
};

// One line of the table: sums over scenes and cases.
struct Score {
  std::string name;
  double image = 0, dolp = 0, aolp = 0, seconds = 0;
};

// Where a mosaic pixel's colour is found in an RGB picture; 0 in a picture of one channel.
int picture_channel(Color color, int channels) {
  if (channels < 3) return 0;
  return color == Color::kRed ? 0 : color == Color::kBlue ? 2 : 1;
}

// The four pictures I0, I45, I90, I135 of a folder, through the sensor's mosaic; white is the
// camera's. The middle crop x crop pixels.
Scene load_scene(const fs::path& folder, const NoiseModel& model, int crop) {
  std::vector<Picture> angles;
  for (const int angle : {0, 45, 90, 135})
    angles.push_back(load_picture(folder / fmt::format("I{}.png", angle)));
  const int cell = std::max(model.layout.rows(), model.layout.cols());
  const auto middle = [&](int size, int& start) {
    const int length = std::min(size, crop) / cell * cell;
    start = (size - length) / 2 / cell * cell;
    return length;
  };
  int row0 = 0, col0 = 0;
  const int rows = middle(angles[0].planes.rows(), row0),
            cols = middle(angles[0].planes.cols(), col0);
  Scene scene{folder.filename().string(), Image(rows, cols)};
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const int channel = model.layout.channel_at(r, c);
      const Site& site = model.layout.site(channel);
      if (!site.angle_deg)
        throw InputError("--model", "is not of a polarization camera", "give another model");
      const Picture& picture = angles[static_cast<std::size_t>(*site.angle_deg / 45)];
      const Image& plane = picture.planes[picture_channel(site.color, picture.planes.channels())];
      const double white = model.white_dn - model.black_dn[static_cast<std::size_t>(channel)];
      scene.clean_dn(r, c) = static_cast<float>(plane(row0 + r, col0 + c) / picture.white * white);
    }
  return scene;
}

// "bm3d", "bm3d/fast", "bm3d/normal/no-row-noise"
DenoiseSettings settings_of(const std::string& text) {
  DenoiseSettings settings;
  std::size_t start = 0;
  for (int field = 0; start <= text.size(); ++field) {
    const std::size_t end = std::min(text.find('/', start), text.size());
    const std::string part = text.substr(start, end - start);
    if (field == 0) settings.method = part;
    if (field == 1) settings.profile = part;
    if (field == 2 && part == "no-row-noise") settings.row_noise = false;
    start = end + 1;
  }
  return settings;
}

Case case_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  try {
    if (colon != std::string::npos) return {std::stod(text), std::stod(text.substr(colon + 1))};
  } catch (const std::exception&) {  // reported below
  }
  throw InputError("--cases " + text, "is not GAIN:RATIO",
                   "e.g. 12:60 for 12 dB and a sixtieth of the light");
}

void add_score(Score& score, const Image& clean_dn, Image test_dn, double ratio,
               const NoiseModel& model) {
  for (float& v : test_dn.values()) v *= static_cast<float>(ratio);
  const Evaluation e =
      evaluate_mosaics(clean_dn, test_dn, model.layout, model.white_dn - model.black_dn.front());
  score.image += *e.image_psnr_db;
  score.dolp += e.dolp_psnr_db.value_or(0);
  score.aolp += e.aolp_circular_deg.value_or(0);
}

void run_case(const Scene& scene, const Case& light, const NoiseModel& model, std::uint64_t seed,
              std::vector<Score>& scores) {
  SynthesisSettings synthesis;
  synthesis.ratio = light.ratio;
  const Synthesizer camera(model, synthesis);
  GainSetting gain;
  gain.gain_db = light.gain_db;
  RawFrame noisy = camera.draw_raw(scene.clean_dn, gain, DrawAddress{.seed = seed}, model.black_dn,
                                   model.white_dn);
  noisy.source = scene.name;
  const NoiseProfile profile = model.profile_at(gain);
  Image before = noisy.dn;
  for (int r = 0; r < before.rows(); ++r)
    for (int c = 0; c < before.cols(); ++c)
      before(r, c) -= static_cast<float>(
          noisy.black_at(r, c) +
          profile.channels[static_cast<std::size_t>(noisy.layout.channel_at(r, c))].bias_dn);
  add_score(scores[0], scene.clean_dn, std::move(before), light.ratio, model);
  for (std::size_t m = 1; m < scores.size(); ++m) {
    const auto start = std::chrono::steady_clock::now();
    Denoised result = denoise_frame(noisy, profile, settings_of(scores[m].name));
    scores[m].seconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    add_score(scores[m], scene.clean_dn, std::move(result.dn_above_black), light.ratio, model);
  }
}

// The table as a record that a report shows (docs/report.md).
Json record_of(const Json& result) {
  Json table = {{"title", "Denoising methods"},
                {"note", fmt::format("Means over the scenes and over the cases (gain : low-light "
                                     "ratio) {}; noise of {}.",
                                     result["cases"].dump(), result["model"].get<std::string>())},
                {"head", "method"},
                {"columns",
                 {{{"name", "image PSNR"}, {"unit", "dB"}},
                  {{"name", "DoLP PSNR"}, {"unit", "dB"}},
                  {{"name", "AoLP circular error"}, {"unit", "deg"}},
                  {{"name", "time per frame"}, {"unit", "s"}}}},
                {"rows", Json::array()}};
  for (const Json& method : result["methods"])
    table["rows"].push_back({{"name", method["name"]},
                             {"cells",
                              {method["image_psnr_db"], method["dolp_psnr_db"],
                               method["aolp_circular_deg"], method["seconds"]}}});
  return {{"title", "Experiment: denoising methods"}, {"tables", Json::array({table})}};
}

void run(const Arguments& arguments, const Common& common) {
  if (!arguments.report.empty()) check_output(arguments.report, common.force);
  const NoiseModel model = load_model(arguments.model);
  std::vector<Score> scores{{"noisy"}};
  for (const std::string& name : arguments.methods) scores.push_back({name});
  if (arguments.methods.empty())
    for (const DenoiseMethod& method : denoise_methods()) scores.push_back({method.name});
  const auto progress = make_progress(common);
  progress->begin("experiment", std::ssize(arguments.scenes) * std::ssize(arguments.cases));
  std::uint64_t seed = common.seed;
  for (const fs::path& folder : arguments.scenes) {
    const Scene scene = load_scene(folder, model, arguments.crop);
    for (const std::string& text : arguments.cases) {
      check_stop(*progress);
      run_case(scene, case_of(text), model, seed++, scores);
      progress->advance(1);
    }
  }
  const double n = static_cast<double>(arguments.scenes.size() * arguments.cases.size());
  Json json{{"model", arguments.model}, {"cases", arguments.cases}, {"crop", arguments.crop}};
  std::string table =
      "| method | image PSNR [dB] | DoLP PSNR [dB] | AoLP circular RMS [deg] | s per frame |\n"
      "|---|---|---|---|---|\n";
  for (const Score& score : scores) {
    json["methods"].push_back({{"name", score.name},
                               {"image_psnr_db", score.image / n},
                               {"dolp_psnr_db", score.dolp / n},
                               {"aolp_circular_deg", score.aolp / n},
                               {"seconds", score.seconds / n}});
    table += fmt::format("| {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n", score.name,
                         score.image / n, score.dolp / n, score.aolp / n, score.seconds / n);
  }
  if (!arguments.report.empty())
    write_record_report(record_of(json), arguments.report, common.force);
  print_result(common, json, table);
}

}  // namespace

void add_denoise_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      add_command(experiment, common, "denoise",
                  "denoising methods on clean polarization scenes with a camera's noise",
                  [arguments, &common] { run(*arguments, common); });
  command->add_option("SCENE", arguments->scenes, "folders with I0.png, I45.png, I90.png, I135.png")
      ->required();
  command->add_option("--model", arguments->model, "noise model, a file or a built-in name")
      ->capture_default_str();
  command->add_option("--cases", arguments->cases, "gain [dB] : low-light ratio")
      ->capture_default_str();
  command->add_option("--methods", arguments->methods,
                      "METHOD[/PROFILE[/no-row-noise]]; all methods when left out");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
  command->add_option("--crop", arguments->crop, "middle part of the scenes [pixels]")
      ->check(CLI::Range(16, 100000))
      ->capture_default_str();
}

}  // namespace malus::app
