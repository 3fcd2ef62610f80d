// Every command registers itself here; the order is the order of `malus --help`.
#pragma once

#include "program.h"

namespace malus::app {

// add_<command>(app, common) is defined in cmd_<command>.cpp. capture is built where its module is.
#if defined(MALUS_WITH_CAPTURE)
#define MALUS_CAPTURE_COMMAND(command) command(capture)
#else
#define MALUS_CAPTURE_COMMAND(command)
#endif
#define MALUS_COMMANDS(command)                                                              \
  command(info) MALUS_CAPTURE_COMMAND(command) command(calibrate) command(model)             \
      command(synthesize) command(renoise) command(simulate) command(pairs) command(dataset) \
          command(train) command(average) command(denoise) command(stokes) command(normals)  \
              command(evaluate) command(report) command(experiment) command(bench)           \
                  command(session_from_emva) command(manual)

#define MALUS_DECLARE(name) void add_##name(CLI::App& app, Common& common);
MALUS_COMMANDS(MALUS_DECLARE)
#undef MALUS_DECLARE

}  // namespace malus::app
