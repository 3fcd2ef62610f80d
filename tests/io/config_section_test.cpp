// Settings that replace what a configuration says. Files of every kind are read in the tests of
// what reads them.
#include "malus/io/config_section.h"

#include "../problem_of.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;

constexpr const char* kFile = R"(title = "a"
[train]
steps = 250
loss = "both"
[data]
pictures = ["x.png", "y.png"]
)";

ConfigSection with(const std::vector<std::string>& settings) {
  return ConfigSection::parse(kFile, "file.toml", "the configuration", settings);
}

TEST(ConfigSettings, ReplaceAndAddAndLeaveTheRest) {
  const ConfigSection root = with({"train.steps=7", "train.rate=1e-3", "noise.gains=[0, 12]",
                                   "data.pictures=z*.png", "title=b = c"});
  EXPECT_EQ(root.section("train")->whole_number("steps", 0, 100), 7);
  EXPECT_EQ(root.section("train")->number("rate"), 1e-3);
  EXPECT_EQ(root.section("train")->text("loss"), "both");
  EXPECT_EQ(root.section("noise")->numbers("gains"), (std::vector<double>{0, 12}));
  EXPECT_EQ(root.section("data")->texts("pictures"), std::vector<std::string>{"z*.png"});
  EXPECT_EQ(root.text("title"), "b = c");
}

// What the file names cannot be left out otherwise; there, an empty list is a slip.
TEST(ConfigSettings, AnEmptyListLeavesOutWhatTheFileNames) {
  EXPECT_TRUE(with({"data.pictures=[]"}).section("data")->texts("pictures").empty());
  const ConfigSection file =
      ConfigSection::parse("pictures = []", "file.toml", "the configuration");
  EXPECT_NE(problem_of([&] { (void)file.texts("pictures"); }).find("is an empty list"),
            std::string::npos);
}

TEST(ConfigSettings, TheLastOneCounts) {
  const ConfigSection root = with({"train.steps=7", "train.steps=8"});
  EXPECT_EQ(root.section("train")->whole_number("steps", 0, 100), 8);
}

TEST(ConfigSettings, QuotedTextsAreTexts) {
  EXPECT_EQ(with({"train.loss=\"7\""}).section("train")->text("loss"), "7");
  EXPECT_EQ(with({"train.loss=l1"}).section("train")->text("loss"), "l1");
  EXPECT_EQ(with({"train.loss=a\\b\"c"}).section("train")->text("loss"), "a\\b\"c");
}

TEST(ConfigSettings, MistakesNameTheSetting) {
  for (const char* wrong : {"train.steps", "=7", "train..steps=7", ""})
    EXPECT_NE(problem_of([&] { with({wrong}); }).find(std::string("set ") + wrong + ": is no"),
              std::string::npos)
        << wrong;
  EXPECT_EQ(problem_of([] {
              (void)with({"train.steps=many"}).section("train")->whole_number("steps", 0, 9);
            }).find("set train.steps=many: steps"),
            0u);
  EXPECT_EQ(problem_of([] {
              with({"train.stepz=3"}).section("train")->require_known({"steps", "loss"});
            }).find("set train.stepz=3: unknown key"),
            0u);
  // What the file itself says is still found in the file.
  EXPECT_EQ(problem_of([] {
              (void)with({"train.steps=3"}).section("train")->whole_number("loss", 0, 9);
            }).find("file.toml:4: loss"),
            0u);
}

TEST(ConfigSection, KeysOfEndlessPartsAreRefused) {
  std::string parts = "a";
  for (int i = 0; i < 200000; ++i) parts += i % 2 == 0 ? ".a" : " . \"b.c\"";
  const auto problem = [&](const std::string& text) {
    return problem_of([&] { ConfigSection::parse(text, "file.toml", "the file"); });
  };
  const std::string refused = "a key has too many parts; correct the TOML";
  EXPECT_EQ(problem("b = 1\n" + parts + " = 1"), "file.toml:2: " + refused);
  EXPECT_EQ(problem("[" + parts + "]"), "file.toml:1: " + refused);
  EXPECT_EQ(problem("x = {y = 1, " + parts + " = 1}"), "file.toml:1: " + refused);
  EXPECT_EQ(problem("t = \"\"\"x\n\"\"\"\"\" # it's\n" + parts + " = 1"),
            "file.toml:3: " + refused);
  EXPECT_THAT(problem_of([&] { with({parts + "=1"}); }), ::testing::HasSubstr("is no setting"));
}

TEST(ConfigSection, DotsElsewhereAreNoParts) {
  std::string numbers, dots(500, '.');
  for (int i = 0; i < 500; ++i) numbers += "0.5, ";
  const ConfigSection root =
      ConfigSection::parse("n = [" + numbers + "] # " + dots + "\nt = \"it's \\\"" + dots +
                               "\"\nl = '''\n" + dots + "'''\na.\"" + dots + "\".c = 1",
                           "file.toml", "the file", {"t2=" + dots});
  EXPECT_EQ(root.numbers("n").size(), 500u);
  EXPECT_EQ(root.text("t"), "it's \"" + dots);
  EXPECT_EQ(root.text("l"), dots);
  EXPECT_EQ(root.text("t2"), dots);
  EXPECT_EQ(root.section("a")->section(dots)->whole_number("c", 0, 9), 1);
}

TEST(ConfigSection, WhatAValueWasUsedForNamesItsPlace) {
  const auto wrong = [](const char* key) {
    with({}).section("train")->naming(
        key, [] { throw InputError("loss \"both\"", "is of no use", "use another"); });
  };
  EXPECT_EQ(problem_of([&] { wrong("loss"); }),
            "file.toml:4: loss in [train]: loss \"both\": is of no use; use another");
  EXPECT_EQ(problem_of([&] { wrong("rate"); }).find("file.toml:2: rate in [train]: "), 0u);
  EXPECT_EQ(with({}).naming("title", [] { return 7; }), 7);
}

}  // namespace
}  // namespace malus
