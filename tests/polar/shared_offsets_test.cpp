// Row and column noise in the errors of Stokes parameters: pixels of a group of lines have one
// offset.
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/image/pack.h"
#include "malus/polar/uncertainty.h"

#include <cmath>
#include <string>

#include <fmt/format.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kReadSd = 2, kLight = 50;

LineOffsets offsets_of(const SensorLayout& layout, double sd_dn, int group_lines) {
  return {std::vector<double>(static_cast<std::size_t>(layout.channels()), sd_dn), group_lines, {}};
}

// Draws of so many lines in units of their deviation; correlation: of neighbouring groups, two
// apart its square.
std::vector<double> draws_of(const LineOffsets& lines, double correlation, int count,
                             RandomSequence& random) {
  std::vector<double> draws;
  for (int line = 0; line < count; ++line)
    draws.push_back(line == 0 ? random.normal()
                    : line % lines.group_lines != 0
                        ? draws.back()
                        : correlation * draws.back() +
                              std::sqrt(1 - correlation * correlation) * random.normal());
  return draws;
}

double sd_of(const LineOffsets& lines, const SensorLayout& layout, int r, int c) {
  return lines.sd_dn.empty() ? 0.0 : lines.sd_dn[static_cast<std::size_t>(layout.channel_at(r, c))];
}

// Even light with read noise, and lines of the channels' deviations.
Image noisy_frame(const SensorLayout& layout, const SharedOffsets& offsets, double correlation,
                  int size, std::uint32_t frame) {
  RandomSequence random(21, frame, Draw::kOther);
  Image dn(size, size);
  const std::vector<double> rows = draws_of(offsets.rows, correlation, size, random),
                            columns = draws_of(offsets.columns, correlation, size, random);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c)
      dn(r, c) = static_cast<float>(
          kLight + kReadSd * random.normal() +
          rows[static_cast<std::size_t>(r)] * sd_of(offsets.rows, layout, r, c) +
          columns[static_cast<std::size_t>(c)] * sd_of(offsets.columns, layout, r, c));
  return dn;
}

Planes variance_with(const SensorLayout& layout, const SharedOffsets& offsets, int size) {
  Image variance(size, size);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c)
      variance(r, c) =
          static_cast<float>(kReadSd * kReadSd + std::pow(sd_of(offsets.rows, layout, r, c), 2) +
                             std::pow(sd_of(offsets.columns, layout, r, c), 2));
  return pack(variance, layout);
}

struct Spread {
  Moments s0, s1, s2;
  double s0_stated = 0, s1_stated = 0, s2_stated = 0;
};

// Over the cells down from `cell` (or to its right, of columns), every `step`th, of many frames: of
// the mean of the colours, or of one.
Spread spread_of(const SensorLayout& layout, const SharedOffsets& offsets, double correlation = 0,
                 int color = 0, int cell = 0, int step = 1) {
  constexpr int kFrames = 2000;
  const int size = 12 * layout.rows() / 2;
  const bool down = offsets.columns.sd_dn.empty();
  const auto at = [&](const Image& plane, int i) { return down ? plane(i, 1) : plane(1, i); };
  Spread spread;
  const Planes variance = variance_with(layout, offsets, size);
  for (int k = 0; k < kFrames; ++k) {
    const Image dn = noisy_frame(layout, offsets, correlation, size, static_cast<std::uint32_t>(k));
    const StokesPicture picture = merge_greens(stokes_per_color(pack(dn, layout), layout), layout);
    const StokesPlanes s =
        color < 0 ? mean_stokes(picture.planes) : picture.planes[static_cast<std::size_t>(color)];
    for (int i = cell; i < s.s0.rows(); i += step) {
      spread.s0.add(at(s.s0, i)), spread.s1.add(at(s.s1, i)), spread.s2.add(at(s.s2, i));
    }
    if (k > 0) continue;
    const auto stated =
        color < 0 ? uncertainty_of_mean(picture, variance, layout, Intensities::kMeasured, offsets)
                  : uncertainty_of(picture, variance, layout, Intensities::kMeasured,
                                   offsets)[static_cast<std::size_t>(color)];
    spread.s0_stated = at(stated.s0_variance, cell);
    spread.s1_stated = at(stated.s1_variance, cell);
    spread.s2_stated = at(stated.s2_variance, cell);
  }
  return spread;
}

