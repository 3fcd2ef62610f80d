#include "malus/io/session.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/emva_description.h"
#include "malus/io/picture_file.h"

#include <filesystem>

#include "problem_of.h"
#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr const char* kGood = R"([sensor]
name = "FLIR BFS-U3-51S5PC"
layout = "polar-bayer-rggb"
black = 82.0
white = 4095
row_group = 2

[[frames]]
kind = "bias"
gain_db = 24.0
exposure_s = 0.01
paths = ["bias/g24/*.tif"]

[[frames]]
kind = "flat"
iso = 1600
exposure_s = 0.5
level = 3
paths = "flat/x.tif"
)";

Session parse(const std::string& text) { return parse_session(text, "s.toml", "", false); }

void expect_refused(const std::string& text, const std::string& a, const std::string& b = "") {
  EXPECT_THAT([&] { parse(text); }, ThrowsMessage<InputError>(AllOf(HasSubstr(a), HasSubstr(b))))
      << text;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const auto at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

TEST(Session, TheContractsExampleIsRead) {
  const Session session = parse(kGood);
  EXPECT_EQ(session.sensor.name, "FLIR BFS-U3-51S5PC");
  EXPECT_EQ(session.sensor.layout->name(), "polar-bayer-rggb");
  EXPECT_THAT(session.sensor.black_dn, ElementsAre(82.0));
  EXPECT_EQ(session.sensor.white_dn, 4095);
  EXPECT_EQ(session.sensor.row_group, 2);
  ASSERT_EQ(session.groups.size(), 2u);
  EXPECT_EQ(session.groups[0].kind, FrameKind::kBias);
  EXPECT_EQ(session.groups[0].gain.gain_db, 24.0);
  EXPECT_EQ(session.groups[1].gain.iso, 1600.0);
  EXPECT_EQ(session.groups[1].level, 3);
  EXPECT_THAT(session.groups[1].paths, ElementsAre("flat/x.tif"));
  const FrameOptions options = frame_options(session, session.groups[1]);
  EXPECT_EQ(options.gain.iso, 1600.0);
  EXPECT_EQ(options.exposure_s, 0.5);
  EXPECT_EQ(options.white_dn, 4095);
}

TEST(Session, CustomCellsAndBlackPerChannel) {
  const Session session = parse(R"(
    [sensor]
    black = [1, 2.5, 3, 4]
    [sensor.cell]
    rows = [["0", "45"], ["135", "90"]]
    [[frames]]
    kind = "bias"
    paths = ["a"]
  )");
  EXPECT_EQ(session.sensor.layout->channel_name(0), "0");
  EXPECT_THAT(session.sensor.black_dn, ElementsAre(1, 2.5, 3, 4));
}

TEST(Session, UnknownKeysNameTheNearest) {
  expect_refused(replaced(kGood, "gain_db", "gain_bd"), "s.toml:10", "did you mean \"gain_db\"?");
  expect_refused(replaced(kGood, "white", "whit"), "unknown key \"whit\" in [sensor]", "\"white\"");
  expect_refused(replaced(kGood, "[sensor]", "[senser]"), "unknown key \"senser\"", "\"sensor\"");
  expect_refused(replaced(kGood, "\"bias\"", "\"biass\""), "kind", "did you mean \"bias\"?");
  expect_refused(replaced(kGood, "bayer-rggb", "bayer-rgbg"), "s.toml:3", "polar-bayer-rggb");
}

TEST(Session, WrongValuesAreRefusedWithTheirPlace) {
  expect_refused(replaced(kGood, "82.0", "4095"), "s.toml:4",
                 "black in [sensor] is 4095 DN, not below white = 4095 DN");
  expect_refused(replaced(kGood, "82.0", "[1, 2]"), "2 values for the 16 channels");
  expect_refused(replaced(kGood, "82.0", "[]"), "empty list");
  expect_refused(replaced(kGood, "82.0", "nan"), "black in [sensor] is not a number");
  expect_refused(replaced(kGood, "82.0", "\"82\""), "is not a number");
  expect_refused(replaced(kGood, "4095", "-1"), "white");
  expect_refused(replaced(kGood, "4095", "inf"), "white in [sensor] is not a number");
  expect_refused(replaced(kGood, "row_group = 2", "row_group = 0"), "whole number from 1 to 64");
  expect_refused(replaced(kGood, "row_group = 2", "row_group = 1.5"), "whole number");
  expect_refused(replaced(kGood, "row_group = 2", "raw_format = \"mono12p\""), "without a size");
  expect_refused(replaced(kGood, "row_group = 2", "size = \"12\""), "size", "2448x2048");
  expect_refused(replaced(kGood, "row_group = 2", "cell = 3"), "stands beside a layout");
  expect_refused(replaced(kGood, "exposure_s = 0.5", "exposure_s = 0"), "exposure");
  expect_refused(replaced(kGood, "exposure_s = 0.01", "exposure_s = -1"), "exposure");
  expect_refused(replaced(kGood, "iso = 1600", "iso = 0"), "ISO is positive");
  expect_refused(replaced(kGood, "iso = 1600", "gain_db = 240"), "gain_db", "240 dB");
  expect_refused(replaced(replaced(kGood, "82.0", "-82.0"), "row_group = 2",
                          "raw_format = \"mono12p\"\nsize = \"8x8\""),
                 "black in [sensor] is -82 DN");
  expect_refused(replaced(kGood, "iso = 1600", "iso = 100\ngain_db = 3"), "stands beside gain_db");
  expect_refused(replaced(kGood, "level = 3", "level = -3"), "level");
  expect_refused(replaced(kGood, "kind = \"bias\"", ""), "kind", "is missing");
  expect_refused(replaced(kGood, "paths = \"flat/x.tif\"", ""), "paths", "is missing");
  expect_refused(replaced(kGood, "paths = \"flat/x.tif\"", "paths = [1]"), "paths");
  expect_refused(replaced(kGood, "paths = \"flat/x.tif\"", "paths = [\"a\", \"./a\"]"), "twice");
  expect_refused(replaced(kGood, "paths = \"flat/x.tif\"", "paths = []"), "paths");
  expect_refused("[sensor]\n", "frames", "is missing");
  expect_refused("frames = 3", "frames", "is not a list");
  expect_refused("frames = [3]", "is not a list of tables");
  expect_refused("sensor = 3\n[[frames]]\n", "sensor", "is not a table");
  expect_refused("[sensor.cell]\nrows = [[\"R99\"]]\n[[frames]]\n",
                 "rows in [sensor.cell] has an unknown site \"R99\"");
  expect_refused("[sensor.cell]\nrows = [[\"R90\", \"R45\"], [\"R135\"]]\n[[frames]]\n",
                 "rows in [sensor.cell] has rows of 2 and 1 sites");
  expect_refused("[sensor]\nname = \"x\n", "s.toml:2");
  expect_refused("\xff\xfe", "s.toml");
}

TEST(Session, AFileIsPartOfOneMeasurement) {
  const testing::TemporaryFolder folder;
  const auto session = [&](const std::string& a, const std::string& b) {
    std::string text;
    for (const std::string& kind : {a, b})
      text += "[[frames]]\nkind = \"" + kind + "\"\nlevel = " + (text.empty() ? "1" : "2") +
              "\npaths = [\"a.tif\"]\n";
    return text;
  };
  for (const auto& [a, b] :
       {std::pair("bias", "bias"), {"flat", "flat"}, {"bias", "flat"}, {"burst", "reference"}})
    expect_refused(session(a, b), "s.toml:8", std::string("a.tif, of ") + a + " frames already");
  for (const auto& [a, b] :
       {std::pair("reference", "reference"), {"burst", "short"}, {"reference", "short"}})
    EXPECT_EQ(parse(session(a, b)).groups.size(), 2u) << a << b;
  write_file(folder / "a.tif", std::string("x"), false);
  std::filesystem::create_symlink("a.tif", folder / "b.tif");
  EXPECT_THAT(
      [&] {
        parse_session("[[frames]]\nkind = \"bias\"\npaths = \"*.tif\"\n", "s.toml", folder.path());
      },
      ThrowsMessage<InputError>(AllOf(HasSubstr("b.tif, the same file as"), HasSubstr("a.tif"))));
}

TEST(Session, AnExposureOfZeroIsFineForBias) {
  EXPECT_EQ(parse(replaced(kGood, "exposure_s = 0.01", "exposure_s = 0")).groups[0].exposure_s,
            0.0);
}

TEST(Session, PatternsAreRelativeToTheFileAndCountedLikePeopleDo) {
  const testing::TemporaryFolder folder;
  std::filesystem::create_directories(folder / "se[s]sion/bias");
  const auto root = folder / "se[s]sion";
  for (const char* name : {"f10.tif", "f2.tif", "f1.tif", "odd[1].tif", "f3.png"})
    write_file(root / "bias" / name, "x", false);
  write_file(root / "s.toml",
             "[[frames]]\nkind = \"bias\"\npaths = [\"b*/f*.tif\", \"bias/odd[1].tif\"]\n", false);
  const Session session = load_session(root / "s.toml");
  ASSERT_EQ(session.groups[0].paths.size(), 4u);
  std::vector<std::string> names;
  for (const auto& path : session.groups[0].paths) {
    EXPECT_TRUE(std::filesystem::exists(path));
    names.push_back(path.filename().string());
  }
  EXPECT_THAT(names, ElementsAre("f1.tif", "f2.tif", "f10.tif", "odd[1].tif"));
}

TEST(Session, MissingFilesAreNamed) {
  const testing::TemporaryFolder folder;
  const auto path = folder / "s.toml";
  EXPECT_THAT([&] { load_session(path); }, ThrowsMessage<InputError>(HasSubstr("does not exist")));
  write_file(path, "[[frames]]\nkind = \"bias\"\npaths = [\"bias/*.tif\"]\n", false);
  EXPECT_THAT([&] { load_session(path); },
              ThrowsMessage<InputError>(
                  AllOf(HasSubstr("\"bias/*.tif\", which no file matches"), HasSubstr(":3"))));
  std::filesystem::create_directories(folder / "bias/x.tif");
  EXPECT_THAT([&] { load_session(path); }, ThrowsMessage<InputError>(HasSubstr("is a folder")));
}

TEST(Session, AFileThatIsNoneIsNotReadWhole) {
  const testing::TemporaryFolder folder;
  const auto path = folder / "frame.raw";
  write_file(path, "x", false);
  std::filesystem::resize_file(path, (64 << 20) + 1);
  const auto refused = [](const char* what) {
    return ThrowsMessage<InputError>(HasSubstr(std::string("frame.raw: is too large for ") + what));
  };
  EXPECT_THAT([&] { load_session(path); }, refused("the session file; name the right file"));
  EXPECT_THAT([&] { load_sensor(path); }, refused("the session file"));
  EXPECT_THAT([&] { load_emva_description(path); }, refused("a description"));
}

TEST(Session, TheSensorAloneNeedsNoFrames) {
  const testing::TemporaryFolder folder;
  const std::string cell = "[sensor.cell]\nrows = [[\"0\", \"45\"], [\"135\", \"90\"]]\n";
  write_file(folder / "s.toml", cell, false);
  EXPECT_EQ(load_sensor(folder / "s.toml").layout,
            SensorLayout::from_sites({{"0", "45"}, {"135", "90"}}));
  write_file(folder / "moved.toml",
             cell + "[[frames]]\nkind = \"bias\"\ngain_db = 0\npaths = [\"gone/*.tif\"]\n", false);
  EXPECT_TRUE(load_sensor(folder / "moved.toml").layout);
  EXPECT_THROW(load_session(folder / "s.toml"), InputError);
}

TEST(Session, WhatIsSavedIsReadBack) {
  const testing::TemporaryFolder folder;
  std::filesystem::create_directories(folder / "a b");
  Session session = parse(kGood);
  session.sensor.name = "quote \" backslash \\ tab \t end";
  session.sensor.black_dn = {80.1, 1e-7, 3, 4};
  session.sensor.layout = SensorLayout::from_sites({{"0", "45"}, {"135", "90"}});
  session.sensor.raw_format = RawFormat::kMono12Packed;
  session.sensor.rows = 20;
  session.sensor.cols = 30;
  session.groups[0].paths = {folder / "a b" / "f[1].raw", folder / "a b" / "f\"2.raw"};
  session.groups[1].paths = {folder / "x.raw"};
  for (const auto& group : session.groups)
    for (const auto& path : group.paths) write_file(path, "x", false);
  save_session(folder / "s.toml", session, false);
  const Session back = load_session(folder / "s.toml");
  EXPECT_EQ(back.sensor.name, session.sensor.name);
  EXPECT_EQ(back.sensor.black_dn, session.sensor.black_dn);
  EXPECT_EQ(back.sensor.white_dn, session.sensor.white_dn);
  EXPECT_EQ(back.sensor.layout, session.sensor.layout);
  EXPECT_EQ(back.sensor.row_group, session.sensor.row_group);
  EXPECT_EQ(back.sensor.raw_format, session.sensor.raw_format);
  EXPECT_EQ(back.sensor.rows, 20);
  EXPECT_EQ(back.sensor.cols, 30);
  ASSERT_EQ(back.groups.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(back.groups[i].kind, session.groups[i].kind);
    EXPECT_EQ(back.groups[i].gain, session.groups[i].gain);
    EXPECT_EQ(back.groups[i].exposure_s, session.groups[i].exposure_s);
    EXPECT_EQ(back.groups[i].level, session.groups[i].level);
    EXPECT_EQ(back.groups[i].paths, session.groups[i].paths);
  }
  EXPECT_THAT([&] { save_session(folder / "s.toml", session, false); },
              ThrowsMessage<InputError>(HasSubstr("use force true")));
  // The folder may move with its frames.
  std::filesystem::create_directories(folder / "moved");
  std::filesystem::rename(folder / "a b", folder / "moved/a b");
  std::filesystem::rename(folder / "x.raw", folder / "moved/x.raw");
  std::filesystem::rename(folder / "s.toml", folder / "moved/s.toml");
  EXPECT_EQ(load_session(folder / "moved/s.toml").groups[0].paths.size(), 2u);
}

// TOML is UTF-8: other bytes made a file that nothing reads.
TEST(Session, NamesThatAreNotUtf8AreNotWritten) {
  const testing::TemporaryFolder folder;
  const std::filesystem::path odd = folder / "caf\xe9";
  std::filesystem::create_directory(odd);
  Session session;
  session.groups.emplace_back().paths = {odd / "f.tif"};
  write_file(odd / "f.tif", "x", false);
  const auto refused = [&](const std::filesystem::path& path) {
    return testing::problem_of([&] { save_session(path, session, false); });
  };
  EXPECT_THAT(refused(folder / "s.toml"), HasSubstr("names are not UTF-8"));
  EXPECT_FALSE(std::filesystem::exists(folder / "s.toml"));
  EXPECT_EQ(refused(odd / "s.toml"), "");  // names count from the file's folder
  EXPECT_EQ(load_session(odd / "s.toml").groups[0].paths, session.groups[0].paths);
  session.sensor.name = "caf\xe9";
  EXPECT_THAT(refused(odd / "t.toml"), HasSubstr("sensor's name that is not UTF-8"));
}

GainSetting iso(double value) { return {std::nullopt, value}; }

// A frame whose file tells what is given.
void write_frame(const std::filesystem::path& path, const GainSetting& gain,
                 std::optional<double> exposure_s) {
  RawFrame frame;
  frame.dn = Image(4, 4, 100.0f);
  frame.black_dn = {0};
  frame.gain = gain;
  frame.exposure_s = exposure_s;
  save_frame(path, frame, {true, SampleType::kUint16});
}

// The session's only group, settled, and its last frame.
RawFrame last_frame(const testing::TemporaryFolder& folder, const std::string& declared) {
  write_file(folder / "s.toml", "[[frames]]\nkind = \"bias\"\npaths = [\"*.tif\"]\n" + declared,
             true);
  const Session session = with_settings_of_files(load_session(folder / "s.toml"));
  const FrameGroup& group = session.groups.front();
  const RawFrame frame = load_session_frame(session, group, group.paths.back());
  EXPECT_EQ(frame.gain, group.gain);
  EXPECT_EQ(frame.exposure_s, group.exposure_s);
  return frame;
}

void expect_disagreement(const testing::TemporaryFolder& folder, const std::string& declared,
                         const std::string& a, const std::string& b) {
  EXPECT_THAT([&] { last_frame(folder, declared); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("2.tif"), HasSubstr(a), HasSubstr(b))));
}

