#include "malus/base/atomic_file.h"

#include "malus/base/error.h"

#include <fstream>
#include <iterator>

#include "support.h"

namespace malus {
namespace {

std::string content(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::ptrdiff_t files_in(const std::filesystem::path& folder) {
  return std::distance(std::filesystem::directory_iterator(folder), {});
}

TEST(AtomicFile, CommitReplacesTheOldContent) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "x.h5") << "old";
  AtomicFile file(folder / "x.h5", true);
  std::ofstream(file.temporary()) << "new";
  EXPECT_EQ(content(folder / "x.h5"), "old");
  file.commit();
  EXPECT_EQ(content(folder / "x.h5"), "new");
  EXPECT_EQ(files_in(folder.path()), 1);
}

TEST(AtomicFile, WithoutCommitNothingRemains) {
  const testing::TemporaryFolder folder;
  {
    AtomicFile file(folder / "x.tif", true);
    EXPECT_EQ(file.temporary().extension(), ".tif");
    EXPECT_EQ(file.temporary().parent_path(), folder.path());
    std::ofstream(file.temporary()) << "half";
  }
  EXPECT_EQ(files_in(folder.path()), 0);
}

TEST(AtomicFile, AnExistingFileNeedsForce) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "x") << "old";
  EXPECT_THROW(AtomicFile(folder / "x", false), InputError);
  EXPECT_EQ(content(folder / "x"), "old");
}

TEST(AtomicFile, TwoAtOnceDoNotMeet) {
  const testing::TemporaryFolder folder;
  AtomicFile first(folder / "x", false), second(folder / "x", false);
  EXPECT_NE(first.temporary(), second.temporary());
}

TEST(AtomicFile, RefusesAFolderAndAMissingParent) {
  const testing::TemporaryFolder folder;
  EXPECT_THROW(AtomicFile(folder.path(), true), InputError);
  EXPECT_THROW(AtomicFile(folder / "absent/x", true), InputError);
}

}  // namespace
}  // namespace malus
