// Tar shards: the system's tar reads them, equal content gives equal bytes, nothing half-written.
#include "malus/io/shard.h"

#include "malus/base/error.h"

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

std::string content_of(const std::filesystem::path& path) {
  std::stringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

void write_shard(const std::filesystem::path& path) {
  TarShard tar(path, false);
  tar.add("000000001.json", "{\"ratio\":10}");
  tar.add("000000001.clean.npy", std::string(1000, 'x'));
  tar.add("empty.txt", "");
  tar.commit();
}

TEST(TarShard, IsReadByTar) {
  const testing::TemporaryFolder folder;
  write_shard(folder / "a.tar");
  const std::string command = "cd '" + folder.path().string() + "' && tar -xf a.tar";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(content_of(folder / "000000001.json"), "{\"ratio\":10}");
  EXPECT_EQ(content_of(folder / "000000001.clean.npy"), std::string(1000, 'x'));
  EXPECT_TRUE(std::filesystem::exists(folder / "empty.txt"));
}

TEST(TarShard, BytesDependOnContentAlone) {
  const testing::TemporaryFolder folder;
  write_shard(folder / "a.tar");
  write_shard(folder / "b.tar");
  EXPECT_EQ(content_of(folder / "a.tar"), content_of(folder / "b.tar"));
  EXPECT_EQ(content_of(folder / "a.tar").size() % 512, 0u);
}

TEST(TarShard, WithoutCommitNothingRemains) {
  const testing::TemporaryFolder folder;
  {
    TarShard tar(folder / "a.tar", false);
    tar.add("x", "y");
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(TarShard, ExistingShardsNeedForce) {
  const testing::TemporaryFolder folder;
  write_shard(folder / "a.tar");
  EXPECT_THROW(TarShard(folder / "a.tar", false), InputError);
  EXPECT_NO_THROW(TarShard(folder / "a.tar", true));
}

}  // namespace
}  // namespace malus
