// Truth: the definition, written again in double precision without tiles, bands or vectors; and
// estimates whose noise is known.
#include "malus/denoise/internal/detail_shrinkage.h"

#include "malus/base/random.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "denoise/instruction_sets.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::CellMatrix;
using internal::kCell;
using internal::kDetailBlock;
using internal::kDetailSide;
using internal::kLanes;
using internal::ReferenceMap;

constexpr int kStep = 16;

CellMatrix hadamard_axes() {
  CellMatrix axes;
  for (std::size_t i = 0; i < kLanes; ++i)
    for (std::size_t k = 0; k < kLanes; ++k)
      axes[i][k] = __builtin_parityll(i & k) ? -0.25f : 0.25f;
  return axes;
}

ReferenceMap passed_everywhere(int rows, int cols, float share) {
  return {7, 0, 0, Image(rows / 7 + 1, cols / 7 + 1, share)};
}

double coefficient(int k, int i) {
  return std::sqrt((k ? 2.0 : 1.0) / kDetailSide) *
         std::cos(std::numbers::pi * (i + 0.5) * k / kDetailSide);
}

int band_of(double cycles_per_cell) {
  const std::vector<double> ends = {0.045, 0.07, 0.1, 0.14, 0.18, 0.22, 0.28, 0.35};
  return static_cast<int>(std::lower_bound(ends.begin(), ends.end(), cycles_per_cell) -
                          ends.begin());
}

// Values of a block's cells in components and frequencies: [component][v][u].
using Spectrum = std::vector<std::vector<std::vector<double>>>;

Spectrum spectrum(const std::vector<std::vector<double>>& block, const CellMatrix& axes) {
  Spectrum result(kLanes, {kDetailSide, std::vector<double>(kDetailSide)});
  for (std::size_t component = 0; component < kLanes; ++component) {
    double cells[kDetailSide][kDetailSide] = {}, rows[kDetailSide][kDetailSide] = {};
    for (int r = 0; r < kDetailBlock; ++r)
      for (int c = 0; c < kDetailBlock; ++c)
        cells[r / kCell][c / kCell] +=
            block[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)] *
            static_cast<double>(
                axes[static_cast<std::size_t>(r % kCell * kCell + c % kCell)][component]);
    for (int r = 0; r < kDetailSide; ++r)
      for (int k = 0; k < kDetailSide; ++k)
        for (int i = 0; i < kDetailSide; ++i) rows[r][k] += coefficient(k, i) * cells[r][i];
    for (int k = 0; k < kDetailSide; ++k)
      for (int c = 0; c < kDetailSide; ++c)
        for (int i = 0; i < kDetailSide; ++i)
          result[component][static_cast<std::size_t>(k)][static_cast<std::size_t>(c)] +=
              coefficient(k, i) * rows[i][c];
  }
  return result;
}

std::vector<std::vector<double>> block_of(const Spectrum& values, const CellMatrix& axes) {
  std::vector<std::vector<double>> block(kDetailBlock, std::vector<double>(kDetailBlock));
  for (std::size_t component = 0; component < kLanes; ++component) {
    double rows[kDetailSide][kDetailSide] = {}, cells[kDetailSide][kDetailSide] = {};
    for (int i = 0; i < kDetailSide; ++i)
      for (int c = 0; c < kDetailSide; ++c)
        for (int k = 0; k < kDetailSide; ++k)
          rows[i][c] += coefficient(k, i) *
                        values[component][static_cast<std::size_t>(k)][static_cast<std::size_t>(c)];
    for (int r = 0; r < kDetailSide; ++r)
      for (int i = 0; i < kDetailSide; ++i)
        for (int k = 0; k < kDetailSide; ++k) cells[r][i] += coefficient(k, i) * rows[r][k];
    for (int r = 0; r < kDetailBlock; ++r)
      for (int c = 0; c < kDetailBlock; ++c)
        block[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)] +=
            cells[r / kCell][c / kCell] *
            static_cast<double>(
                axes[static_cast<std::size_t>(r % kCell * kCell + c % kCell)][component]);
  }
  return block;
}

