// Every command registers itself here; the order is the order of `malus --help`.
#pragma once

#include "program.h"

namespace malus::app {

// add_<command>(app, common) is defined in cmd_<command>.cpp.
#define MALUS_COMMANDS(command) command(info) command(session_from_emva) command(model) command(stokes)

#define MALUS_DECLARE(name) void add_##name(CLI::App& app, Common& common);
MALUS_COMMANDS(MALUS_DECLARE)
#undef MALUS_DECLARE

}  // namespace malus::app
