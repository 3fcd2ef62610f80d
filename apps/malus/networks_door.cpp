#include "networks_door.h"

#include "malus/base/error.h"

#include "module_file.h"
#include "network_environment.h"
#include "program.h"
#include <dlfcn.h>
#include <fmt/format.h>
#include <malus_modules_interface.h>

namespace malus::app {
namespace {

constexpr const char* kNetworksModule = "malus_networks.so";

const NetworkFunctions* open_module() {
  const std::filesystem::path path = module_file(kNetworksModule);
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
  if (functions == nullptr || functions->interface != kModulesInterface)
    throw InputError(path.string(), "is of another version than the program", "build both again");
  if (has_reference_blas(module))
    warn(
        "networks: products of matrices are taken from the reference BLAS, training is up to five "
        "times slower; install libopenblas0-openmp");
  return functions;
}

}  // namespace

bool have_networks() { return !module_file(kNetworksModule).empty(); }

const NetworkFunctions& networks() {
  static const NetworkFunctions* const functions = open_module();
  return *functions;
}

}  // namespace malus::app
