// Shared by all tests: where data lie and how to skip without them.
#pragma once

#include <filesystem>
#include <random>
#include <string>

#include <gtest/gtest.h>

namespace malus::testing {

/// The reference data beside the project, or the folder in MALUS_SHARED_DATA; absent on a user's
/// machine.
inline std::filesystem::path shared_data() {
  if (const char* folder = std::getenv("MALUS_SHARED_DATA")) return folder;
  return std::filesystem::path(MALUS_SOURCE_DIR) / ".." / "shared" / "data";
}

#define MALUS_NEEDS_SHARED(relative)                                        \
  if (!std::filesystem::exists(::malus::testing::shared_data() / relative)) \
  GTEST_SKIP() << "needs ../shared/data/" << relative

/// A fresh folder that goes away with the object.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::random_device entropy;
    path_ = std::filesystem::temp_directory_path() /
            ("malus-test-" + std::to_string(entropy()) + std::to_string(entropy()));
    std::filesystem::create_directories(path_);
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace malus::testing
