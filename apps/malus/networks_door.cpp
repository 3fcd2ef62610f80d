#include "networks_door.h"

#include "module_file.h"
#include "network_environment.h"
#include "program.h"
#include <malus_modules_interface.h>

namespace malus::app {
namespace {

constexpr const char* kNetworksModule = "malus_networks.so";

const NetworkFunctions* open_networks() {
  const std::filesystem::path path = module_file(kNetworksModule);
  if (path.empty())
    throw InputError("networks", "this program was built without them",
                     "install libtorch-dev and build again");
  if (const auto missing = missing_network_environment(); !missing.empty()) restart_with(missing);
  keep_freed_memory();
  const OpenModule module =
      open_module(path, kNetworkFunctionsEntry, "install libtorch-dev and build again");
  const auto entry = reinterpret_cast<NetworkFunctionsEntry>(module.entry);
  const NetworkFunctions* functions = entry ? entry() : nullptr;
  if (functions == nullptr || functions->interface != kModulesInterface) throw other_version(path);
  if (has_reference_blas(module.handle))
    warn(
        "networks: products of matrices are taken from the reference BLAS, training is up to five "
        "times slower; install libopenblas0-openmp");
  return functions;
}

}  // namespace

bool have_networks() { return !module_file(kNetworksModule).empty(); }

const NetworkFunctions& networks() {
  static const NetworkFunctions* const functions = open_networks();
  return *functions;
}

}  // namespace malus::app
