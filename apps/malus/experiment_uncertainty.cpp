// malus experiment uncertainty: whether the stated error of a denoised pixel is the true one, on
// clean scenes with a camera's noise.
#include "malus/evaluate/uncertainty_check.h"

#include <memory>
#include <vector>

#include "experiments.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct Arguments {
  std::vector<fs::path> scenes;
  std::string model = "imx250myr-simulated", profile = "normal";
  std::vector<std::string> cases{"12:10", "12:60", "24:10"};
  int crop = 384;
};

struct Row {
  std::string scene, light;
  UncertaintyCheck check;
};

struct Column {
  const char *name, *title;
  Coverage UncertaintyCheck::*coverage;
};
constexpr Column kColumns[] = {
    {"pixel", "pixel", &UncertaintyCheck::pixel}, {"s0", "S0", &UncertaintyCheck::s0},
    {"s1", "S1", &UncertaintyCheck::s1},          {"s2", "S2", &UncertaintyCheck::s2},
    {"dolp", "DoLP", &UncertaintyCheck::dolp},    {"aolp", "AoLP", &UncertaintyCheck::aolp}};

UncertaintyCheck check_scene(const CleanScene& scene, const NoisyScene& noisy,
                             const FrameDenoiser& denoiser) {
  const Denoised result = denoiser(noisy.frame, noisy.profile, silent_progress());
  Image truth = scene.clean_dn;
  for (float& v : truth.values()) v /= static_cast<float>(noisy.ratio);
  UncertaintyCheck check;
  add_uncertainty(check, truth, result.dn_above_black, *result.variance_dn2, noisy.frame.layout);
  return check;
}

Json rows_json(const std::vector<Row>& rows) {
  Json list = Json::array();
  for (const Row& row : rows) {
    Json json{{"scene", row.scene},
              {"case", row.light},
              {"error_over_stated", row.check.error_over_stated()}};
    for (const Column& column : kColumns) {
      const Coverage& coverage = row.check.*column.coverage;
      json["coverage"][column.name] = coverage.all > 0 ? Json(coverage.share()) : Json();
    }
    list.push_back(std::move(json));
  }
  return list;
}

std::string rows_text(const std::vector<Row>& rows) {
  std::string text = "| scene | gain : ratio | error / stated |", line = "|---|---|---|";
  for (const Column& column : kColumns) {
    text += fmt::format(" {} |", column.title);
    line += "---|";
  }
  text += "\n" + line + "\n";
  for (const Row& row : rows) {
    text +=
        fmt::format("| {} | {} | {:.2f} |", row.scene, row.light, row.check.error_over_stated());
    for (const Column& column : kColumns) {
      const Coverage& coverage = row.check.*column.coverage;
      text += coverage.all > 0 ? fmt::format(" {:.0f} % |", 100 * coverage.share()) : " - |";
    }
    text += '\n';
  }
  return text;
}

void run(const Arguments& arguments, const Common& common) {
  const NoiseModel model = load_model(arguments.model);
  DenoiseSettings settings;
  settings.profile = arguments.profile;
  const FrameDenoiser denoiser(settings, {}, true);
  const auto progress = make_progress(common);
  progress->begin("experiment", std::ssize(arguments.scenes) * std::ssize(arguments.cases));
  std::vector<Row> rows;
  std::uint64_t seed = common.seed;
  for (const fs::path& path : arguments.scenes) {
    const CleanScene scene = load_scene(path, model, arguments.crop);
    for (const std::string& text : arguments.cases) {
      check_stop(*progress);
      const NoisyScene noisy = make_noisy(scene, light_case_of(text), model, seed++);
      rows.push_back({scene.name, text, check_scene(scene, noisy, denoiser)});
      progress->advance(1);
    }
  }
  print_result(common,
               Json{{"model", arguments.model},
                    {"profile", arguments.profile},
                    {"crop", arguments.crop},
                    {"rows", rows_json(rows)}},
               rows_text(rows));
}

}  // namespace

void add_uncertainty_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* command =
      add_command(experiment, common, "uncertainty",
                  "stated errors of denoised pixels against the true ones: squared error over the "
                  "stated, and how often two deviations hold the truth",
                  [arguments, &common] { run(*arguments, common); });
  add_scene_options(*command, arguments->scenes, arguments->model, arguments->cases,
                    arguments->crop);
  command->add_option("--profile", arguments->profile, "profile of the denoiser")
      ->capture_default_str();
}

}  // namespace malus::app
