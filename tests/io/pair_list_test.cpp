#include "malus/io/pair_list.h"

#include "malus/base/error.h"

#include <fstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr const char* kEntry =
    R"({"name": "scene003_01", "reference": "r.tif", "short": "s.tif", "ratio": 4, "gain_db": 12, "iso": null})";

TEST(PairList, PathsAreRelativeToTheList) {
  const testing::TemporaryFolder folder;
  std::ofstream(folder / "pairs.json") << R"({"pairs": [)" << kEntry << "]}";
  const auto pairs = load_pair_list(folder / "pairs.json");
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].scene(), "scene003");
  EXPECT_EQ(pairs[0].noisy, folder / "s.tif");
  EXPECT_EQ(pairs[0].reference, folder / "r.tif");
  EXPECT_TRUE(pairs[0].picture.empty());
  EXPECT_EQ(pairs[0].ratio, 4);
  EXPECT_EQ(pairs[0].gain, (GainSetting{.gain_db = 12, .iso = std::nullopt}));
}

TEST(PairList, OnlyTheLastPartOfANameCountsTheFrames) {
  RecordedPair pair;
  pair.name = "flower_10_02";
  EXPECT_EQ(pair.scene(), "flower_10");
  pair.name = "flower";
  EXPECT_EQ(pair.scene(), "flower");
}

TEST(PairList, ComesBackFromAnotherFolder) {
  const testing::TemporaryFolder folder, other;
  const RecordedPair pair{.name = "x_00",
                          .noisy = folder / "n.tif",
                          .reference = folder / "r.npy",
                          .picture = folder / "p.npy",
                          .ratio = 2.5,
                          .gain = {.gain_db = std::nullopt, .iso = 1600}};
  save_pair_list({pair}, other / "list.json");
  const auto back = load_pair_list(other / "list.json");
  ASSERT_EQ(back.size(), 1u);
  EXPECT_EQ(back[0].name, pair.name);
  EXPECT_EQ(back[0].noisy, pair.noisy);
  EXPECT_EQ(back[0].reference, pair.reference);
  EXPECT_EQ(back[0].picture, pair.picture);
  EXPECT_EQ(back[0].ratio, pair.ratio);
  EXPECT_EQ(back[0].gain, pair.gain);
}

TEST(PairList, SaysWhichBiasAReferenceHolds) {
  const testing::TemporaryFolder folder;
  const auto read = [&](const std::string& more) {
    std::string entry = kEntry;
    entry.insert(entry.size() - 1, more);
    std::ofstream(folder / "pairs.json") << R"({"pairs": [)" << entry << "]}";
    return load_pair_list(folder / "pairs.json");
  };
  EXPECT_FALSE(read("")[0].bias_at);
  EXPECT_FALSE(read(R"(, "bias_removed": true)")[0].bias_at);
  EXPECT_FALSE(read("")[0].reference_gain);
  const auto free =
      read(R"(, "bias_removed": true, "reference_gain": {"gain_db": 3, "iso": null})");
  EXPECT_FALSE(free[0].bias_at);
  EXPECT_EQ(free[0].reference_gain, (GainSetting{.gain_db = 3, .iso = std::nullopt}));
  save_pair_list(free, folder / "again.json");
  EXPECT_FALSE(load_pair_list(folder / "again.json")[0].bias_at);
  EXPECT_EQ(load_pair_list(folder / "again.json")[0].reference_gain, free[0].reference_gain);
  const auto biased =
      read(R"(, "bias_removed": false, "reference_gain": {"gain_db": null, "iso": 200})");
  EXPECT_EQ(biased[0].bias_at, (GainSetting{.gain_db = std::nullopt, .iso = 200}));
  save_pair_list(biased, folder / "again.json");
  EXPECT_EQ(load_pair_list(folder / "again.json")[0].bias_at, biased[0].bias_at);
  EXPECT_THAT([&] { read(R"(, "bias_removed": false)"); },
              ThrowsMessage<InputError>(HasSubstr("no list of pairs")));
}

TEST(PairList, NamesThatAreNotUtf8AreRefusedBeforeAnythingIsWritten) {
  const testing::TemporaryFolder folder;
  RecordedPair pair;
  pair.noisy = "/caf\xe9.tif";
  pair.reference = "/reference.tif";
  EXPECT_THAT([&] { save_pair_list({pair}, folder / "list.json"); },
              ThrowsMessage<InputError>(HasSubstr("not UTF-8")));
  EXPECT_FALSE(std::filesystem::exists(folder / "list.json"));
}

TEST(PairList, WhatIsNoListIsNamed) {
  const testing::TemporaryFolder folder;
  const auto path = folder / "pairs.json";
  const auto refused = [&](const std::string& text) {
    std::ofstream(path) << text;
    return [&] { load_pair_list(path); };
  };
  EXPECT_THAT([&] { load_pair_list(folder / "none.json"); },
              ThrowsMessage<InputError>(HasSubstr("none.json")));
  EXPECT_THAT(refused(R"({"pairs": [{"name": "a", "short": "b.tif"}]})"),
              ThrowsMessage<InputError>(HasSubstr(R"(the pair "a" has no "reference")")));
  for (const char* text : {"", "[]", R"({"pairs": 3})", R"({"pairs": [4]})"})
    EXPECT_THAT(refused(text), ThrowsMessage<InputError>(HasSubstr("no list of pairs"))) << text;
  std::string negative = kEntry;
  negative.replace(negative.find("4"), 1, "-1");
  EXPECT_THAT(refused(R"({"pairs": [)" + negative + "]}"),
              ThrowsMessage<InputError>(HasSubstr("ratio -1")));
  std::string dark = kEntry;
  dark.replace(dark.find("12, \"iso\": null"), 15, "null, \"iso\": -200");
  EXPECT_THAT(refused(R"({"pairs": [)" + dark + "]}"),
              ThrowsMessage<InputError>(HasSubstr("iso: is -200")));
  std::string worded = kEntry;
  worded.replace(worded.find("12"), 2, "\"12\"");
  EXPECT_THAT(refused(R"({"pairs": [)" + worded + "]}"),
              ThrowsMessage<InputError>(HasSubstr("no list of pairs")));
  std::string alike = kEntry;
  alike.replace(alike.find("r.tif"), 5, "./s.tif");
  EXPECT_THAT(refused(R"({"pairs": [)" + alike + "]}"),
              ThrowsMessage<InputError>(HasSubstr("as short and as reference")));
}

}  // namespace
}  // namespace malus
