#include "malus/base/unreadable_file.h"

#include <string>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(UnreadableFile, SaysWhichItIs) {
  const std::string missing = unreadable_file("/nowhere/weights.safetensors").what();
  EXPECT_EQ(missing, "/nowhere/weights.safetensors: does not exist; check the name and the folder");
  EXPECT_EQ(std::string(unreadable_file("/").what()),
            "/: is a folder, not a file; name the file or files in it");
  const std::string long_name(300, 'a');
  EXPECT_EQ(
      std::string(unreadable_file(long_name).what()),
      long_name +
          ": cannot be read: File name too long; check the name, the folder and its permissions");
  EXPECT_EQ(std::string(unreadable_file("/dev/null").what()),
            "/dev/null: cannot be read; check its permissions");
}

}  // namespace
}  // namespace malus
