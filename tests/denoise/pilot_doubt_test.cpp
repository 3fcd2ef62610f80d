// Truth: coefficients drawn with known energies; pictures known without noise.
#include "malus/denoise/internal/pilot_doubt.h"

#include "malus/base/random.h"
#include "malus/denoise/mosaic_filter.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

using internal::doubt_of;
using internal::kUsualExcess;
using internal::PilotEvidence;
using internal::ReferenceMap;

constexpr int kStep = 21;

// Energy of one at every reference, and an excess that differs between left and right.
PilotEvidence evidence(float left, float right, int cols = 40) {
  PilotEvidence result;
  result.energy = {kStep, -2, 3, Image(12, cols, 1.0f)};
  result.excess = {kStep, -2, 3, Image(12, cols, left)};
  for (int r = 0; r < 12; ++r)
    for (int c = cols / 2; c < cols; ++c) result.excess.values(r, c) = right;
  return result;
}

TEST(PilotDoubt, RisesWhereSamplesHoldLessThanThePilot) {
  const ReferenceMap doubt = doubt_of(evidence(kUsualExcess, 0));
  EXPECT_EQ(doubt.step, kStep);
  EXPECT_EQ(doubt.first_row, -2);
  EXPECT_EQ(doubt.first_col, 3);
  const int near = internal::doubt_reach(kStep) / kStep;
  for (int r = 0; r < 12; ++r)
    for (int c = 0; c < 40; ++c) {
      if (c < 20 - near) {
        EXPECT_NEAR(doubt.values(r, c), 1, 1e-5f);
      }
      if (c > 20 + near) {
        EXPECT_NEAR(doubt.values(r, c), std::exp(1.5 * 1.1), 1e-3);
      }
      if (c > 0) {
        EXPECT_GE(doubt.values(r, c), doubt.values(r, c - 1));
      }
    }
  EXPECT_LT(doubt_of(evidence(2, 2)).values(5, 5), 1);
  EXPECT_GT(doubt_of(evidence(-9, -9)).values(5, 5), 4);
  EXPECT_LT(doubt_of(evidence(-9, -9)).values(5, 5), 10);  // never without bound
}

TEST(PilotDoubt, IsNoneWithoutEvidence) {
  PilotEvidence none = evidence(0, 0);
  for (float& v : none.energy.values.values()) v = 0;
  const ReferenceMap doubt = doubt_of(none);
  for (const float v : doubt.values.values()) EXPECT_EQ(v, 1);
}

TEST(PilotDoubt, OfTheLastPassIsTheRoot) {
  const ReferenceMap doubt = doubt_of(evidence(kUsualExcess, 0));
  const ReferenceMap half = internal::halved(doubt);
  for (std::size_t i = 0; i < half.values.size(); ++i)
    EXPECT_NEAR(half.values.values()[i] * half.values.values()[i], doubt.values.values()[i], 1e-5);
}

// Independent values have the same energy along any axes, in any stack.
struct Survey {
  double excess = 0, energy = 0;
  Survey(double signal, double pilot_signal, double pilot_noise) {
    const SensorLayout layout = SensorLayout::named("mono");
    constexpr int kSurveyed = 160;
    RandomSequence random(23, 0, Draw::kUser);
    Image noisy(kSurveyed, kSurveyed), pilot(kSurveyed, kSurveyed);
    for (std::size_t i = 0; i < noisy.size(); ++i) {
      const double light = random.normal();
      noisy.values()[i] = static_cast<float>(signal * light + random.normal());
      pilot.values()[i] = static_cast<float>(pilot_signal * light + pilot_noise * random.normal());
    }
    const CellStatistics statistics =
        measure_cells([&](int r, int c) { return noisy(r, c); }, kSurveyed, kSurveyed, layout);
    const internal::StackTile tile{noisy, 0, 0};
    const internal::StageInput input{.noisy = &tile,
                                     .guide = &pilot,
                                     .period_rows = 1,
                                     .period_cols = 1,
                                     .frame_rows = kSurveyed,
                                     .frame_cols = kSurveyed,
                                     .rotations = &statistics.rotations,
                                     .axes_prior = &statistics.axes_prior};
    PilotEvidence found;
    internal::run_stage(input, *mosaic_filter_plan("nl-ridge", "normal", layout).survey,
                        silent_progress(), {.evidence = &found});
    for (const float v : found.excess.values.values()) excess += static_cast<double>(v);
    for (const float v : found.energy.values.values()) energy += static_cast<double>(v);
  }
};

TEST(PilotDoubt, EvidenceTellsNoiseInThePilotFromSignalThatItLost) {
  const Survey noise(0, 0, 0.5);  // the pilot holds noise that is not the samples', 0.25
  EXPECT_LT(noise.excess, 0.4 * noise.energy);
  const Survey lost(0.7, 0.35, 0);  // 0.49 in the samples, a quarter of it in the pilot
  EXPECT_GT(lost.excess, 2 * lost.energy);
}

// Else the even ground around things, most of many frames, would decide for them.
TEST(PilotDoubt, EvenGroundSaysLittle) {
  const Survey even(0, 0, 0.02), textured(0.5, 0.5, 0);
  EXPECT_LT(even.energy, 0.02 * textured.energy);  // a ninth if all counted alike
  EXPECT_LT(std::abs(even.excess), 0.02 * textured.energy);
}

// Letters of one size, bars, anything crisp: the first pilot is full of noise.
TEST(PilotDoubt, TakesNoiseOutOfPrint) {
  const SensorLayout layout = SensorLayout::named("polar-mono");
  constexpr int kPrint = 192, kEdge = 128;
  Image clean(kPrint, kPrint, 40), noisy;
  RandomSequence random(29, 0, Draw::kUser);
  for (int r = 0; r < kPrint; ++r)
    for (int c = 0; c < kPrint; ++c)
      if (r % 24 < 16 && ((c + 5 * (r / 24)) / 3 * 7919) % 11 < 5) clean(r, c) = 10;
  noisy = clean;
  for (float& v : noisy.values()) v += static_cast<float>(random.normal());
  const PixelSource pixel = [&](int r, int c) { return noisy(r, c); };
  const CellStatistics statistics = measure_cells(pixel, kPrint, kPrint, layout);
  const internal::StackTile tile = cut_tile(pixel, kPrint, kPrint, -kEdge, -kEdge,
                                            kPrint + 2 * kEdge, kPrint + 2 * kEdge, layout);
  const auto error = [&](const MosaicFilterPlan& plan) {
    const Image result = filter_mosaic(tile, kPrint, kPrint, statistics, plan, silent_progress());
    double sum = 0;
    for (int r = 0; r < kPrint; ++r)
      for (int c = 0; c < kPrint; ++c)
        sum += std::pow(static_cast<double>(result(kEdge + r, kEdge + c) - clean(r, c)), 2);
    return sum;
  };
  for (const char* method : {"nl-ridge", "bm3d"}) {
    MosaicFilterPlan plan = mosaic_filter_plan(method, "normal", layout);
    const double with = error(plan);
    plan.survey.reset();
    EXPECT_LT(with, 0.8 * error(plan)) << method;
  }
}

}  // namespace
}  // namespace malus
