// Truth: sums of geometric series, and pictures known without noise.
#include "malus/denoise/internal/mosaic_filter.h"

#include "malus/base/random.h"

#include <cmath>

#include "denoise/instruction_sets.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Texture of many brightnesses, weakly polarized (below the noise of deviation 1) and slowly
// turning.
Image textured(int rows, int cols, const SensorLayout& layout) {
  Image image(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double brightness = 20 + 8 * std::sin(0.31 * r + 0.05 * c) * std::cos(0.23 * c) +
                                5 * std::sin(0.011 * r * c / 7);
      const Site& site = layout.site(layout.channel_at(r, c));
      const double turn = 2 * (*site.angle_deg * 0.0174533 - 0.01 * c);
      image(r, c) = static_cast<float>(brightness * (1 + 0.04 * std::cos(turn)));
    }
  return image;
}

// Error of the four angles about their mean, root mean square.
double polarization_error(const Image& a, const Image& b) {
  double sum = 0;
  for (int r = 0; r + 1 < a.rows(); r += 2)
    for (int c = 0; c + 1 < a.cols(); c += 2) {
      double d[4], mean = 0;
      for (int i = 0; i < 4; ++i) {
        d[i] = a(r + i / 2, c + i % 2) - b(r + i / 2, c + i % 2);
        mean += 0.25 * d[i];
      }
      for (const double x : d) sum += (x - mean) * (x - mean);
    }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

TEST(MosaicFilter, AxesPriorHasTheStatedEnergies) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  RandomSequence random(5, 0, Draw::kOther);
  Image pixels(64, 64);
  for (float& v : pixels.values()) v = static_cast<float>(random.normal());
  const CellStatistics statistics = measure_cells(source_of(pixels, layout));
  ASSERT_EQ(statistics.axes_prior.size(), 16u);
  for (std::size_t a = 0; a < 16; ++a)
    for (std::size_t q = 0; q < 16; ++q) {
      double energy = 0;  // of the q-th axis
      for (std::size_t i = 0; i < 16; ++i)
        for (std::size_t k = 0; k < 16; ++k)
          energy += static_cast<double>(statistics.axes_prior[a][i][k]) *
                    statistics.rotations[a][i][q] * statistics.rotations[a][k][q];
      const double stated = q == 0 ? 0.0 : 0.24 * std::pow(0.8, static_cast<double>(q) - 1);
      EXPECT_NEAR(energy, stated, 1e-5) << a << ' ' << q;
    }
}

TEST(MosaicPlan, CombinesWhereCellsAreAlikeAndThePilotHasBeenFiltered) {
  const auto combines = [](const char* method, const char* profile, const SensorLayout& layout) {
    const auto plan = mosaic_filter_plan(method, profile, layout);
    return plan.guided.back().filter == internal::StackFilter::ridge;
  };
  for (const char* profile : {"normal", "high"}) {
    for (const char* name : {"mono", "bayer-rggb", "polar-mono", "polar-bayer-grbg"}) {
      EXPECT_TRUE(combines("nl-ridge", profile, SensorLayout::named(name))) << name;
      EXPECT_FALSE(combines("bm3d", profile, SensorLayout::named(name))) << name;
    }
    // Three pixels: every cell of four begins elsewhere in the period.
    EXPECT_FALSE(combines("nl-ridge", profile, SensorLayout::from_sites({{"0", "45", "90"}})));
  }
  EXPECT_FALSE(combines("nl-ridge", "fast", SensorLayout::named("polar-bayer-grbg")));
}

class MosaicMethods : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Both, MosaicMethods, testing::Values("bm3d", "nl-ridge"));

// Clean light with noise of deviation 1 (one draw for every plan), filtered. beyond: so much more
// of the surroundings than a tile has to have.
Image filtered(const Image& clean, const MosaicFilterPlan& plan, const SensorLayout& layout,
               int beyond = 0) {
  const int rows = clean.rows(), cols = clean.cols();
  Image noisy = clean;
  RandomSequence random(11, 0, Draw::kOther);
  for (float& v : noisy.values()) v += static_cast<float>(random.normal());
  const FrameSource source = source_of(noisy, layout);
  const CellStatistics statistics = measure_cells(source);
  const int edge = mosaic_filter_border(plan, layout) + beyond;
  const internal::StackTile tile = cut_tile(source, -edge, -edge, rows + 2 * edge, cols + 2 * edge);
  const Image whole = filter_mosaic(tile, rows, cols, statistics, plan, silent_progress());
  Image result(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) result(r, c) = whole(edge + r, edge + c);
  return result;
}

TEST_P(MosaicMethods, NeedNoMoreThanTheBorderBeyondTheFrame) {
  for (const char* name : {"polar-bayer-rggb", "polar-mono", "mono"}) {
    const SensorLayout layout = SensorLayout::named(name);
    Image clean(70, 93, 20);
    for (int r = 0; r < 70; ++r)
      for (int c = 0; c < 93; ++c) clean(r, c) += 8 * std::sin(0.31f * static_cast<float>(r + c));
    const MosaicFilterPlan plan = mosaic_filter_plan(GetParam(), "normal", layout);
    const Image little = filtered(clean, plan, layout), more = filtered(clean, plan, layout, 200);
    for (std::size_t i = 0; i < clean.size(); ++i)
      ASSERT_EQ(little.values()[i], more.values()[i]) << name << ' ' << i;
  }
}

