#include "network_environment.h"

#include <cstdlib>
#include <filesystem>
#include <thread>

#include "program_start.h"
#include <dlfcn.h>
#include <malloc.h>
#include <unistd.h>

namespace malus::app {
namespace {

// Says that the settings have been made, so that a program started anew does not do it again.
constexpr const char* kDone = "MALUS_NETWORK_ENVIRONMENT";

bool has_avx512() {
#if defined(__x86_64__)
  return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
         __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
#else
  return false;
#endif
}

// Debian's OpenBLAS in the build that shares OpenMP's threads with libtorch; the usual one has
// threads of its own, which spin beside them.
std::string openmp_blas_folder() {
#if defined(__x86_64__)
  const std::string folder = "/usr/lib/x86_64-linux-gnu/openblas-openmp";
#else
  const std::string folder = "/usr/lib/aarch64-linux-gnu/openblas-openmp";
#endif
  return std::filesystem::exists(folder + "/libblas.so.3") ? folder : "";
}

// Other programs leave the processor's threads no time to idle.
bool machine_is_busy() {
  double load = 0;  // of the last minute
  return getloadavg(&load, 1) == 1 &&
         load > static_cast<double>(std::thread::hardware_concurrency());
}

}  // namespace

std::vector<EnvironmentSetting> missing_network_environment() {
  std::vector<EnvironmentSetting> missing;
  if (std::getenv(kDone) != nullptr) return missing;
  const auto want = [&](const char* name, const std::string& value) {
    if (!value.empty() && std::getenv(name) == nullptr) missing.push_back({name, value});
  };
  if (has_avx512()) {
    // OpenBLAS 0.3.21 knows no recent AMD processor and takes kernels for 256 bits; ATen stays with
    // AVX2 by itself.
    want("OPENBLAS_CORETYPE", "SkylakeX");
    want("ATEN_CPU_CAPABILITY", "avx512");
  }
  // GCC's OpenMP lets a thread that waits spin for milliseconds. On a busy machine it spins through
  // the time that the thread it waits for would need: training was four to ten times slower.
  if (machine_is_busy() && std::getenv("OMP_WAIT_POLICY") == nullptr)
    want("GOMP_SPINCOUNT", "1000");
  // libtorch writes a line for every try to meet other workers; what fails is also thrown.
  want("GLOG_minloglevel", "3");
  if (const std::string folder = openmp_blas_folder(); !folder.empty()) {
    const char* before = std::getenv("LD_LIBRARY_PATH");
    missing.push_back({"LD_LIBRARY_PATH", before ? folder + ":" + before : folder});
  } else {
    want("OPENBLAS_NUM_THREADS", "1");
  }
  missing.push_back({kDone, "1"});
  return missing;
}

void restart_with(const std::vector<EnvironmentSetting>& settings) {
  std::vector<std::string> arguments = program_start().arguments;
  for (const EnvironmentSetting& s : settings) setenv(s.name.c_str(), s.value.c_str(), 1);
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  execv(program_start().file.c_str(), argv.data());
}

bool has_reference_blas(void* library) {
  const void* const product = dlsym(library, "sgemm_");
  Dl_info where{};
  if (product == nullptr || dladdr(product, &where) == 0) return false;
  // OpenBLAS and BLIS come under the same name, and say who they are.
  const bool is_other =
      dlsym(library, "openblas_get_config") || dlsym(library, "bli_info_get_version_str");
  const std::string file = std::filesystem::path(where.dli_fname).filename();
  return file.starts_with("libblas.so") && !is_other;
}

void keep_freed_memory() {
  mallopt(M_MMAP_MAX, 0);
  mallopt(M_TRIM_THRESHOLD, -1);
  mallopt(M_TOP_PAD, 256 << 20);
}

}  // namespace malus::app