// Returns the mean of the squared gains.
double shrink_bands(Spectrum& values, double half_at) {
  double kept = 0;
  const double energies[] = {220, 150, 110, 75, 50, 33, 18, 8, 0.7};
  const double of_group[] = {1, 0.5, 0.12, 0.04};
  const std::size_t ends[] = {1, 4, 8, 16};
  for (int band = 0; band < 9; ++band) {
    double most = 0;
    for (int group = 0; group < 4; ++group) {
      double sum = 0, count = 0;
      for (std::size_t k = group ? ends[group - 1] : 0; k < ends[group]; ++k)
        for (std::size_t v = 0; v < kDetailSide; ++v)
          for (std::size_t u = 0; u < kDetailSide; ++u)
            if (u + v > 0 && band_of(std::hypot(u, v) / 32) == band) {
              sum += values[k][v][u] * values[k][v][u];
              ++count;
            }
      most = std::max(most, sum / count / (energies[band] * of_group[group]));
    }
    const double cube = std::pow(most / half_at, 3), gain = cube / (cube + 1);
    for (auto& component : values)
      for (std::size_t v = 0; v < kDetailSide; ++v)
        for (std::size_t u = 0; u < kDetailSide; ++u)
          if (u + v > 0 && band_of(std::hypot(u, v) / 32) == band) {
            component[v][u] *= gain;
            kept += gain * gain / (kLanes * (kDetailSide * kDetailSide - 1));
          }
  }
  return kept;
}

struct Shrunk {
  Image pixels, kept;  // both of the picture's size
};

// One share of noise everywhere.
Shrunk plain(const Image& estimate, const CellMatrix& axes, double half_at) {
  const int rows = estimate.rows(), cols = estimate.cols();
  std::vector<double> sum(estimate.size()), weight(estimate.size()), sum_kept(estimate.size());
  const auto bump = [](int i) {
    return std::sin(std::numbers::pi * (i + 0.5) / kDetailSide) + 0.5;
  };
  for (int row = kStep - kDetailBlock; row < rows; row += kStep)
    for (int col = kStep - kDetailBlock; col < cols; col += kStep) {
      std::vector<std::vector<double>> block(kDetailBlock, std::vector<double>(kDetailBlock));
      for (int r = 0; r < kDetailBlock; ++r)
        for (int c = 0; c < kDetailBlock; ++c)
          block[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)] = static_cast<double>(
              estimate(folded(row + r, rows, kCell), folded(col + c, cols, kCell)));
      Spectrum values = spectrum(block, axes);
      const double kept = shrink_bands(values, half_at);
      block = block_of(values, axes);
      for (int r = std::max(0, -row); r < std::min(kDetailBlock, rows - row); ++r)
        for (int c = std::max(0, -col); c < std::min(kDetailBlock, cols - col); ++c) {
          const auto at = static_cast<std::size_t>((row + r) * cols + col + c);
          const double w = bump(r / kCell) * bump(c / kCell);
          sum[at] += w * block[static_cast<std::size_t>(r)][static_cast<std::size_t>(c)];
          sum_kept[at] += w * kept;
          weight[at] += w;
        }
    }
  Shrunk out{Image(rows, cols), Image(rows, cols)};
  for (std::size_t i = 0; i < sum.size(); ++i) {
    out.pixels.values()[i] = static_cast<float>(sum[i] / weight[i]);
    out.kept.values()[i] = static_cast<float>(sum_kept[i] / weight[i]);
  }
  return out;
}

