// Truth: coefficients drawn with known energies; pictures known without noise.
#include "malus/denoise/internal/pilot_doubt.h"

#include "malus/base/random.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <cmath>
#include <utility>

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

TEST(PilotDoubt, OwnEvidenceOfAStackChangesItsDoubt) {
  const auto settled = [](float ratio, float energy) {
    return internal::settled_doubt(3, {ratio * energy, energy});
  };
  const float same = kUsualExcess - std::log(3.0f) / 1.5f;  // what a doubt of 3 comes from
  EXPECT_NEAR(settled(0, 0), 3, 1e-4);
  EXPECT_NEAR(settled(same + 0.2f, 500), 3, 1e-3);
  EXPECT_LT(settled(2, 50), 2.8);  // little evidence, little change
  EXPECT_GT(settled(2, 50), 1.8);
  EXPECT_LT(settled(2, 500), 1.01);
  EXPECT_GT(settled(0, 500), 4);
  EXPECT_GT(settled(9, 1e6f), 0.5);  // within the bounds of any doubt
  EXPECT_LT(settled(-9, 1e6f), 10);
}

TEST(PilotDoubt, OfCombinationsEndsWhereManyCoefficientsAreBright) {
  EXPECT_FLOAT_EQ(internal::doubt_of_combinations(4, 0), 4);
  EXPECT_FLOAT_EQ(internal::doubt_of_combinations(4, 0.025f), 2);
  EXPECT_FLOAT_EQ(internal::doubt_of_combinations(4, 0.05f), 1);
  EXPECT_FLOAT_EQ(internal::doubt_of_combinations(4, 0.4f), 1);
}

// Independent values have the same energy along any axes, in any stack.
struct Survey {
  double excess = 0, energy = 0;
  double settled = 0;  // mean of what a doubt of 2 becomes
  Survey(double signal, double pilot_signal, double pilot_noise) {
    const SensorLayout layout = SensorLayout::named("mono");
    constexpr int kSurveyed = 160;
    RandomSequence random(23, 0, Draw::kOther);
    Image noisy(kSurveyed, kSurveyed), pilot(kSurveyed, kSurveyed);
    for (std::size_t i = 0; i < noisy.size(); ++i) {
      const double light = random.normal();
      noisy.values()[i] = static_cast<float>(signal * light + random.normal());
      pilot.values()[i] = static_cast<float>(pilot_signal * light + pilot_noise * random.normal());
    }
    const CellStatistics statistics = measure_cells(source_of(noisy, layout));
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
    const ReferenceMap two{kSurveyed, 0, 0, Image(1, 1, 2.0f)};
    internal::StageInput doubting = input;
    doubting.doubt = &two;
    ReferenceMap stacks;
    internal::run_stage(doubting, mosaic_filter_plan("nl-ridge", "normal", layout).guided.front(),
                        silent_progress(), {.settled = &stacks});
    int count = 0;
    for (const float v : stacks.values.values()) {
      settled += static_cast<double>(v);
      count += v > 0;
    }
    settled /= count;
  }
};

TEST(PilotDoubt, EvidenceTellsNoiseInThePilotFromSignalThatItLost) {
  const Survey noise(0, 0, 0.5);  // the pilot holds noise that is not the samples', 0.25
  EXPECT_LT(noise.excess, 0.4 * noise.energy);
  const Survey lost(0.7, 0.35, 0);  // 0.49 in the samples, a quarter of it in the pilot
  EXPECT_GT(lost.excess, 2 * lost.energy);
  EXPECT_GT(noise.settled, 2.2);
  EXPECT_LT(lost.settled, 1.5);
}

double error_of(const Image& clean, const MosaicFilterPlan& plan, const SensorLayout& layout) {
  constexpr int kEdge = 128;
  const int size = clean.rows();
  Image noisy = clean;
  RandomSequence random(29, 0, Draw::kOther);
  for (float& v : noisy.values()) v += static_cast<float>(random.normal());
  const FrameSource source = source_of(noisy, layout);
  const CellStatistics statistics = measure_cells(source);
  const internal::StackTile tile =
      cut_tile(source, -kEdge, -kEdge, size + 2 * kEdge, size + 2 * kEdge);
  const Image result = filter_mosaic(tile, size, size, statistics, plan, silent_progress());
  double sum = 0;
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c)
      sum += std::pow(static_cast<double>(result(kEdge + r, kEdge + c) - clean(r, c)), 2);
  return sum;
}

// A circuit board: the pins' surroundings are full of the pilot's noise, the pins are not.
TEST(PilotDoubt, LeavesRareDetailOfABoardAlone) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  Image clean(192, 192, 6);
  for (int r = 0; r < 192; ++r)
    for (int c = 0; c < 192; ++c) {
      if ((r % 31 == 12 || r % 31 == 13) && c > r / 2) clean(r, c) = 12;  // traces
      if (r / 40 % 2 == 1 && r % 40 < 6 && c % 5 < 2 && c > 30 + r / 3 && c < 110)
        clean(r, c) = 26;  // pins
    }
  // By the neighbourhood's evidence alone, 1.09 and 1.02.
  const std::pair<const char*, double> cases[] = {{"nl-ridge", 1.07}, {"bm3d", 1.0}};
  for (const auto& [method, most] : cases) {
    MosaicFilterPlan plan = mosaic_filter_plan(method, "normal", layout);
    const double with = error_of(clean, plan, layout);
    plan.survey.reset();
    EXPECT_LT(with, most * error_of(clean, plan, layout)) << method;
  }
}

// Lamps of different colours on dark, even ground: next to all of their surroundings' coefficients
// hold nothing, but their own are bright. Doubted like the weak ones they cost 1.5 times the error.
TEST(PilotDoubt, LeavesLampsOnDarkGroundAlone) {
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  Image clean(160, 160, 2);
  RandomSequence random(31, 0, Draw::kOther);
  for (int lamp = 0; lamp < 10; ++lamp) {
    const double row = 10 + 140 * random.uniform(), col = 10 + 140 * random.uniform(),
                 radius = 3 + 5 * random.uniform();
    const double light[] = {8 + 10 * random.uniform(), 8 + 10 * random.uniform(),
                            8 + 10 * random.uniform()};
    for (int r = 0; r < 160; ++r)
      for (int c = 0; c < 160; ++c)
        if (std::hypot(r - row, c - col) < radius)
          clean(r, c) = static_cast<float>(light[r / 2 % 2 + c / 2 % 2]);
  }
  for (const auto& [method, most] : {std::pair{"nl-ridge", 1.05}, std::pair{"bm3d", 1.0}}) {
    MosaicFilterPlan plan = mosaic_filter_plan(method, "normal", layout);
    const double with = error_of(clean, plan, layout);
    plan.survey.reset();
    EXPECT_LT(with, most * error_of(clean, plan, layout)) << method;
  }
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
  constexpr int kPrint = 192;
  Image clean(kPrint, kPrint, 40);
  for (int r = 0; r < kPrint; ++r)
    for (int c = 0; c < kPrint; ++c)
      if (r % 24 < 16 && ((c + 5 * (r / 24)) / 3 * 7919) % 11 < 5) clean(r, c) = 10;
  for (const char* method : {"nl-ridge", "bm3d"}) {
    MosaicFilterPlan plan = mosaic_filter_plan(method, "normal", layout);
    const double with = error_of(clean, plan, layout);
    plan.survey.reset();
    EXPECT_LT(with, 0.8 * error_of(clean, plan, layout)) << method;
  }
}

}  // namespace
}  // namespace malus
