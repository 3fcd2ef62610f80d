// malus experiment uncertainty: whether the stated error of a denoised pixel is the true one, on
// clean scenes with a camera's noise.
#include "malus/evaluate/uncertainty_check.h"

#include <memory>
#include <vector>

#include "denoise_checks.h"
#include "denoise_method.h"
#include "experiments.h"
#include "flags.h"
#include "scene_scores.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;

struct UncertaintyExperimentArguments {
  SceneRuns runs{.scenes = {}, .crop = 384};
  std::vector<std::string> methods{DenoiseSettings{}.method};
  std::string profile = "normal";
};

struct CheckedScene {
  std::string scene, light, method;
  UncertaintyCheck check;
};

struct Column {
  const char *name, *title;
  Coverage UncertaintyCheck::*coverage;
  bool bounded = true;  // what is stated; not of DoLP where S0 is near zero
};
constexpr Column kColumns[] = {{"pixel", "pixel", &UncertaintyCheck::pixel},
                               {"s0", "S0", &UncertaintyCheck::s0},
                               {"s1", "S1", &UncertaintyCheck::s1},
                               {"s2", "S2", &UncertaintyCheck::s2},
                               {"dolp", "DoLP", &UncertaintyCheck::dolp, false},
                               {"aolp", "AoLP", &UncertaintyCheck::aolp}};

UncertaintyCheck check_scene(const NoisyScene& noisy, const FrameDenoiser& denoiser) {
  const Denoised result = denoiser(noisy.frame, noisy.profile, silent_progress());
  Image truth = noisy.clean->clean_dn;
  for (float& v : truth.values()) v /= static_cast<float>(noisy.ratio);
  UncertaintyCheck check;
  add_uncertainty(check, truth, result.dn_above_black, *result.variance_dn2, noisy.frame.layout);
  return check;
}

Json rows_json(const std::vector<CheckedScene>& rows) {
  Json list = Json::array();
  for (const CheckedScene& row : rows) {
    Json json{{"scene", row.scene}, {"case", row.light}, {"method", row.method}};
    for (const Column& column : kColumns) {
      const Coverage& coverage = row.check.*column.coverage;
      json["coverage"][column.name] = coverage.all > 0 ? Json(coverage.share()) : Json();
      if (column.bounded)
        json["error_over_stated"][column.name] =
            coverage.all > 0 ? Json(coverage.error_over_stated()) : Json();
    }
    for (const auto& [name, dolp] :
         {std::pair{"dolp", row.check.as_it_is}, std::pair{"dolp_corrected", row.check.corrected}})
      json[name] = dolp.squared.count > 0
                       ? Json{{"psnr_db", *psnr_db(dolp.squared, 1.0)}, {"mean_error", dolp.mean()}}
                       : Json();
    list.push_back(std::move(json));
  }
  return list;
}

std::string rows_text(const std::vector<CheckedScene>& rows) {
  std::string text =
      "Cells: squared error over the stated variance (1: as stated; sums over all pixels), and "
      "how\n"
      "many pixels have the truth within two stated deviations (95 % of normal errors).\n"
      "DoLP [dB]: its PSNR and mean error as it is, and with the correction of stokes "
      "--variance.\n\n";
  std::string line = "|---|---|---|";
  text += "| scene | gain : ratio | method |";
  for (const Column& column : kColumns) {
    text += fmt::format(" {} |", column.title);
    line += "---|";
  }
  text += " DoLP [dB] (bias) | corrected |\n" + line + "---|---|\n";
  for (const CheckedScene& row : rows) {
    text += fmt::format("| {} | {} | {} |", row.scene, row.light, row.method);
    for (const Column& column : kColumns) {
      const Coverage& coverage = row.check.*column.coverage;
      if (coverage.all > 0 && column.bounded)
        text += fmt::format(" {:.2f},", coverage.error_over_stated());
      text += coverage.all > 0 ? fmt::format(" {:.0f} % |", 100 * coverage.share()) : " - |";
    }
    for (const DolpError& dolp : {row.check.as_it_is, row.check.corrected})
      text += dolp.squared.count > 0
                  ? fmt::format(" {:.2f} ({:+.3f}) |", *psnr_db(dolp.squared, 1.0), dolp.mean())
                  : " - |";
    text += '\n';
  }
  return text;
}

void run_uncertainty_experiment(const UncertaintyExperimentArguments& arguments,
                                const Common& common) {
  const NoiseModel model = arguments.runs.load_camera();
  std::vector<std::unique_ptr<DenoiserByRatio>> denoisers;
  for (const std::string& method : arguments.methods) {
    check_states_error("stated errors", method);
    DenoiseSettings settings;
    settings.method = method;
    settings.profile = arguments.profile;
    denoisers.push_back(std::make_unique<DenoiserByRatio>(settings, InferenceSettings{}, true));
    denoisers.back()->at(1);  // what is wrong with a method is said at once
  }
  const auto progress = make_progress(common);
  std::vector<CheckedScene> rows;
  arguments.runs.for_each(model, common.seed, *progress,
                          [&](const NoisyScene& noisy, const ScoredLight& light) {
                            for (std::size_t m = 0; m < denoisers.size(); ++m)
                              rows.push_back({noisy.clean->name, light.name, arguments.methods[m],
                                              check_scene(noisy, denoisers[m]->at(noisy.ratio))});
                          });
  print_result(common,
               Json{{"model", arguments.runs.model},
                    {"profile", arguments.profile},
                    {"crop", arguments.runs.crop},
                    {"rows", rows_json(rows)}},
               rows_text(rows));
}

}  // namespace

void add_uncertainty_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<UncertaintyExperimentArguments>();
  CLI::App* command = add_command(
      experiment, common, "uncertainty",
      "Stated errors of denoised pixels against the true ones: squared error over the "
      "stated, and how often two deviations hold the truth",
      {.seed = true}, [arguments, &common] { run_uncertainty_experiment(*arguments, common); });
  arguments->runs.add_options(*command);
  command->get_option("SCENE")->required();
  command->add_option("--methods", arguments->methods, "methods that state their errors")
      ->check(accepted_by(require_method))
      ->capture_default_str();
  command->add_option("--profile", arguments->profile, "profile of the denoisers")
      ->check(one_of(choices_of<DenoiseSettings>("profile")))
      ->capture_default_str();
}

}  // namespace malus::app