// Light that changes smoothly, and noise as it is left: coarser than a cell, alike within it.
Image smooth_light(int rows, int cols, double noise, double texture) {
  Image picture(rows, cols), draws(rows / 8 + 2, cols / 8 + 2);
  RandomSequence random(11, 0, Draw::kParameters, 0);
  for (float& value : draws.values()) value = static_cast<float>(random.normal());
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      picture(r, c) = static_cast<float>(
          40 + 0.05 * r + 3 * std::sin(c / 40.0) +
          noise * static_cast<double>(draws(r / 8, c / 8)) +
          texture * (std::sin(r * 0.7) * std::cos(c * 0.55) + (r / 8 + c / 8) % 2));
  return picture;
}

double rms_between(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const double d = static_cast<double>(a.values()[i] - b.values()[i]);
    sum += d * d;
  }
  return std::sqrt(sum / static_cast<double>(a.size()));
}

Image shrunk(const Image& picture, float share, float threshold,
             internal::CellMap* kept = nullptr) {
  return internal::shrink_detail({picture, 0, 0}, picture.rows(), picture.cols(), hadamard_axes(),
                                 passed_everywhere(picture.rows(), picture.cols(), share),
                                 threshold, kept);
}

TEST(DetailShrinkage, EqualsItsDefinition) {
  for (const auto& [rows, cols] : {std::pair{70, 93}, {64, 64}, {5, 130}, {1, 1}}) {
    const Image picture = smooth_light(rows, cols, 0.3, 0.1);
    for (const float share : {0.002f, 0.02f}) {
      const Shrunk expected = plain(picture, hadamard_axes(), 6.0 * static_cast<double>(share));
      internal::CellMap kept({picture, 0, 0});
      const Image result = shrunk(picture, share, 6, &kept);
      EXPECT_EQ(result, shrunk(picture, share, 6)) << "asking for more changes nothing";
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) {
          ASSERT_NEAR(result(r, c), expected.pixels(r, c), 1e-3) << rows << ' ' << share;
          ASSERT_NEAR(kept.values(r / kCell, c / kCell), expected.kept(r, c), 1e-4);
        }
    }
  }
}

TEST(DetailShrinkage, IsTheSameOnEveryInstructionSet) {
  const Image picture = smooth_light(70, 93, 0.3, 0.1);
  expect_same_on_every_instruction_set([&] { return shrunk(picture, 0.005f, 6); }, 1e-3);
}

TEST(DetailShrinkage, NothingIsTakenWhereNoNoisePassed) {
  const Image picture = smooth_light(133, 150, 0.3, 0);
  for (const Image& result : {shrunk(picture, 0, 6), shrunk(picture, 0.01f, 0)})
    EXPECT_LT(rms_between(result, picture), 1e-4);
}

TEST(DetailShrinkage, PassedNoiseIsTakenAndDetailStays) {
  const Image clean = smooth_light(160, 192, 0, 0), noisy = smooth_light(160, 192, 0.1, 0);
  EXPECT_LT(rms_between(shrunk(noisy, 0.01f, 6), clean), 0.7 * rms_between(noisy, clean));
  const Image textured = smooth_light(160, 192, 0.1, 4);
  EXPECT_LT(rms_between(shrunk(textured, 0.01f, 6), textured), 0.2 * rms_between(noisy, clean));
}

// Where no stack has a reference nothing is known; of several, those that passed least count most.
TEST(DetailShrinkage, TheShareIsTheHarmonicMeanOfTheBlocksReferences) {
  const Image picture = smooth_light(64, 64, 0.3, 0);
  ReferenceMap mixed = passed_everywhere(64, 64, 0);
  for (int r = 0; r < mixed.values.rows(); ++r)
    for (int c = 0; c < mixed.values.cols(); ++c)
      mixed.values(r, c) = (r + c) % 2 ? 0.0f : c % 2 ? 0.01f : 0.03f;
  const Image result = internal::shrink_detail({picture, 0, 0}, 64, 64, hadamard_axes(), mixed, 6);
  EXPECT_LT(rms_between(result, shrunk(picture, 0.015f, 6)), 0.02);
  EXPECT_GT(rms_between(result, shrunk(picture, 0.02f, 6)), 0.02);
}

}  // namespace
}  // namespace malus
