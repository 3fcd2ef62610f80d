#include "model_import.h"

#include "malus/base/error.h"

#include <memory>

#include "networks_door.h"
#include "output_check.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

struct ImportArguments {
  ImportRequest request;
  std::string settings, package;
};

nlohmann::json json_object_of(const std::string& text, const std::string& flag) {
  if (text.empty()) return nlohmann::json::object();
  const auto json = nlohmann::json::parse(text, nullptr, false);
  if (!json.is_object())
    throw InputError(flag + " " + text, "is no JSON object",
                     "write names and values: {\"width\": 32}");
  return json;
}

void run_import_weights(const ImportArguments& arguments, const Common& common) {
  ImportRequest request = arguments.request;
  request.settings = json_object_of(arguments.settings, "--settings");
  request.package = json_object_of(arguments.package, "--package");
  request.force = common.force;
  if (request.output.extension() != ".safetensors")
    throw InputError(request.output.string(), "is no name of a weight file",
                     "let it end in .safetensors");
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
      ->required();
  command
      ->add_option("--architecture", arguments->request.architecture,
                   "unet, nafnet, restormer, uformer or malus, or a size of docs/networks.md, e.g. "
                   "uformer-t")
      ->required();
  command->add_option("--settings", arguments->settings,
                      "the architecture's settings where they differ from its defaults, as JSON");
  command->add_option("--package", arguments->package,
                      "what goes in and out where it differs from linear light of a "
                      "polar-bayer-rggb sensor, as JSON (docs/networks.md)");
}

}  // namespace malus::app
