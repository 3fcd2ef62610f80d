#include "networks_door.h"

#include "module_file.h"
#include "network_environment.h"
#include <malus_modules_interface.h>

namespace malus::app {
namespace {

constexpr const char* kNetworksModule = "malus_networks.so";
constexpr const char* kAdvice = "install libtorch-dev and build again";

}  // namespace

bool have_networks() { return !module_file(kNetworksModule).empty(); }

std::filesystem::path networks_file() {
  std::filesystem::path path = module_file(kNetworksModule);
  if (path.empty())
    throw InputError("networks", module_opener().name + " was built without them", kAdvice);
  return path;
}

OpenedNetworks open_networks(const std::filesystem::path& path) {
  const OpenModule module = open_module(path, kNetworkFunctionsEntry, kAdvice);
  const auto entry = reinterpret_cast<NetworkFunctionsEntry>(module.entry);
  const NetworkFunctions* functions = entry ? entry() : nullptr;
  if (functions == nullptr || functions->interface != kModulesInterface) throw other_version(path);
  OpenedNetworks opened{functions, {}};
  if (has_reference_blas(module.handle))
    opened.complaint =
        "networks: products of matrices are taken from the reference BLAS, training is up to five "
        "times slower; install libopenblas0-openmp";
  return opened;
}

}  // namespace malus::app
