// malus experiment denoise: clean scenes with a camera's noise or captured frames, every denoising
// method, and how near each comes: the shape of 000 Table 1.
#include "malus/denoise/denoiser.h"

#include <memory>
#include <optional>
#include <vector>

#include "experiments.h"
#include "flags.h"
#include "output_check.h"
#include "report_pages.h"
#include "scene_scores.h"
#include "test_frames.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct DenoiseExperimentArguments {
  TestFrames frames;
  fs::path report;
  std::vector<std::string> methods;
  std::optional<double> row_noise;
};

struct ScoredMethod {
  DenoiseSettings settings;
  InferenceSettings network;
};

// A network's file may be followed by the precision of its products.
ScoredMethod scored_method(std::string name) {
  InferenceSettings network;
  if (name.ends_with(".safetensors/bfloat16")) {
    network.precision = "bfloat16";
    name.resize(name.rfind('/'));
  }
  return {method_settings_of(name), network};
}

std::unique_ptr<DenoiserByRatio> denoiser_of(const std::string& name) {
  const ScoredMethod method = scored_method(name);
  auto denoiser = std::make_unique<DenoiserByRatio>(method.settings, method.network);
  // Opened before the first frame is drawn: what is wrong with a method is said at once.
  if (const std::string line = denoiser->at(1).precision_complaint(); !line.empty()) warn(line);
  return denoiser;
}

void run_denoise_experiment(const DenoiseExperimentArguments& arguments, const Common& common) {
  arguments.frames.check_usage();
  std::vector<fs::path> read = arguments.frames.files_named();
  read.insert(read.end(), arguments.methods.begin(), arguments.methods.end());
  check_report_apart(arguments.report, read, {}, common.force);
  std::vector<std::string> methods = arguments.methods;
  if (methods.empty())
    for (const DenoiseMethod& method : denoise_methods()) methods.push_back(method.name);
  std::vector<SceneScore> scores{{.name = "noisy"}};
  std::vector<std::unique_ptr<DenoiserByRatio>> denoisers(1);  // the noisy frame has none
  for (const std::string& name : methods) {
    scores.push_back({.name = name});
    denoisers.push_back(denoiser_of(name));
  }
  OpenTestFrames frames(arguments.frames, arguments.row_noise);
  const auto progress = make_progress(common);
  frames.for_each(common.seed, *progress, [&](NoisyScene& noisy, const ScoredLight& light) {
    for (std::size_t m = 0; m < scores.size(); ++m)
      add_to_score(scores[m], noisy, light, denoisers[m].get());
  });
  Json json = frames.facts();
  json.update({{"row_noise", arguments.row_noise ? Json(*arguments.row_noise) : Json()},
               {"estimate_noise", arguments.frames.estimate_noise},
               {"methods", score_json(scores)}});
  if (!arguments.report.empty())
    write_record_report(frames.record("Experiment: denoising methods", scores), arguments.report,
                        common.force);
  print_result(common, json, score_text(scores));
}

}  // namespace

void add_denoise_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<DenoiseExperimentArguments>();
  CLI::App* command =
      add_command(experiment, common, "denoise",
                  "Denoising methods on clean scenes with a camera's noise, or on captured frames",
                  {.seed = true, .force = true},
                  [arguments, &common] { run_denoise_experiment(*arguments, common); });
  arguments->frames.add_options(*command);
  command
      ->add_option(
          "--methods", arguments->methods,
          "METHOD[/PROFILE[/no-row-noise]] or a network's FILE.safetensors[/bfloat16]; all "
          "classical methods when left out")
      ->check(accepted_by([](const std::string& name) { scored_method(name); }));
  command
      ->add_option("--row-noise", arguments->row_noise,
                   "row noise in place of the model's [deviations of its read noise]")
      ->excludes(command->get_option("--test-pairs"))
      ->check(in_range(0.0, 100.0));
  command->add_flag("--estimate-noise", arguments->frames.estimate_noise,
                    "methods do not know the model: the noise is estimated from every frame");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace malus::app
