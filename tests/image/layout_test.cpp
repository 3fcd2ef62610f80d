#include "malus/image/layout.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(SensorLayout, ColourPolarizationHasTheSonyBlocks) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  EXPECT_EQ(layout.channels(), 16);
  EXPECT_EQ(layout.channel_name(0), "R90");
  EXPECT_EQ(layout.channel_name(1), "R45");
  EXPECT_EQ(layout.channel_name(2), "G1_90");
  EXPECT_EQ(layout.channel_name(5), "R0");
  EXPECT_EQ(layout.channel_name(15), "B0");
  EXPECT_TRUE(layout.polarized());
  EXPECT_TRUE(layout.colored());
}

// Every registered layout survives the trip through its site names and keeps its name.
TEST(SensorLayout, RegistryRoundTrips) {
  for (const auto& name : SensorLayout::known_names()) {
    const auto layout = SensorLayout::named(name);
    std::vector<std::vector<std::string>> cell(static_cast<std::size_t>(layout.rows()));
    for (int i = 0; i < layout.channels(); ++i)
      cell[static_cast<std::size_t>(i / layout.cols())].push_back(layout.channel_name(i));
    const auto again = SensorLayout::from_sites(cell);
    EXPECT_EQ(again, layout) << name;
    EXPECT_EQ(again.name(), name);
  }
}

TEST(SensorLayout, MirrorHandedCellIsCustom) {
  const auto layout = SensorLayout::from_sites({{"0", "45"}, {"135", "90"}});
  EXPECT_EQ(layout.name(), "custom");
  EXPECT_TRUE(layout.polarized());
}

TEST(SensorLayout, UnknownNamesAndSitesAreRefusedWithAHint) {
  try {
    SensorLayout::named("polar-bayer-rgbg");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("polar-bayer-rggb"), std::string::npos);
  }
  EXPECT_THROW(SensorLayout::from_sites({{"R90", "R45"}, {"R135"}}), InputError);
  EXPECT_THROW(SensorLayout::from_sites({{"X90"}}), InputError);
  EXPECT_THROW(SensorLayout::from_sites({}), InputError);
}

TEST(Pack, RoundTripsAnySize) {
  for (const auto& name : SensorLayout::known_names())
    for (const auto& [rows, cols] : {std::pair{1, 1}, {3, 5}, {8, 8}, {9, 14}, {64, 67}}) {
      const auto layout = SensorLayout::named(name);
      Image mosaic(rows, cols), back(rows, cols);
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) mosaic(r, c) = static_cast<float>(1000 * r + c);
      const Planes planes = pack(mosaic, layout);
      unpack(planes, layout, back);
      EXPECT_EQ(back.values(), mosaic.values()) << name << ' ' << rows << 'x' << cols;
    }
}

TEST(Pack, MissingSamplesRepeatTheirOwnChannel) {
  const auto layout = SensorLayout::named("polar-mono");
  Image mosaic(3, 3);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) mosaic(r, c) = static_cast<float>(layout.channel_at(r, c));
  const Planes planes = pack(mosaic, layout);
  for (int k = 0; k < 4; ++k)
    for (float v : planes[k].values()) EXPECT_EQ(v, static_cast<float>(k));
}

}  // namespace
}  // namespace malus
