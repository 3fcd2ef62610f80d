#include "commands.h"
#include "flags.h"
#include "program_start.h"

int main(int argc, char** argv) {
  using namespace malus::app;
  remember_start(argc, argv);
  keep_closed_streams_closed();
  report_full_files();
  malus::use_wording(kFlagWording);
  const auto app = make_program();
  Common common;
#define MALUS_ADD(name) add_##name(*app, common);
  MALUS_COMMANDS(MALUS_ADD)
#undef MALUS_ADD
  // After the commands, which would take it over.
  app->footer(
      "Help texts call two papers by number: 000 is \"Polarized Color Image Denoising\",\n"
      "001 \"Non-parametric Sensor Noise Modeling and Synthesis\".");
  return run_program(*app, argc, argv);
}
