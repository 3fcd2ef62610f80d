// Settings that replace what a configuration says. Files of every kind are read in the tests of
// what reads them.
#include "malus/io/config_section.h"

#include "../problem_of.h"
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
