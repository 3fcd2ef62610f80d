#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/frame_stack.h"
#include "malus/io/picture_file.h"
#include "malus/io/session.h"

#include "problem_of.h"
#include "support.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

void write_cube(const fs::path& path, int frames, float first) {
  Planes planes(frames, 4, 6);
  for (int k = 0; k < frames; ++k) planes[k] = Image(4, 6, first + static_cast<float>(k));
  save_picture(path, planes, {}, {.type = SampleType::kUint16});
}

Session session_of_paths(const testing::TemporaryFolder& folder,
                         const std::vector<std::string>& paths) {
  return parse_session(
      fmt::format("[[frames]]\nkind = \"bias\"\npaths = [\"{}\"]\n", fmt::join(paths, "\", \"")),
      "s.toml", folder.path());
}

// The frames' names, relative to the folder.
std::vector<std::string> names_of(const testing::TemporaryFolder& folder,
                                  const std::vector<std::string>& paths) {
  std::vector<std::string> names;
  const Session session = session_of_paths(folder, paths);
  for (const fs::path& path : session.groups[0].paths)
    names.push_back(path.lexically_relative(folder.path()).string());
  return names;
}

TEST(SessionStacks, AStackCountsAsItsFramesInOrder) {
  const testing::TemporaryFolder folder;
  write_cube(folder / "s10.npy", 2, 100);
  write_cube(folder / "s9.fits", 3, 200);
  write_cube(folder / "t.npy", 1, 300);
  save_picture(folder / "s9.png", Image(4, 6, 7.0f), {.type = SampleType::kUint16});
  EXPECT_THAT(names_of(folder, {"t.npy", "s*"}),
              ElementsAre("t.npy", "s9.fits[0]", "s9.fits[1]", "s9.fits[2]", "s9.png", "s10.npy[0]",
                          "s10.npy[1]"));
  EXPECT_THAT(names_of(folder, {"s9.fits[2]", "s9.fits[0]", "t.npy[0]"}),
              ElementsAre("s9.fits[2]", "s9.fits[0]", "t.npy[0]"));
  const Session session = session_of_paths(folder, {"s9.fits"});
  const auto& group = session.groups[0];
  EXPECT_EQ(load_session_frame(session, group, group.paths[2]).dn(3, 5), 202);
  save_session(folder / "saved.toml", session, false);
  EXPECT_EQ(load_session(folder / "saved.toml").groups[0].paths, group.paths);
}

TEST(SessionStacks, AFrameOfAStackGoesBeforeAPatternAndAFileBeforeBoth) {
  const testing::TemporaryFolder folder;
  save_picture(folder / "x.png", Image(4, 6, 7.0f), {.type = SampleType::kUint16});
  fs::rename(folder / "x.png", folder / "s.npy1");
  EXPECT_THAT(names_of(folder, {"s.npy[1]"}), ElementsAre("s.npy1"));
  write_cube(folder / "s.npy", 3, 0);
  EXPECT_THAT(names_of(folder, {"s.npy[1]"}), ElementsAre("s.npy[1]"));
  EXPECT_THAT(names_of(folder, {"s.npy[1-2]"}), ElementsAre("s.npy1"));
  EXPECT_THAT(names_of(folder, {"s.n?y[1]"}), ElementsAre("s.npy1"));
  fs::rename(folder / "s.npy1", folder / "s.npy[1]");
  const Session session = session_of_paths(folder, {"s.npy[1]"});
  EXPECT_EQ(load_session_frame(session, session.groups[0], session.groups[0].paths[0]).dn(0, 0), 7);
}

TEST(SessionStacks, AFrameIsNamedOnce) {
  const testing::TemporaryFolder folder;
  write_cube(folder / "s.npy", 3, 0);
  write_cube(folder / "one.npy", 1, 0);
  fs::create_symlink("s.npy", folder / "link.npy");
  const auto refusal = [&](const std::vector<std::string>& paths) {
    return testing::problem_of([&] { session_of_paths(folder, paths); });
  };
  EXPECT_THAT(refusal({"s.npy", "s.npy[1]"}), HasSubstr("s.npy[1] twice"));
  EXPECT_THAT(refusal({"s.npy[1]", "s.npy[001]"}), HasSubstr("s.npy[001], the same file as"));
  EXPECT_THAT(refusal({"link.npy[2]", "s.npy"}), HasSubstr("s.npy[2], the same file as"));
  EXPECT_THAT(refusal({"one.npy[0]", "one.npy"}), HasSubstr("one.npy, the same file as"));
  EXPECT_THAT(refusal({"s.npy[3]"}), HasSubstr("the file holds 3 frames"));
  EXPECT_EQ(refusal({"s.npy[0]", "link.npy[1]"}), "");
}

TEST(SessionStacks, ErrorsNameTheFrame) {
  const testing::TemporaryFolder folder;
  write_cube(folder / "s.npy", 3, 0);
  Session session = session_of_paths(folder, {"s.npy"});
  session.sensor.rows = 5;
  session.sensor.cols = 6;
  try {
    load_session_frame(session, session.groups[0], session.groups[0].paths[1]);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(error.subject(), (folder / "s.npy[1]").string());
  }
}

}  // namespace
}  // namespace malus
