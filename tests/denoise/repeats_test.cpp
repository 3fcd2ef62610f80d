// Truth: drawn structure with steps that are known, and pictures without any.
#include "malus/denoise/internal/repeats.h"

#include "malus/base/random.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::Repeats;
using internal::RepeatStep;

const SensorLayout& colour_polarization() {
  static const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  return layout;
}

// Light with noise of deviation 1.
Image noisy_light(int rows, int cols, const std::function<double(int, int)>& light) {
  Image image(rows, cols);
  RandomSequence random(5, 0, Draw::kOther);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) image(r, c) = static_cast<float>(light(r, c) + random.normal());
  return image;
}

// Every 17 pixels: the same pixels of a cell come again after 17 cells.
double print(int r, int c) { return r % 17 < 7 && c % 17 < 6 ? 1.0 : 0.0; }
double weave(int r, int c) { return (r % 17 < 8) == (c % 17 < 9) ? 0.35 : -0.35; }

std::vector<RepeatStep> steps_in(const Image& image, int row, int col) {
  return internal::find_repeats(source_of(image, colour_polarization())).at(row, col);
}

bool holds(const std::vector<RepeatStep>& steps, int rows, int cols) {
  return std::any_of(steps.begin(), steps.end(), [&](const RepeatStep& step) {
    return step.rows == rows && step.cols == cols;
  });
}

TEST(Repeats, AreFoundInWhatNoiseHides) {
  const std::vector<RepeatStep> steps = steps_in(noisy_light(400, 440, print), 200, 200);
  for (const int rows : {-68, 0, 68})
    for (const int cols : {-68, 0, 68})
      EXPECT_EQ(holds(steps, rows, cols), rows != 0 || cols != 0) << rows << ' ' << cols;
  // What is off by a pixel is not always told from a copy then.
  const auto off = [](int pixels) { return std::abs(std::remainder(pixels, 17)); };
  for (const RepeatStep& step : steps)
    EXPECT_LE(std::max(off(step.rows), off(step.cols)), 1) << step.rows << ' ' << step.cols;
  EXPECT_LE(steps.size(), static_cast<std::size_t>(internal::kMostRepeatSteps));
}

TEST(Repeats, AreThoseOfTheirPartOfTheFrame) {
  const Image image = noisy_light(500, 1100, [](int r, int c) {
    return c < 520 ? print(r, c) : 0.1 * std::sin(0.0001 * r * c);
  });
  EXPECT_TRUE(holds(steps_in(image, 250, 100), 0, 68));
  EXPECT_TRUE(steps_in(image, 250, 1000).empty());
}

TEST(Repeats, AreNotFoundInNoiseSlopesEdgesAndSmallFrames) {
  const std::function<double(int, int)> lights[] = {
      [](int, int) { return 3.0; }, [](int r, int c) { return 0.05 * r + 0.02 * c; },
      [](int, int c) { return c < 200 ? 2.0 : 12.0; },
      [](int r, int c) { return 3 * r < 2 * c ? 2.0 : 12.0; }};
  for (const auto& light : lights)
    EXPECT_TRUE(steps_in(noisy_light(400, 400, light), 9, 9).empty());
  for (const int size : {1, 3, 17, 64})
    EXPECT_TRUE(steps_in(noisy_light(size, size, print), 0, 0).empty());
}

// The frame filtered by profile `fast`, with those repeats.
Image filtered(const FrameSource& source, CellStatistics statistics, const Repeats& repeats) {
  const MosaicFilterPlan plan = mosaic_filter_plan("nl-ridge", "fast", colour_polarization());
  statistics.repeats = repeats;
  const int edge = mosaic_filter_border(plan, colour_polarization());
  const Image whole =
      filter_mosaic(cut_tile(source, -edge, -edge, source.rows + 2 * edge, source.cols + 2 * edge),
                    source.rows, source.cols, statistics, plan, silent_progress());
  Image result(source.rows, source.cols);
  for (int r = 0; r < source.rows; ++r)
    std::copy_n(whole.row(edge + r) + edge, source.cols, result.row(r));
  return result;
}

// All copies lie beyond the near search and between the cells of the wide one.
TEST(Repeats, HelpTheFilter) {
  const Image clean_and_noise[] = {
      noisy_light(384, 384, [](int r, int c) { return 20 + 6 * weave(r, c); }),
      noisy_light(384, 384, [](int, int) { return 0.0; })};
  const FrameSource source = source_of(clean_and_noise[0], colour_polarization());
  const CellStatistics statistics = measure_cells(source);
  const Repeats repeats = internal::find_repeats(source);
  EXPECT_EQ(repeats.reach(), 136);  // twice 17 cells
  const auto error = [&](const Repeats& taken) {
    const Image result = filtered(source, statistics, taken);
    double sum = 0;
    for (std::size_t i = 0; i < result.size(); ++i)
      sum += std::pow(
          result.values()[i] - (clean_and_noise[0].values()[i] - clean_and_noise[1].values()[i]),
          2);
    return sum;
  };
  EXPECT_LT(error(repeats), 0.7 * error({}));
}

// Or blocks would count twice.
TEST(Repeats, AddNothingThatASearchTakesAnyway) {
  const Image noisy = noisy_light(150, 170, [](int r, int c) { return 20 + 6 * weave(r, c); });
  const FrameSource source = source_of(noisy, colour_polarization());
  const CellStatistics statistics = measure_cells(source);
  Repeats known(1, 1), other(1, 1);
  // Eight cells near by, and every second one up to sixteen.
  known.of_region(0, 0) = {{32, 0}, {-32, 0}, {0, 4}, {64, -40}, {-64, 40}, {8, 56}, {-8, -56}};
  other.of_region(0, 0) = {{0, 68}, {0, -68}};
  const Image without = filtered(source, statistics, {});
  EXPECT_EQ(filtered(source, statistics, known).values(), without.values());
  EXPECT_NE(filtered(source, statistics, other).values(), without.values());
}

TEST(Repeats, AreOfTheFramesOwnSizeAlone) {
  for (const char* profile : {"fast", "normal", "high"}) {
    const MosaicFilterPlan plan = mosaic_filter_plan("nl-ridge", profile, colour_polarization());
    EXPECT_TRUE(plan.repeats);
    EXPECT_FALSE(plan.coarse.front().repeats);
  }
}

TEST(Repeats, ReachFurtherWithThem) {
  const MosaicFilterPlan plan = mosaic_filter_plan("nl-ridge", "normal", colour_polarization());
  const int without = mosaic_filter_reach(plan, colour_polarization());
  EXPECT_EQ(mosaic_filter_reach(plan, colour_polarization(), false, 80),
            without);  // as the wide search
  // The first passes are alternatives; three follow one another, and each reaches twice.
  EXPECT_EQ(mosaic_filter_reach(plan, colour_polarization(), false, 140), without + 3 * 2 * 60);
}

}  // namespace
}  // namespace malus
