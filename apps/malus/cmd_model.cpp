// malus model show, malus model check, malus model list.
#include "malus/base/error.h"
#include "malus/evaluate/leave_one_gain_out.h"
#include "malus/noise/builtin_models.h"

#include <filesystem>
#include <memory>
#include <optional>

#include "flags.h"
#include "frame_input.h"
#include "model_from_dng.h"
#include "model_import.h"
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

void show_model(const Common& common, const ShowArguments& arguments) {
  const GainSetting gain{arguments.gain_db, arguments.iso};
  if (arguments.extrapolate && !gain.decibel())
    throw CLI::ValidationError("--extrapolate-gain", "needs --gain or --iso");
  NoiseModel model = load_model(arguments.model);
  warn_of_untold_gain(model, arguments.model, {gain});
  if (gain.decibel())
    model = naming_model(arguments.model, [&] {
      return model_at_gain(model, gain, gain_range(arguments.extrapolate));
    });
  print_result(common, model_json(model), model_text(model));
}

nlohmann::ordered_json left_out_json(const std::vector<LeftOutGain>& gains, bool physics) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  for (const LeftOutGain& g : gains) {
    nlohmann::ordered_json json = {{"gain", g.gain.text()}, {"predicted", g.why_not.empty()}};
    if (!g.why_not.empty()) {
      json["why_not"] = g.why_not;
    } else {
      if (physics) {
        json["K_error"] = g.K_error;
        json["read_noise_error"] = g.read_error;
        json["mu_error_dn"] = g.mu_error_dn;
      }
      json["sigma_row_error"] = g.row_error;
      json["sqrt_jsd"] = g.sqrt_jsd;
      json["sqrt_jsd_nearest"] = g.sqrt_jsd_nearest;
    }
    all.push_back(json);
  }
  return all;
}

std::string percent_cell(double share) {
  const std::string text = fmt::format("{:+.2f}", 100 * share);
  return text == "-0.00" || text == "+0.00" ? "0.00" : text;
}

std::string left_out_text(const std::vector<LeftOutGain>& gains, const char* kind) {
  std::string text =
      fmt::format("\n{}\n{:>10}{:>9}{:>12}{:>11}{:>10}{:>10}{:>14}\n", kind, "gain left", "K",
                  "read noise", "row noise", "mu", "sqrt JSD", "sqrt JSD of");
  text += fmt::format("{:>10}{:>9}{:>12}{:>11}{:>10}{:>10}{:>14}\n", "out", "%", "%", "%", "DN", "",
                      "nearest gain");
  for (const LeftOutGain& g : gains)
    text += g.why_not.empty() ? fmt::format("{:>10}{:>9}{:>12}{:>11}{:>+10.3f}{:>10.4f}{:>14.4f}\n",
                                            g.gain.text(), percent_cell(g.K_error),
                                            percent_cell(g.read_error), percent_cell(g.row_error),
                                            g.mu_error_dn, g.sqrt_jsd, g.sqrt_jsd_nearest)
                              : fmt::format("{:>10}  not predicted: {}\n", g.gain.text(),
                                            g.why_not.substr(0, g.why_not.find(": ")));
  return text;
}

// What the tables are of, and how to read them.
std::string left_out_header(const std::filesystem::path& path, const NoiseModel& model) {
  return fmt::format(
      "{}: {}\n"
      "Every gain is left out once and predicted from the others: error of the worst\n"
      "channel, and the root of the Jensen-Shannon divergence (base 2; 0: the same\n"
      "noise, 1: nothing in common) between the predicted noise and the measured one,\n"
      "beside that of the nearest gain's noise taken as it is.\n",
      path.string(), model.sensor.empty() ? "a sensor without a name" : model.sensor);
}

void check_model(const Common& common, const std::filesystem::path& path) {
  const NoiseModel model = load_model(path);
  const auto physics = leave_one_gain_out_physics(model);
  const auto nonparametric = leave_one_gain_out_nonparametric(model);
  if (physics.empty() && nonparametric.empty())
    throw InputError(path.string(), "has fewer than three gains of one kind to leave one out",
                     "calibrate at more gains");
  nlohmann::ordered_json json;
  std::string text = left_out_header(path, model);
  if (!physics.empty()) {
    json["physics"] = left_out_json(physics, true);
    text += left_out_text(physics, "Physics");
  }
  if (!nonparametric.empty()) {
    json["nonparametric"] = left_out_json(nonparametric, false);
    text += left_out_text(nonparametric, "Non-parametric");
  }
  print_result(common, json, text);
}

void list_models(const Common& common) {
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
  CLI::App* model = app.add_subcommand(
      "model", "Show or check a noise model, list the built-in ones, or import weights");
  model->require_subcommand(1);
  auto arguments = std::make_shared<ShowArguments>();
  CLI::App* show_command =
      add_command(*model, common, "show", "Parameters of a noise model with units and errors", {},
                  [&common, arguments] { show_model(common, *arguments); });
  show_command->add_option("MODEL", arguments->model, "model file or name of a built-in model")
      ->required();
  CLI::Option* gain = show_command->add_option("--gain", arguments->gain_db, "one gain only [dB]")
                          ->check(gain_in_db());
  show_command->add_option("--iso", arguments->iso, "one gain only, as ISO")
      ->check(positive_number())
      ->excludes(gain);
  show_command->add_flag("--extrapolate-gain", arguments->extrapolate,
                         "allow a gain outside the calibrated range");
  auto checked = std::make_shared<std::filesystem::path>();
  CLI::App* check_command = add_command(
      *model, common, "check", "Leave every gain out once: how well do the others predict it?", {},
      [&common, checked] { check_model(common, *checked); });
  check_command->add_option("MODEL", *checked, "model file or name of a built-in model")
      ->required();
  add_import_weights(*model, common);
  add_model_from_dng(*model, common);
  add_command(*model, common, "list", "The built-in noise models", {},
              [&common] { list_models(common); });
}

}  // namespace malus::app
