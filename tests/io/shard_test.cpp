// Tar shards: the system's tar reads them, equal content gives equal bytes, nothing half-written.
#include "malus/io/shard.h"

#include "malus/base/error.h"
#include "malus/io/shard_read.h"

#include <cstdlib>
#include <fstream>
#include <sstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

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

TEST(TarShard, IsReadWholeOrNotAtAll) {
  const testing::TemporaryFolder folder;
  write_shard(folder / "a.tar");
  const auto entries = shard_entries(folder / "a.tar");
  ASSERT_EQ(entries.size(), 3u);
  EXPECT_EQ(entries[0].name, "000000001.json");
  EXPECT_EQ(shard_content(folder / "a.tar", entries[0]), "{\"ratio\":10}");
  EXPECT_EQ(entries[1].size, 1000u);
  // Cut off in a content, in a header, between two files, and before the block of zeros alone.
  const std::string whole = content_of(folder / "a.tar");
  for (const std::size_t size : {std::size_t{0}, std::size_t{100}, std::size_t{600},
                                 std::size_t{1024}, std::size_t{1124}, whole.size() - 1024}) {
    std::ofstream(folder / "cut.tar", std::ios::binary) << whole.substr(0, size);
    EXPECT_THAT([&] { shard_entries(folder / "cut.tar"); },
                ThrowsMessage<InputError>(HasSubstr("is cut off")))
        << size;
  }
}

// Of pictures in general such an array would be rows, columns and four channels.
TEST(TarShard, SmallPatchesHaveTheirChannelsFirst) {
  Planes planes(16, 4, 4);
  planes[15](0, 3) = 7.0f;
  const Planes back = planes_of_npy(npy_bytes(planes), "a patch");
  ASSERT_EQ(back.channels(), 16);
  EXPECT_EQ(back[15](0, 3), 7.0f);
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
