// What makes libtorch and OpenBLAS fast on this processor and can only be said in the environment,
// because they read it while they are loaded.
#pragma once

#include <string>
#include <vector>

namespace malus::app {

struct EnvironmentSetting {
  std::string name, value;
};

/// The settings for this processor, without those that the user has made already.
std::vector<EnvironmentSetting> missing_network_environment();

/// Starts this program anew, with the same arguments and these settings; returns only when that
/// cannot be done.
void restart_with(const std::vector<EnvironmentSetting>& settings);

/// Whether the products of matrices of an opened library come from the reference BLAS, which Debian
/// installs where nobody asks for another.
bool has_reference_blas(void* library);

/// glibc keeps freed blocks instead of giving them back to the kernel after every layer.
void keep_freed_memory();

}  // namespace malus::app
