#include "malus/base/atomic_file.h"

#include "malus/base/error.h"
#include "malus/base/unfinished_files.h"

#include <chrono>
#include <fstream>
#include <iterator>
#include <string>

#include "support.h"
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

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

TEST(AtomicFile, KeepsWhatCameUpMeanwhile) {
  const testing::TemporaryFolder folder;
  const auto path = folder / "late";
  AtomicFile file(path, false);
  std::ofstream(file.temporary()) << "own";
  write_file(path, "another's", false);
  EXPECT_THROW(file.commit(), InputError);
  EXPECT_EQ(content(path), "another's");
}

TEST(AtomicFile, ANameMustLeaveRoomForThatOfTheUnfinishedFile) {
  const testing::TemporaryFolder folder;
  write_file(folder / std::string(200, 'n'), "fits", false);
  try {
    check_output(folder / std::string(250, 'n'), false);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("too long: 250 bytes, at most 2"), std::string::npos)
        << error.what();
  }
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

// The name that a process gives which then ends.
std::filesystem::path name_of_the_dead(const std::filesystem::path& path) {
  int ends[2];
  EXPECT_EQ(::pipe(ends), 0);
  const pid_t child = ::fork();
  if (child == 0) {
    const std::string name = unfinished_name(path).string();
    ::_exit(::write(ends[1], name.data(), name.size()) == std::ssize(name) ? 0 : 1);
  }
  int status = 1;
  EXPECT_EQ(::waitpid(child, &status, 0), child);
  EXPECT_EQ(status, 0);
  std::string name(4096, ' ');
  name.resize(static_cast<std::size_t>(::read(ends[0], name.data(), name.size())));
  ::close(ends[0]);
  ::close(ends[1]);
  return name;
}

TEST(AtomicFile, TakesAwayWhatAKilledRunLeftOfTheSameFile) {
  const testing::TemporaryFolder folder;
  const auto dead = name_of_the_dead(folder / "x.tif"), other = name_of_the_dead(folder / "y.tif"),
             alive = unfinished_name(folder / "x.tif"), elsewhere = folder / ".elsewhere-1-0-x.tif";
  for (const auto& path : {dead, other, alive, elsewhere}) std::ofstream(path) << "half";
  std::filesystem::last_write_time(
      elsewhere, std::filesystem::file_time_type::clock::now() - std::chrono::hours(25));
  { AtomicFile file(folder / "x.tif", false); }
  EXPECT_FALSE(std::filesystem::exists(dead));
  for (const auto& path : {other, alive, elsewhere}) EXPECT_TRUE(std::filesystem::exists(path));
  write_file(folder / "y.tif", "whole", false);
  EXPECT_FALSE(std::filesystem::exists(other));
  EXPECT_EQ(files_in(folder.path()), 3);
}

// /dev/stdout is such a link, which a file would have taken the place of.
TEST(AtomicFile, StreamsAreWrittenWhereTheyArePipes) {
  const testing::TemporaryFolder folder;
  const auto stream = folder / "stream", link = folder / "link";
  const auto lead_to = [&](int fd) {
    std::filesystem::remove(stream);
    std::filesystem::create_symlink("/proc/self/fd/" + std::to_string(fd), stream);
  };
  std::filesystem::create_symlink("stream", link);
  const auto target = folder / "target";
  write_file(target, "old", false);
  const int file = ::open(target.c_str(), O_WRONLY);
  lead_to(file);
  for (const bool force : {false, true}) EXPECT_THROW(write_file(link, "new", force), InputError);
  ::close(file);
  EXPECT_THROW(write_file(link, "new", true), InputError);
  EXPECT_TRUE(std::filesystem::is_symlink(link) && std::filesystem::is_symlink(stream));
  EXPECT_EQ(content(target), "old");

  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  lead_to(ends[1]);
  write_file(link, "new", false);
  char read[4] = {};
  EXPECT_EQ(::read(ends[0], read, 3), 3);
  EXPECT_STREQ(read, "new");
  for (const int end : ends) ::close(end);
}

TEST(OutputFolder, GoesAgainWhereNothingWasWritten) {
  const testing::TemporaryFolder folder;
  { const OutputFolder made(folder / "a/b/c"); }
  EXPECT_EQ(files_in(folder.path()), 0);
  { const OutputFolder with_slash(folder / "a/b/"); }
  EXPECT_EQ(files_in(folder.path()), 0);
  std::filesystem::create_directory(folder / "mine");
  { const OutputFolder kept(folder / "mine"); }
  EXPECT_EQ(files_in(folder.path()), 1);
  {
    const OutputFolder used(folder / "a/b");
    std::ofstream(folder / "a/x") << "x";
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "a/x"));
  EXPECT_FALSE(std::filesystem::exists(folder / "a/b"));
}

TEST(UnfinishedFiles, OfTheDeadAreRemovedAndOfTheLivingKept) {
  const testing::TemporaryFolder folder;
  const auto wanted = [](std::string_view name) { return name.starts_with("shard-"); };
  const auto dead = name_of_the_dead(folder / "shard-1.tar"),
             other = name_of_the_dead(folder / "dataset.json"),
             alive = unfinished_name(folder / "shard-2.tar");
  EXPECT_EQ(dead.parent_path(), folder.path());
  for (const auto& path : {dead, other, alive, folder / "shard-3.tar", folder / ".shard-4.tar",
                           folder / ".00000000-x-0-shard-5.tar"})
    std::ofstream(path) << "half";
  EXPECT_EQ(remove_unfinished(folder.path(), wanted), 1);
  EXPECT_FALSE(std::filesystem::exists(dead));
  EXPECT_EQ(files_in(folder.path()), 5);
  EXPECT_EQ(remove_unfinished(folder.path() / "absent", wanted), 0);
}

TEST(UnfinishedFiles, OfAnotherMachineAreRemovedAfterADay) {
  const testing::TemporaryFolder folder;
  // Number 1 is alive here, which says nothing about another machine.
  const auto fresh = folder / ".elsewhere-1-0-a.tar", old = folder / ".elsewhere-1-0-b.tar";
  for (const auto& path : {fresh, old}) std::ofstream(path) << "half";
  std::filesystem::last_write_time(
      old, std::filesystem::file_time_type::clock::now() - std::chrono::hours(25));
  EXPECT_EQ(remove_unfinished(folder.path(), [](std::string_view) { return true; }), 1);
  EXPECT_TRUE(std::filesystem::exists(fresh));
}

}  // namespace
}  // namespace malus