// Squares of 16 pixels that differ in polarization alone, by less than the noise: ten cells around
// a block hold 12 of its copies.
TEST_P(MosaicMethods, WhatRepeatsFarAwayHelpsColourPolarization) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  Image clean(288, 288);
  for (int r = 0; r < 288; ++r)
    for (int c = 0; c < 288; ++c) {
      const double turn = 2 * (*layout.site(layout.channel_at(r, c)).angle_deg * 0.0174533 - 0.5);
      const double dolp = (r / 16 + c / 16) % 2 ? 0.1 : 0.4;
      clean(r, c) = static_cast<float>(8 * (1 + dolp * std::cos(turn)));
    }
  MosaicFilterPlan plan = mosaic_filter_plan(GetParam(), "normal", layout);
  ASSERT_EQ(plan.hard.front().far_step, 2);
  EXPECT_EQ(plan.coarse.front().hard.front().far_step, 1);
  const auto error = [&] { return polarization_error(filtered(clean, plan, layout), clean); };
  const double wide = error();
  for (internal::StackStage& stage : plan.hard) stage.far_step = 1;
  for (internal::StackStage& stage : plan.guided) stage.far_step = 1;
  if (plan.large) plan.large->far_step = 1;
  EXPECT_LT(wide, 0.7 * error());
}

// What the pilot cannot tell from noise, weak polarization above all, is found along the frame's
// axes rather than along those of the pilot's own noise.
TEST_P(MosaicMethods, TheFramesAxesHelpWeakPolarization) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  const Image clean = textured(96, 96, layout);
  MosaicFilterPlan plan = mosaic_filter_plan(GetParam(), "high", layout);
  plan.survey.reset();  // doubt of the pilot takes most of the same errors
  const auto error = [&] { return polarization_error(filtered(clean, plan, layout), clean); };
  const double with_prior = error();
  for (internal::StackStage& stage : plan.hard) stage.axes_prior = internal::kFrameAxes;
  for (internal::StackStage& stage : plan.guided) stage.axes_prior = 0;
  const double without = error();
  EXPECT_LT(with_prior, 0.99 * without);  // the same noise in both: 2.2 % here
  EXPECT_LT(with_prior, 0.35);            // of the noise
}

// Rounding can change which blocks are nearest, and so a pixel here and there by more than itself.
TEST_P(MosaicMethods, AreTheSameOnEveryInstructionSet) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  const Image clean = textured(70, 93, layout);
  const MosaicFilterPlan plan = mosaic_filter_plan(GetParam(), "normal", layout);
  expect_same_on_every_instruction_set([&] { return filtered(clean, plan, layout); }, 0.1);
}

TEST(MosaicFilter, LargeBlocksHelpSmoothLight) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  Image clean(160, 160);
  for (int r = 0; r < 160; ++r)
    for (int c = 0; c < 160; ++c) {
      const double light = 20 + 8 * std::sin(0.08 * r + 0.04 * c) * std::cos(0.05 * c);
      const double turn =
          2 * (*layout.site(layout.channel_at(r, c)).angle_deg * 0.0174533 - 0.02 * c);
      clean(r, c) = static_cast<float>(light * (1 + 0.3 * std::cos(turn)));
    }
  MosaicFilterPlan plan = mosaic_filter_plan("nl-ridge", "normal", layout);
  const auto squared_error = [&] {
    const Image result = filtered(clean, plan, layout);
    double sum = 0;
    for (std::size_t i = 0; i < clean.size(); ++i)
      sum += std::pow(result.values()[i] - clean.values()[i], 2);
    return sum;
  };
  const double with = squared_error();
  plan.large.reset();
  EXPECT_LT(with, 0.95 * squared_error());
}

// Differences of blocks that are not alike are signal, however bright: no coefficient is lost to
// them as the pilot's noise.
TEST_P(MosaicMethods, FineTextureFarAboveTheNoiseIsNoWorseThanItWas) {
  RandomSequence random(17, 0, Draw::kOther);
  Image clean(128, 128);
  for (float& v : clean.values()) v = 200.0f + 40.0f * static_cast<float>(random.normal());
  for (const char* layout_name : {"polar-bayer-rggb", "polar-mono", "bayer-rggb", "mono"})
    for (const char* profile : {"fast", "normal"}) {
      const SensorLayout layout = SensorLayout::named(layout_name);
      const Image result = filtered(clean, mosaic_filter_plan(GetParam(), profile, layout), layout);
      double squared_error = 0;  // of noise whose variance is 1
      for (std::size_t i = 0; i < clean.size(); ++i)
        squared_error += std::pow(result.values()[i] - clean.values()[i], 2);
      EXPECT_LT(squared_error / static_cast<double>(clean.size()), 1.02)
          << layout_name << ' ' << profile;
    }
}

}  // namespace
}  // namespace malus
