#include "commands.h"
#include "program_start.h"

int main(int argc, char** argv) {
  using namespace malus::app;
  remember_start(argc, argv);
  const auto app = make_program();
  Common common;
#define MALUS_ADD(name) add_##name(*app, common);
  MALUS_COMMANDS(MALUS_ADD)
#undef MALUS_ADD
  return run_program(*app, argc, argv);
}
