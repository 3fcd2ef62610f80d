#include "malus/io/emva_description.h"

#include "malus/base/error.h"

#include <fstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr const char* kGoodDescription =
    "# comment\r\nv 3.0\r\nn 12 640 480\r\nb 40000.0 120.0\r\ni images\\b 1.png\r\n"
    "i images\\b2.png\r\nd 40000.0\r\ni images\\d1.png\r\nb 80000 240\r\ni images\\c1.png\r\n";

EmvaSession emva_session_of(const std::string& text) {
  return parse_emva_description(text, "D.txt", "top", false);
}

TEST(EmvaDescription, SetsBecomeGroups) {
  const Session session = emva_session_of(kGoodDescription).session;
  EXPECT_EQ(session.sensor.white_dn, 4095);
  EXPECT_EQ(session.sensor.rows, 480);
  EXPECT_EQ(session.sensor.cols, 640);
  ASSERT_EQ(session.groups.size(), 3u);
  EXPECT_EQ(session.groups[0].kind, FrameKind::kFlat);
  EXPECT_DOUBLE_EQ(session.groups[0].exposure_s.value(), 40e-6);
  EXPECT_THAT(session.groups[0].paths, ElementsAre("top/images/b 1.png", "top/images/b2.png"));
  EXPECT_EQ(session.groups[0].level, 1);
  EXPECT_EQ(session.groups[1].kind, FrameKind::kBias);
  EXPECT_FALSE(session.groups[1].level.has_value());
  EXPECT_EQ(session.groups[2].level, 2);
}

// As Windows' editors begin a text.
TEST(EmvaDescription, AByteOrderMarkIsPassedOver) {
  EXPECT_EQ(emva_session_of("\xef\xbb\xbf" + std::string(kGoodDescription)).session.groups.size(),
            3u);
}

TEST(EmvaDescription, DefectsNameTheirLine) {
  const auto refused = [](const std::string& text, const std::string& what) {
    EXPECT_THAT([&] { emva_session_of(text); }, ThrowsMessage<InputError>(HasSubstr(what))) << text;
  };
  refused("v 3.0\nn 12 640\n", "D.txt:2: the entry has not the form \"n bits width height\"");
  refused("v 9.0\n", "version 9");
  refused("n 12 640 480\nq 3\n", "D.txt:2: unknown entry \"q\"");
  refused("n 12 640 480\ni x.png\n", "an image before the first b or d");
  refused("n 12 640 480\nb 40 x\n", "D.txt:2");
  refused("n 12 640 480\nb 0 1\n", "an exposure is positive");
  refused("n 12 640 480\nb -5 1\n", "an exposure is positive");
  refused("n 12 640 480\nb nan 1\n", "\"nan\"");
  refused("n 40 640 480\n", "out of range");
  refused("n 12.9 640 480\n", "not a whole number");
  refused("n 12 640.5 480\n", "not a whole number");
  refused("n 12 640 480\nb 1000 foo\n", "\"foo\"");
  refused("n 12 640 480\nd 5\ni \n", "without a name");
  refused("d 5\ni x.png\n", "no \"n bits width height\" line");
  refused("n 12 640 480\nd 5\n", "none of its images exists");
  refused("", "no \"n bits width height\" line");
}

TEST(EmvaDescription, AbsentImagesAreCountedAndTheFirstIsNamed) {
  const testing::TemporaryFolder folder;
  for (const char* name : {"b.png", "d.png"}) std::ofstream(folder / name) << 'x';
  const auto notes = [&](const std::string& sets) {
    return parse_emva_description("n 12 640 480\nb 40 1\ni b.png\n" + sets, "D.txt", folder.path())
        .notes;
  };
  EXPECT_THAT(notes("d 40\ni d.png\n"), ElementsAre());
  EXPECT_THAT(notes("i c.png\nd 40\ni d.png\n"),
              ElementsAre("D.txt: 1 of the 3 images that it names is absent and left out: c.png "
                          "(line 4)"));
  EXPECT_THAT(notes("d 40\ni d.png\nb 50 1\ni e.png\ni f.png\n"),
              ElementsAre("D.txt: 2 of the 4 images that it names are absent and left out, the "
                          "first of them e.png (line 7); 1 set has none left and is left out too"));
}

TEST(EmvaDescription, WithoutItsDarkImagesNoSessionIsMade) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "b.png") << 'x';
  EXPECT_THAT(
      [&] {
        parse_emva_description("n 12 640 480\nb 40 1\ni b.png\nd 40\ni d.png\n", "D.txt",
                               folder.path());
      },
      ThrowsMessage<InputError>(HasSubstr("D.txt: the images of its dark sets are all absent")));
}

TEST(EmvaDescription, AbsentImagesOfTheRealSetAreLeftOutWithANote) {
  MALUS_NEEDS_SHARED("emva001/EMVA1288_Data.txt");
  const testing::TemporaryFolder folder;
  const EmvaSession converted =
      load_emva_description(testing::shared_data() / "emva001" / "EMVA1288_Data.txt");
  // Every second of 50 levels is there, as pairs, and the repeated dark and bright sets.
  EXPECT_EQ(converted.missing_images, 140);
  ASSERT_EQ(converted.notes.size(), 1u);
  std::size_t frames = 0, repeats = 0;
  for (const FrameGroup& group : converted.session.groups) {
    frames += group.paths.size();
    if (group.kind == FrameKind::kBias && group.paths.size() == 50) ++repeats;
  }
  EXPECT_EQ(frames, 160u);
  EXPECT_EQ(repeats, 1u);
  save_session(folder / "s.toml", converted.session, false);
  EXPECT_EQ(load_session(folder / "s.toml").groups.size(), converted.session.groups.size());
}

}  // namespace
}  // namespace malus
