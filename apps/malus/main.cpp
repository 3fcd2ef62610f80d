#include "commands.h"
#include "program_start.h"

int main(int argc, char** argv) {
  using namespace malus::app;
  remember_start(argc, argv);
  CLI::App app{"Measure a camera's noise, imitate it and remove it", "malus"};
  app.set_version_flag("--version", MALUS_VERSION);
  app.require_subcommand(1);
  Common common;
#define MALUS_ADD(name) add_##name(app, common);
  MALUS_COMMANDS(MALUS_ADD)
  MALUS_OPTIONAL_COMMANDS(MALUS_ADD)
#undef MALUS_ADD
  return run_program(app, argc, argv);
}
