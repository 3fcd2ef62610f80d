// What makes libtorch and OpenBLAS fast on this processor and can only be said in the environment,
// because they read it while they are loaded.
#pragma once

#include <string>
#include <vector>

namespace malus::app {

struct EnvironmentSetting {
  std::string name, value;
};

struct NetworkEnvironment {
  /// For this processor, without those that the user has made already.
  std::vector<EnvironmentSetting> settings;
  /// Where the BLAS lies that shares libtorch's threads, to come first in LD_LIBRARY_PATH; empty
  /// where there is none.
  std::string blas_folder;
};

NetworkEnvironment network_environment();

/// Whether the products of matrices of an opened library come from the reference BLAS, which Debian
/// installs where nobody asks for another.
bool has_reference_blas(void* library);

}  // namespace malus::app
