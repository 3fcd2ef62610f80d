#include "cli_tree.h"

#include "malus/denoise/denoiser.h"
#include "malus/image/layout.h"
#include "malus/noise/builtin_models.h"

#include <algorithm>

namespace malus::app {
namespace {

// CLI11 writes the allowed values of IsMember behind the type: "TEXT:{a,b}".
std::vector<std::string> choices_in(const std::string& type) {
  const auto open = type.find('{'), close = type.find('}');
  std::vector<std::string> choices;
  if (open == std::string::npos || close == std::string::npos) return choices;
  for (std::size_t at = open + 1; at < close;) {
    const auto end = std::min(type.find(',', at), close);
    choices.push_back(type.substr(at, end - at));
    at = end + 1;
  }
  return choices;
}

// Names of values that no list checks: files may stand in their place.
void add_offers(CliOption& option) {
  if (!option.choices.empty()) return;
  for (const std::string& name : option.names) {
    if (name == "--layout") option.offers = SensorLayout::known_names();
    if (name == "--model" || name == "MODEL") option.offers = builtin_model_names();
    if (name == "--method" || name == "--methods")
      for (const DenoiseMethod& method : denoise_methods()) option.offers.push_back(method.name);
    option.or_files = !option.offers.empty() && name != "--layout";
    if (!option.offers.empty()) return;
  }
}

CliOption described_option(const CLI::Option& option) {
  CliOption out;
  const std::string type = option.get_type_name();
  out.choices = choices_in(type);
  out.help = option.get_description();
  out.default_value = option.get_default_str();
  out.group = option.get_group();
  out.required = option.get_required();
  out.repeats = option.get_items_expected_max() > 1;
  if (option.get_items_expected_max() > 0) out.value = type.substr(0, type.find(':'));
  for (const auto& name : option.get_snames()) out.names.push_back("-" + name);
  for (const auto& name : option.get_lnames()) out.names.push_back("--" + name);
  if (!option.nonpositional()) out.names = {option.get_single_name()};
  add_offers(out);
  return out;
}

CliCommand described_command(const CLI::App& app, const std::string& name) {
  CliCommand command{name, app.get_description(), {}, {}, {}};
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;  // hidden
    (option->nonpositional() ? command.options : command.positionals)
        .push_back(described_option(*option));
  }
  for (const CLI::App* sub : app.get_subcommands({}))
    command.commands.push_back(described_command(*sub, name + " " + sub->get_name()));
  return command;
}

}  // namespace

CliCommand describe_cli(const CLI::App& app) { return described_command(app, app.get_name()); }

std::string words_after_program(const CliCommand& command) {
  const auto space = command.name.find(' ');
  return space == std::string::npos ? "" : command.name.substr(space + 1);
}

}  // namespace malus::app
