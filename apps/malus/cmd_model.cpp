// malus model show, malus model list.
#include "malus/base/error.h"
#include "malus/noise/builtin_models.h"

#include <filesystem>
#include <memory>
#include <optional>

#include "model_json.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

struct ShowArguments {
  std::filesystem::path model;
  std::optional<double> gain_db, iso;
  bool extrapolate = false;
};

void show(const Common& common, const ShowArguments& arguments) {
  NoiseModel model = load_model(arguments.model);
  const GainSetting gain{arguments.gain_db, arguments.iso};
  if (gain.decibel())
    model = model_at_gain(
        model, gain,
        arguments.extrapolate ? GainRange::kAllowExtrapolation : GainRange::kCalibratedOnly);
  print_result(common, model_json(model), model_text(model));
}

void list(const Common& common) {
  nlohmann::ordered_json models = nlohmann::ordered_json::array();
  std::string text;
  for (const BuiltinModel& model : builtin_models()) {
    models.push_back(
        {{"name", model.name}, {"description", model.description}, {"licence", model.licence}});
    text += fmt::format("{:<22}{} ({})\n", model.name, model.description, model.licence);
  }
  print_result(common, {{"models", models}}, text);
}

}  // namespace

void add_model(CLI::App& app, Common& common) {
  CLI::App* model = app.add_subcommand("model", "Show a noise model, or list the built-in ones");
  model->require_subcommand(1);
  auto arguments = std::make_shared<ShowArguments>();
  CLI::App* show_command =
      add_command(*model, common, "show", "Parameters of a noise model with units and errors",
                  [&common, arguments] { show(common, *arguments); });
  show_command->add_option("model", arguments->model, "model file or name of a built-in model")
      ->required();
  CLI::Option* gain = show_command->add_option("--gain", arguments->gain_db, "one gain only [dB]");
  show_command->add_option("--iso", arguments->iso, "one gain only, as ISO")
      ->check(CLI::PositiveNumber)
      ->excludes(gain);
  show_command->add_flag("--extrapolate-gain", arguments->extrapolate,
                         "allow a gain outside the calibrated range");
  add_command(*model, common, "list", "The built-in noise models", [&common] { list(common); });
}

}  // namespace malus::app
