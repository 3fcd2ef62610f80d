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

// In rows of the cell, so that a pixel further on the one order's cell is the other's.
TEST(SensorLayout, TheFourBayerOrdersAreOneSensor) {
  const std::vector<std::pair<std::string, CellPhase>> orders = {
      {"rggb", {0, 0}}, {"grbg", {0, 1}}, {"gbrg", {1, 0}}, {"bggr", {1, 1}}};
  for (const auto& [kind, pixels] : {std::pair<std::string, int>{"bayer-", 1}, {"polar-bayer-", 2}})
    for (const auto& [order, phase] : orders) {
      const auto layout = SensorLayout::named(kind + order);
      const auto wanted = SensorLayout::named(kind + "rggb");
      const CellPhase moved{pixels * phase.row, pixels * phase.col};
      EXPECT_EQ(layout.phase_in(wanted), moved) << layout.name();
      const auto back = wanted.phase_in(layout).value();
      EXPECT_EQ((back.row + moved.row) % wanted.rows(), 0);
      EXPECT_EQ((back.col + moved.col) % wanted.cols(), 0);
    }
  const auto bayer = SensorLayout::named("bayer-rggb"), mono = SensorLayout::named("polar-mono");
  EXPECT_FALSE(mono.phase_in(bayer));
  EXPECT_FALSE(bayer.phase_in(SensorLayout::named("polar-bayer-rggb")));
  EXPECT_FALSE(SensorLayout::from_sites({{"0", "45"}, {"135", "90"}}).phase_in(mono));
}

// What it sees of any light is what the coloured one sees of grey light, pixel by pixel.
TEST(SensorLayout, WithoutColoursIsOneThatSeesGrey) {
  const auto mono = SensorLayout::named("mono"), polar = SensorLayout::named("polar-mono");
  for (const char* order : {"rggb", "grbg", "gbrg", "bggr"}) {
    const auto bayer = SensorLayout::named(std::string("bayer-") + order);
    const auto polar_bayer = SensorLayout::named(std::string("polar-bayer-") + order);
    EXPECT_EQ(mono.phase_in(bayer), (CellPhase{0, 0})) << order;
    EXPECT_EQ(polar.phase_in(polar_bayer), (CellPhase{0, 0})) << order;
    EXPECT_FALSE(mono.phase_in(polar_bayer)) << order;
    EXPECT_FALSE(polar.phase_in(bayer)) << order;
    EXPECT_FALSE(bayer.phase_in(mono)) << order;
    EXPECT_FALSE(polar_bayer.phase_in(polar)) << order;
  }
  const auto rggb = SensorLayout::named("polar-bayer-rggb");
  const auto row_on = SensorLayout::from_sites({{"135", "0"}, {"90", "45"}});
  EXPECT_EQ(row_on.phase_in(rggb), (CellPhase{1, 0}));
  EXPECT_FALSE(SensorLayout::from_sites({{"45", "90"}, {"135", "0"}}).phase_in(rggb));
  EXPECT_FALSE(SensorLayout::from_sites({{"R", "R", "B"}})
                   .phase_in(SensorLayout::from_sites({{"R", "R", "R", "R", "B", "B"}})));
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

// Against the definition: a mosaic that begins inside a cell is one with its first samples put
// before it once more.
TEST(Pack, AMosaicMayBeginInsideACell) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  for (const CellPhase phase : {CellPhase{2, 0}, {0, 2}, {2, 2}, {1, 3}})
    for (const auto& [rows, cols] : {std::pair{4, 4}, {9, 14}, {64, 67}}) {
      Image mosaic(rows, cols), padded(phase.row + rows, phase.col + cols), back(rows, cols);
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) mosaic(r, c) = static_cast<float>(1000 * r + c);
      for (int r = 0; r < padded.rows(); ++r)
        for (int c = 0; c < padded.cols(); ++c)
          padded(r, c) = mosaic(r < phase.row ? r + 4 - phase.row : r - phase.row,
                                c < phase.col ? c + 4 - phase.col : c - phase.col);
      const Planes planes = pack(mosaic, layout, phase), expected = pack(padded, layout);
      for (int k = 0; k < 16; ++k) EXPECT_EQ(planes[k], expected[k]) << k << ' ' << rows;
      unpack(planes, layout, back, phase);
      EXPECT_EQ(back, mosaic);
    }
}

TEST(Pack, MosaicsSmallerThanACellHaveAPhaseToo) {
  const auto layout = SensorLayout::named("bayer-rggb");
  Image mosaic(1, 1), back(1, 1);
  mosaic(0, 0) = 7;
  const Planes planes = pack(mosaic, layout, {1, 1});
  ASSERT_EQ(planes.rows(), 1);
  for (const Image& plane : planes) EXPECT_EQ(plane(0, 0), 7.0F);
  unpack(planes, layout, back, {1, 1});
  EXPECT_EQ(back, mosaic);
}

}  // namespace
}  // namespace malus
