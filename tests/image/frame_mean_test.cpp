// Truth: means of what the frames are drawn from.
#include "malus/image/frame_mean.h"

#include "malus/base/random.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "problem_of.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;

constexpr int kFrames = 8, kSide = 256;
constexpr double kDeviation = 6;

struct Scene {
  int shifted = 0;  // columns from the middle of the burst on
  double lamp = 1;  // from there on
  double black = 50;
  double blinking = 0;  // share of pixels that jump by 40 deviations in one frame
};

// A bright disc and stripes on a slope.
double light_at(int r, int c) {
  const bool disc = std::hypot(r - 90.0, c - 100.0) < 40;
  return 200 + 0.5 * r + (disc ? 400 : 0) + (r > 160 && (c / 6) % 2 ? 150 : 0);
}

RawFrame frame_of(const Scene& scene, std::uint32_t number) {
  RawFrame frame;
  frame.layout = SensorLayout::named("polar-mono");
  frame.black_dn.assign(4, scene.black);
  frame.white_dn = 4095;
  frame.black_known = frame.white_known = frame.layout_known = true;
  frame.bits = 12;
  frame.gain.gain_db = 12;
  frame.exposure_s = 0.01;
  frame.source = "frame " + std::to_string(number);
  frame.dn = Image(kSide, kSide);
  RandomSequence random(5, number, Draw::kOther);
  const bool late = number >= kFrames / 2;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) {
      double value = light_at(r, c + (late ? scene.shifted : 0)) * (late ? scene.lamp : 1);
      value += kDeviation * random.normal();
      if (random.uniform() < scene.blinking / kFrames) value += 40 * kDeviation;
      frame.dn(r, c) = static_cast<float>(std::nearbyint(scene.black + value));
    }
  return frame;
}

SceneMean mean_of_scene(const Scene& scene) {
  SceneMean mean(kFrames);
  for (std::uint32_t i = 0; i < kFrames; ++i) mean.add(frame_of(scene, i));
  return mean;
}

TEST(SceneMean, HasTheMeanOfEveryPixelAndWhatTheFramesSay) {
  SceneMean frames = mean_of_scene({});
  const RawFrame mean = frames.take();
  EXPECT_EQ(mean.mean_of, kFrames);
  EXPECT_EQ(mean.bits, 0);
  EXPECT_TRUE(mean.holds_codes());
  EXPECT_EQ(mean.black_dn, (std::vector<double>{50, 50, 50, 50}));
  EXPECT_EQ(mean.white_dn, 4095);
  EXPECT_EQ(mean.gain.gain_db, 12);
  EXPECT_EQ(mean.exposure_s, 0.01);
  double squares = 0;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      squares += std::pow(mean.dn(r, c) - 50 - light_at(r, c), 2) / (kSide * kSide);
  // Of 65536 pixels, rounding included: ±0.6 %.
  EXPECT_NEAR(squares * kFrames / (kDeviation * kDeviation + 1.0 / 12), 1, 0.03);
}

TEST(SceneMean, NothingMovedInASceneThatStoodStill) {
  EXPECT_LT(mean_of_scene({}).changed_share(), 1e-4);
  EXPECT_LT(mean_of_scene({.lamp = 1.2}).changed_share(), 1e-4);
  // Light that is a third of the black level.
  EXPECT_LT(mean_of_scene({.lamp = 1.05, .black = 1000}).changed_share(), 1e-4);
  // As of a hot sensor: one pixel in a hundred.
  EXPECT_LT(mean_of_scene({.blinking = 0.01}).changed_share(), 5e-4);
}

TEST(SceneMean, WhatMovedIsFound) {
  EXPECT_GT(mean_of_scene({.shifted = 1}).changed_share(), 0.01);
  EXPECT_GT(mean_of_scene({.shifted = 3, .lamp = 0.9}).changed_share(), 0.02);
}

TEST(SceneMean, APixelSaturatedInMoreThanATenthIsAtWhite) {
  SceneMean twenty(20);
  for (int i = 0; i < 20; ++i) {
    RawFrame frame = frame_of({}, 0);
    frame.dn(5, 5) = static_cast<float>(i);  // no copies
    frame.dn(0, 0) = i < 2 ? 4095 : 4000;    // a tenth
    frame.dn(0, 1) = i < 3 ? 4095 : 4000;
    frame.dn(0, 2) = i < 1 ? std::numeric_limits<float>::quiet_NaN() : 100;
    twenty.add(frame);
  }
  const RawFrame mean = twenty.take();
  EXPECT_FLOAT_EQ(mean.dn(0, 0), 4009.5f);
  EXPECT_EQ(mean.dn(0, 1), 4095);
  EXPECT_TRUE(std::isnan(mean.dn(0, 2)));
}

// As `denoise` has it: the largest code of 8 bits is white, whoever tells it.
TEST(SceneMean, CodesOfEightBitsKnowWhenTheyAreSaturated) {
  for (const bool saturated : {false, true}) {
    SceneMean ten(10);
    for (int i = 0; i < 10; ++i) {
      RawFrame frame = frame_of({}, 0);
      frame.dn = Image(8, 8, 100);
      frame.bits = 8;
      frame.white_dn = 255;
      frame.white_known = false;
      frame.dn(0, 0) = saturated && i < 4 ? 255 : 250;
      ten.add(frame);
    }
    const RawFrame mean = ten.take();
    EXPECT_EQ(mean.dn(0, 0), saturated ? 255 : 250);
    EXPECT_EQ(mean.white_known, saturated);
  }
}

TEST(SceneMean, FloatsThatTellNoBlackAreAboveIt) {
  SceneMean two(2);
  for (std::uint32_t i = 0; i < 2; ++i) {
    RawFrame frame = frame_of({}, i);
    frame.bits = 0;
    frame.black_dn = {0, 0, 0, 0};
    frame.black_known = false;
    two.add(frame);
  }
  EXPECT_TRUE(two.take().black_known);
}

// The noise of a copy does not average out, whatever its file is called.
TEST(SceneMean, RefusesACopyOfAFrame) {
  const auto problem = [](const RawFrame& frame) {
    return problem_of([&] {
      SceneMean mean(3);
      mean.add(frame);
      mean.add(frame_of({}, 1));
      RawFrame again = frame;
      again.source = "again";
      mean.add(again);
    });
  };
  EXPECT_NE(problem(frame_of({}, 0)).find("again: has the same pixels as frame 0"),
            std::string::npos);
  RawFrame saturated = frame_of({}, 0);
  saturated.dn = Image(kSide, kSide, 4095);
  EXPECT_EQ(problem(saturated), "");
}

TEST(SceneMean, RefusesWhatWasNotTakenAlike) {
  const auto refused = [](auto change) {
    return problem_of([&] {
      SceneMean mean(2);
      mean.add(frame_of({}, 0));
      RawFrame other = frame_of({}, 1);
      change(other);
      mean.add(other);
    });
  };
  EXPECT_EQ(refused([](RawFrame&) {}), "");
  EXPECT_NE(refused([](RawFrame& f) { f.dn = Image(8, 8); }).find("frame 1"), std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.gain.gain_db = 13; }).find("another gain"),
            std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.exposure_s = 0.02; }).find("another exposure"),
            std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.black_dn[2] = 51; }).find("another black"),
            std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.white_dn = 4000; }).find("another white"),
            std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.bits = 10; }).find("another type"), std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.layout = SensorLayout(); }).find("another layout"),
            std::string::npos);
  EXPECT_NE(refused([](RawFrame& f) { f.mean_of = 4; }).find("mean of 4 frames"),
            std::string::npos);
}

}  // namespace
}  // namespace malus
