#include "network_environment.h"

#include <cstdlib>
#include <filesystem>
#include <thread>

#include <dlfcn.h>

namespace malus::app {
namespace {

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

NetworkEnvironment network_environment() {
  NetworkEnvironment environment;
  const auto want = [&](const char* name, const std::string& value) {
    if (std::getenv(name) == nullptr) environment.settings.push_back({name, value});
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
  environment.blas_folder = openmp_blas_folder();
  if (environment.blas_folder.empty()) want("OPENBLAS_NUM_THREADS", "1");
  return environment;
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

}  // namespace malus::app
