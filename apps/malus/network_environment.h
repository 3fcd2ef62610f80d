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

/// glibc keeps freed blocks instead of giving them back to the kernel after every layer.
void keep_freed_memory();

}  // namespace malus::app