// At least 4000 draws, of which half are as good as independent: 4 standard errors are 13 %.
constexpr double kTolerance = 0.13;

void expect_as_stated(const Spread& spread, const std::string& what) {
  EXPECT_NEAR(spread.s0.variance() / spread.s0_stated, 1, kTolerance) << what;
  EXPECT_NEAR(spread.s1.variance() / spread.s1_stated, 1, kTolerance) << what;
  EXPECT_NEAR(spread.s2.variance() / spread.s2_stated, 1, kTolerance) << what;
}

// Two lines together: S0 = 2 x the offset, none is left in S1 and S2. One by one: S0 has both
// lines' offsets, S1 and S2 their difference.
void expect_sums_and_differences(const Spread& one, const Spread& two, const std::string& lines) {
  constexpr double v = kReadSd * kReadSd;
  EXPECT_FLOAT_EQ(static_cast<float>(one.s0_stated), static_cast<float>(3 * v)) << lines;
  EXPECT_FLOAT_EQ(static_cast<float>(one.s1_stated), static_cast<float>(4 * v)) << lines;
  EXPECT_FLOAT_EQ(static_cast<float>(two.s0_stated), static_cast<float>(5 * v)) << lines;
  EXPECT_FLOAT_EQ(static_cast<float>(two.s2_stated), static_cast<float>(2 * v)) << lines;
  expect_as_stated(one, lines + " one by one");
  expect_as_stated(two, "two " + lines + " together");
}

TEST(SharedOffsets, AddUpInS0AndCancelInDifferences) {
  const auto layout = SensorLayout::named("polar-mono");
  const LineOffsets one = offsets_of(layout, kReadSd, 1), two = offsets_of(layout, kReadSd, 2);
  expect_sums_and_differences(spread_of(layout, {one, {}}), spread_of(layout, {two, {}}), "rows");
  expect_sums_and_differences(spread_of(layout, {{}, one}), spread_of(layout, {{}, two}),
                              "columns");
}

// Groups of three lines meet cells of two in turn: within one, across two, within one.
TEST(SharedOffsets, OfGroupsThatDivideCells) {
  const auto layout = SensorLayout::named("polar-mono");
  const LineOffsets three = offsets_of(layout, kReadSd, 3);
  for (const SharedOffsets& offsets : {SharedOffsets{three, {}}, SharedOffsets{{}, three}}) {
    for (const int cell : {0, 1, 2})
      expect_as_stated(spread_of(layout, offsets, 0, 0, cell, 3), fmt::format("cell {}", cell));
    EXPECT_GT(spread_of(layout, offsets, 0, 0, 0, 3).s0_stated,
              1.5 * spread_of(layout, offsets, 0, 0, 1, 3).s0_stated);
  }
}

TEST(SharedOffsets, OfColoursChannelsAndDriftingRows) {
  const auto layout = SensorLayout::named("polar-bayer-rggb");
  LineOffsets lines = offsets_of(layout, kReadSd, 1);
  for (int k = 0; k < 16; ++k) lines.sd_dn[static_cast<std::size_t>(k)] *= 0.5 + 0.1 * k;
  LineOffsets drifting = lines;
  drifting.correlation = {0.6, 0.36, 0.216};
  for (const int color : {-1, 0, 1, 2}) {
    expect_as_stated(spread_of(layout, {drifting, {}}, 0.6, color),
                     fmt::format("rows, colour {}", color));
    expect_as_stated(spread_of(layout, {lines, lines}, 0, color),
                     fmt::format("rows and columns, colour {}", color));
  }
}

}  // namespace
}  // namespace malus
