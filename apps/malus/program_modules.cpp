// What the program does about the modules that it opens (apps/doors): where they lie, and that
// libtorch finds its environment set.
#include "malus/base/parallel.h"

#include "flags.h"
#include "freed_memory.h"
#include "module_file.h"
#include "network_environment.h"
#include "networks_door.h"
#include "program.h"
#include "program_start.h"
#include <unistd.h>

namespace malus::app {
namespace {

// Says that the settings have been made, so that a program started anew does not do it again.
constexpr const char* kDone = "MALUS_NETWORK_ENVIRONMENT";

// With the same arguments; comes back only when that cannot be done.
void restart_with(const NetworkEnvironment& environment) {
  for (const EnvironmentSetting& s : environment.settings)
    setenv(s.name.c_str(), s.value.c_str(), 1);
  if (!environment.blas_folder.empty()) {
    const char* before = std::getenv("LD_LIBRARY_PATH");
    const std::string folders =
        before ? environment.blas_folder + ":" + before : environment.blas_folder;
    setenv("LD_LIBRARY_PATH", folders.c_str(), 1);
  }
  setenv(kDone, "1", 1);
  std::vector<std::string> arguments = program_start().arguments;
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  execv(program_start().file.c_str(), argv.data());
}

const NetworkFunctions* open_for_program() {
  const std::filesystem::path path = networks_file();
  if (std::getenv(kDone) == nullptr) restart_with(network_environment());
  keep_freed_memory();
  const OpenedNetworks opened = open_networks(path);
  opened.functions->use_threads(thread_count());
  if (!opened.complaint.empty()) warn(opened.complaint);
  return opened.functions;
}

}  // namespace

const ModuleOpener& module_opener() {
  // Beside the program in the build folder; in lib/malus beside bin/ when installed.
  static const std::filesystem::path folder = program_start().file.parent_path();
  static const ModuleOpener program{
      "the program", {folder, folder / ".." / MALUS_LIBRARY_FOLDER / "malus"}, kFlagWording};
  return program;
}

// Called before any work is done, since this may start the program anew: OpenMP has read its
// settings by now.
const NetworkFunctions& networks() {
  static const NetworkFunctions* const functions = open_for_program();
  return *functions;
}

}  // namespace malus::app
