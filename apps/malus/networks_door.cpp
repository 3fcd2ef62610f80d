#include "networks_door.h"

#include "malus/base/error.h"

#include "network_environment.h"
#include "program.h"
#include "program_start.h"
#include <dlfcn.h>
#include <fmt/format.h>
#include <malus_networks_interface.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

constexpr const char* kModuleName = "malus_networks.so";

// Beside the program in the build folder; in lib/malus beside bin/ when installed. Empty where it
// was not built.
fs::path module_path() {
  std::error_code error;
  const fs::path folder = program_start().file.parent_path();
  for (const fs::path& candidate :
       {folder / kModuleName, folder / ".." / MALUS_LIBRARY_FOLDER / "malus" / kModuleName})
    if (fs::exists(candidate, error)) return candidate;
  return {};
}

const NetworkFunctions* open_module() {
  const fs::path path = module_path();
  if (path.empty())
    throw InputError("networks", "this program was built without them",
                     "install libtorch-dev and build again");
  if (const auto missing = missing_network_environment(); !missing.empty()) restart_with(missing);
  keep_freed_memory();
  void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr)
    throw InputError(path.string(), fmt::format("cannot be loaded ({})", dlerror()),
                     "install libtorch-dev and build again");
  const auto entry = reinterpret_cast<NetworkFunctionsEntry>(dlsym(module, kNetworkFunctionsEntry));
  const NetworkFunctions* functions = entry ? entry() : nullptr;
  if (functions == nullptr || functions->interface != kNetworksInterface)
    throw InputError(path.string(), "is of another version than the program", "build both again");
  if (has_reference_blas(module))
    warn(
        "networks: products of matrices are taken from the reference BLAS, training is up to five "
        "times slower; install libopenblas0-openmp");
  return functions;
}

}  // namespace

bool have_networks() { return !module_path().empty(); }

const NetworkFunctions& networks() {
  static const NetworkFunctions* const functions = open_module();
  return *functions;
}

}  // namespace malus::app