TEST(SessionFrames, TheFilesTellWhatTheSessionDoesNot) {
  const testing::TemporaryFolder folder;
  for (const char* name : {"1.tif", "2.tif"}) write_frame(folder / name, iso(400), 0.01);
  EXPECT_EQ(last_frame(folder, "").gain.iso, 400);
  EXPECT_EQ(last_frame(folder, "").exposure_s, 0.01);
  EXPECT_EQ(last_frame(folder, "iso = 404\nexposure_s = 0.0105").gain.iso, 404);
  EXPECT_EQ(last_frame(folder, "gain_db = 3\nexposure_s = 0").gain.gain_db, 3);
  expect_disagreement(folder, "iso = 800", "at ISO 400", "session says ISO 800");
  expect_disagreement(folder, "exposure_s = 0.02", "at 0.01 s", "session says 0.02 s");
}

TEST(SessionFrames, OfOneSetAreOfOneSetting) {
  const testing::TemporaryFolder folder;
  write_frame(folder / "1.tif", iso(400), 0.01);
  write_frame(folder / "2.tif", iso(1600), 0.01);
  for (const char* declared : {"", "iso = 400", "gain_db = 3"})
    expect_disagreement(folder, declared, "at ISO 1600", "1.tif of the same set at ISO 400");
  write_frame(folder / "2.tif", iso(400), 0.02);
  expect_disagreement(folder, "", "at 0.02 s", "1.tif of the same set at 0.01 s");
}

TEST(SessionFrames, FilesThatTellNothingAreTakenAtTheSessionsWord) {
  const testing::TemporaryFolder folder;
  for (const char* name : {"1.tif", "2.tif"}) write_frame(folder / name, {}, {});
  EXPECT_EQ(last_frame(folder, "").gain.text(), "unknown gain");
  EXPECT_EQ(last_frame(folder, "iso = 200").gain.iso, 200);
  write_frame(folder / "2.tif", iso(400), {});
  expect_disagreement(folder, "", "at ISO 400", "1.tif of the same set tells no gain");
  EXPECT_EQ(last_frame(folder, "iso = 400").gain.iso, 400);
  write_frame(folder / "2.tif", {}, 0.5);
  expect_disagreement(folder, "iso = 400", "at 0.5 s", "1.tif of the same set tells no exposure");
}

}  // namespace
}  // namespace malus
