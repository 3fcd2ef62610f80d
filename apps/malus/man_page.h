// Manual pages (man 7 macros) from the command line's declarations.
#pragma once

#include <string>

#include "cli_tree.h"

namespace malus::app {

/// One page; commands inside a command ("model show") are sections of its page. The program's own
/// page lists its commands and exit codes.
std::string man_page(const CliCommand& command, const std::string& version);

/// "malus-model" for "malus model".
std::string man_page_name(const CliCommand& command);

}  // namespace malus::app
