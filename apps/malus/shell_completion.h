// Completion scripts for shells from the command line's declarations.
#pragma once

#include <string>

#include "cli_tree.h"

namespace malus::app {

std::string bash_completion(const CliCommand& program);
std::string zsh_completion(const CliCommand& program);
std::string fish_completion(const CliCommand& program);

}  // namespace malus::app
