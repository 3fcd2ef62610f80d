// Every command registers itself here; the order is the order of `malus --help`.
#pragma once

#include "program.h"

namespace malus::app {

// add_<command>(app, common) is defined in cmd_<command>.cpp.
#define MALUS_COMMANDS(command)                                                                  \
  command(info) command(calibrate) command(session_from_emva) command(model) command(synthesize) \
      command(renoise) command(simulate) command(pairs) command(dataset) command(train)          \
          command(denoise) command(stokes) command(bench) command(evaluate) command(experiment)  \
              command(report) command(normals) command(manual)
// Commands of optional modules, built where the module is.
#if defined(MALUS_WITH_CAPTURE)
#define MALUS_OPTIONAL_COMMANDS(command) command(capture)
#else
#define MALUS_OPTIONAL_COMMANDS(command)
#endif

#define MALUS_DECLARE(name) void add_##name(CLI::App& app, Common& common);
MALUS_COMMANDS(MALUS_DECLARE)
MALUS_OPTIONAL_COMMANDS(MALUS_DECLARE)
#undef MALUS_DECLARE

}  // namespace malus::app
