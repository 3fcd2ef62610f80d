#include "modules.h"

#include "malus/base/error.h"
#include "malus/base/fork.h"

#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <vector>

#include "module_file.h"
#include "network_environment.h"
#include "networks_door.h"
#include "wording.h"
#include <dlfcn.h>
#include <fmt/format.h>
#include <link.h>

namespace malus::python {
namespace {

namespace fs = std::filesystem;

std::atomic<bool> g_networks_opened = false;  // and nobody was told yet

fs::path own_folder() {
  Dl_info where{};
  if (dladdr(reinterpret_cast<const void*>(&remember_modules), &where) == 0) return {};
  return fs::weakly_canonical(fs::absolute(where.dli_fname)).parent_path();
}

// A build without networks asks for no libtorch.
#if !defined(MALUS_LIBTORCH)
#define MALUS_LIBTORCH ""
#endif

// The libtorch that another package of this process has loaded, where it is not the networks' own.
// The loader takes it for theirs, by its name, and functions that differ would end the process.
fs::path other_libtorch() {
  std::vector<fs::path> loaded;
  dl_iterate_phdr(
      [](dl_phdr_info* library, std::size_t, void* list) {
        const fs::path file(library->dlpi_name);
        if (file.filename().string().starts_with("libtorch_cpu.so"))
          static_cast<std::vector<fs::path>*>(list)->push_back(file);
        return 0;
      },
      &loaded);
  std::error_code unknown;
  for (const fs::path& file : loaded)
    if (!fs::equivalent(file, MALUS_LIBTORCH, unknown)) return file;
  return {};
}

// What libtorch and OpenBLAS read while they are loaded. A process cannot be started anew here, so
// that a BLAS that NumPy has loaded already stays as it is.
void prepare_for_libtorch() {
  const app::NetworkEnvironment environment = app::network_environment();
  for (const app::EnvironmentSetting& s : environment.settings)
    setenv(s.name.c_str(), s.value.c_str(), 0);
  constexpr const char* kBlas = "libblas.so.3";
  if (environment.blas_folder.empty() || dlopen(kBlas, RTLD_NOW | RTLD_NOLOAD) != nullptr) return;
  // Loaded first, it is the one that libtorch gets. If it cannot be, libtorch gets the usual one.
  dlopen((environment.blas_folder + "/" + kBlas).c_str(), RTLD_NOW | RTLD_LOCAL);
}

app::OpenedNetworks open_for_python() {
  const fs::path path = app::networks_file();
  if (const fs::path other = other_libtorch(); !other.empty())
    throw InputError("networks",
                     fmt::format("this process has loaded {}, and malus's networks need {}",
                                 other.string(), MALUS_LIBTORCH),
                     "denoise in a process that imports no other torch, or by `malus denoise`");
  prepare_for_libtorch();
  app::OpenedNetworks opened = app::open_networks(path);
  g_networks_opened = true;
  return opened;
}

const app::OpenedNetworks& opened_networks() {
  static const app::OpenedNetworks opened = open_for_python();
  return opened;
}

}  // namespace

void remember_modules() { app::module_opener(); }

std::string take_networks_complaint() {
  return g_networks_opened.exchange(false) ? opened_networks().complaint : "";
}

}  // namespace malus::python

namespace malus::app {

const ModuleOpener& module_opener() {
  // In the package itself; in the build folder; in lib/malus of the prefix that it is installed in.
  static const std::filesystem::path folder = python::own_folder();
  static const ModuleOpener package{
      "the Python module",
      {folder, folder / ".." / "..", folder / MALUS_PYTHON_TO_LIBRARIES / "malus"},
      python::kKeywordWording};
  return package;
}

const NetworkFunctions& networks() {
  const NetworkFunctions& functions = *python::opened_networks().functions;
  functions.share(python::kKeywordWording, works_alone());
  return functions;
}

}  // namespace malus::app
