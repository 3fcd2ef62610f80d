// The command line as plain data, read from its declarations: man pages and shell completion are
// made from it.
#pragma once

#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace malus::app {

struct CliOption {
  std::vector<std::string> names;    ///< "-o", "--output", "--no-row"; of a positional its name
  std::string value;                 ///< "FLOAT", "TEXT"; empty for a switch
  std::vector<std::string> choices;  ///< the allowed values, where they are a list
  std::vector<std::string> offers;   ///< names that shells complete where there are no choices
  bool or_files = false;             ///< a file may stand in their place
  std::string help, default_value, group;
  bool required = false, repeats = false;
};

struct CliCommand {
  std::string name;  ///< words from the program on: "malus model show"
  std::string help;
  std::vector<CliOption> options, positionals;
  std::vector<CliCommand> commands;
};

CliCommand describe_cli(const CLI::App& app);

/// "malus model show" without its first word: "model show".
std::string words_after_program(const CliCommand& command);

}  // namespace malus::app
