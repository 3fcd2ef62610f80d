#include "model_import.h"

#include "malus/base/text.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "networks_door.h"
#include "output_check.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

struct ImportArguments {
  ImportRequest request;
  std::string settings, package;
};

nlohmann::json json_object_of(const std::string& text) {
  return text.empty() ? nlohmann::json::object() : nlohmann::json::parse(text, nullptr, false);
}

CLI::Validator json_object() {
  return CLI::Validator("").operation([](std::string& text) {
    return json_object_of(text).is_object()
               ? std::string()
               : text + " is no JSON object; write names and values: {\"width\": 32}";
  });
}

CLI::Validator weight_file_name() {
  return CLI::Validator("").operation([](std::string& name) {
    return std::filesystem::path(name).extension() == ".safetensors"
               ? std::string()
               : name + " is no name of a weight file; let it end in .safetensors";
  });
}

// Not at parsing: the module of networks knows them.
void require_architecture(const std::string& wanted) {
  std::vector<std::string> known;
  for (const NamedNetwork& network : networks().named_networks())
    for (const std::string& name : {network.architecture, network.name})
      if (std::ranges::find(known, name) == known.end()) known.push_back(name);
  if (std::ranges::find(known, wanted) == known.end())
    throw CLI::ValidationError("--architecture",
                               fmt::format("\"{}\" is none; {}known: {}", wanted,
                                           did_you_mean(wanted, known), joined(known)));
}

void run_import_weights(const ImportArguments& arguments, const Common& common) {
  require_architecture(arguments.request.architecture);
  ImportRequest request = arguments.request;
  request.settings = json_object_of(arguments.settings);
  request.package = json_object_of(arguments.package);
  request.force = common.force;
  check_output_apart("--output", request.output, {request.checkpoint}, {}, common.force);
  const auto json = networks().import_checkpoint(request);
  print_result(
      common, json,
      fmt::format("{}: {}, {} values -> {}\n", request.checkpoint.string(), request.architecture,
                  json["parameters"].get<std::int64_t>(), json["file"].get<std::string>()));
}

}  // namespace

void add_import_weights(CLI::App& model, Common& common) {
  const auto arguments = std::make_shared<ImportArguments>();
  CLI::App* command = add_command(
      model, common, "import-weights",
      "A network's weights from a PyTorch checkpoint (.pth, .pt, .safetensors)", {.force = true},
      [arguments, &common] { run_import_weights(*arguments, common); });
  command
      ->add_option("CHECKPOINT", arguments->request.checkpoint,
                   "a state dict written by torch.save, or safetensors; nothing in it is run")
      ->required();
  command->add_option("-o,--output", arguments->request.output, "weight file (.safetensors)")
      ->check(weight_file_name())
      ->required();
  command
      ->add_option("--architecture", arguments->request.architecture,
                   "unet, nafnet, restormer, uformer or malus, or a size of docs/networks.md, e.g. "
                   "uformer-t")
      ->required();
  command
      ->add_option("--settings", arguments->settings,
                   "the architecture's settings where they differ from its defaults, as JSON")
      ->check(json_object());
  command
      ->add_option("--package", arguments->package,
                   "what goes in and out where it differs from linear light of a "
                   "polar-bayer-rggb sensor, as JSON (docs/networks.md)")
      ->check(json_object());
}

}  // namespace malus::app
