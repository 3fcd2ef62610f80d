#include "malus/io/internal/glob.h"

#include <algorithm>
#include <fstream>

#include "support.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus::internal {
namespace {

using malus::testing::TemporaryFolder;

TEST(NaturalOrder, DigitsCompareAsNumbers) {
  std::vector<std::string> names = {"f10",
                                    "f9",
                                    "f1b",
                                    "f1a",
                                    "f01",
                                    "f1",
                                    "f",
                                    "g0",
                                    "f100000000000000000000000",
                                    "f99999999999999999999999"};
  std::sort(names.begin(), names.end(), natural_less);
  EXPECT_THAT(
      names, ::testing::ElementsAre("f", "f01", "f1", "f1a", "f1b", "f9", "f10",
                                    "f99999999999999999999999", "f100000000000000000000000", "g0"));
}

TEST(NaturalOrder, IsAStrictOrder) {
  const std::vector<std::string> names = {"", "0", "00", "1", "01", "a", "a0", "a00b", "a0b", "a1"};
  for (const auto& a : names) {
    EXPECT_FALSE(natural_less(a, a));
    for (const auto& b : names) {
      EXPECT_EQ(a != b, natural_less(a, b) != natural_less(b, a)) << a << " " << b;
      for (const auto& c : names)
        EXPECT_TRUE(!natural_less(a, b) || !natural_less(b, c) || natural_less(a, c))
            << a << " " << b << " " << c;
    }
  }
}

std::vector<std::string> names_of(const std::vector<std::filesystem::path>& paths) {
  std::vector<std::string> names;
  for (const auto& path : paths) names.push_back(path.parent_path().filename() / path.filename());
  return names;
}

// A folder that exists by the very name is meant, whatever else the name would match.
TEST(Glob, FoldersThatExistAreTakenAsTheyAreNamed) {
  const TemporaryFolder folder;
  for (const char* name : {"dir [x]", "dir x", "run*1", "run 1", "a", "b"}) {
    std::filesystem::create_directories(folder / name);
    for (const char* file : {"1.png", "2.png"}) std::ofstream(folder / name / file) << "x";
  }
  const auto found = [&](const std::string& pattern) {
    return names_of(expand_glob(folder / "", pattern));
  };
  using ::testing::ElementsAre;
  EXPECT_THAT(found("dir [x]/*.png"), ElementsAre("dir [x]/1.png", "dir [x]/2.png"));
  EXPECT_THAT(found("run*1/[12].png"), ElementsAre("run*1/1.png", "run*1/2.png"));
  EXPECT_THAT(found("[ab]/1.*"), ElementsAre("a/1.png", "b/1.png"));
  EXPECT_THAT(found("dir ?/1.png"), ElementsAre("dir x/1.png"));
  EXPECT_THAT(names_of(expand_glob({}, (folder / "dir [x]/*.png").string())),
              ElementsAre("dir [x]/1.png", "dir [x]/2.png"));
}

}  // namespace
}  // namespace malus::internal
