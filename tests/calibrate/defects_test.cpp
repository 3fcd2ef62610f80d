// Which pixels are listed as defects, and which are not.
#include "malus/calibrate/internal/defects.h"

#include "malus/base/random.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/equal_values.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "simulated_session.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

// A camera whose read noise has this deviation, 20 bias frames.
testing::SimulatedCamera narrow_camera(double read_sd_dn, double dsnu_dn) {
  testing::SimulatedCamera camera =
      testing::mono_camera(0.1, 0.14, read_sd_dn, 0.05, testing::SimulatedCamera().seed);
  camera.rows = camera.cols = 128;
  camera.flat_levels = 5;
  camera.dsnu_dn = dsnu_dn;
  return camera;
}

// Rounding makes most dark pixels of such a camera constant: up to a quarter were called stuck.
// One that does not follow the light is a defect all the same.
TEST(Defects, ConstantPixelsOfNarrowNoiseAreNotStuck) {
  for (const double read_sd_dn : {0.15, 0.24, 0.3, 0.4, 0.5})
    for (const double dsnu_dn : {0.0, 0.3}) {
      CalibrationInput input = testing::simulated_session(narrow_camera(read_sd_dn, dsnu_dn));
      testing::change_frames(input, [](RawFrame& frame, int) { frame.dn(8, 9) = 4095; });
      const NoiseModel model = calibrate_physics(input, {}, silent_progress());
      ASSERT_EQ(model.defects.size(), 1u) << read_sd_dn << " DN, DSNU " << dsnu_dn << " DN";
      EXPECT_EQ(model.defects[0].row, 8);
    }
}

// Of wider noise constancy tells by itself, without flats; a pixel that is constant in the dark
// alone, and follows the light, is none.
TEST(Defects, AStuckPixelNeedsNoFlats) {
  for (const int flat_levels : {0, 5}) {
    testing::SimulatedCamera camera = narrow_camera(1.5, 0.3);
    camera.flat_levels = flat_levels;
    CalibrationInput input = testing::simulated_session(camera);
    for (FrameSet& set : input.sets)
      testing::change_frames(set, [kind = set.kind](RawFrame& frame, int) {
        if (kind == FrameKind::kBias) frame.dn(8, 9) = 80;
      });
    const NoiseModel model = calibrate_physics(input, {}, silent_progress());
    ASSERT_EQ(model.defects.size(), flat_levels == 0 ? 1u : 0u);
    if (flat_levels == 0) {
      EXPECT_EQ(model.defects[0].kind, "stuck");
    }
  }
}

// In a glow of 40 deviations of the pixels one is hot by 15 of them; every pixel of the glow's
// core, a hundredth of all, had been called hot.
TEST(Defects, AGlowIsNone) {
  constexpr int kSide = 160, kFrames = 16;
  for (const char* layout : {"mono", "polar-mono"}) {
    const MosaicGeometry geometry(SensorLayout::named(layout), kSide, kSide, 1);
    RandomSequence random(12, 0, Draw::kOther);
    Image shading(kSide, kSide), squares(kSide, kSide);
    for (int r = 0; r < kSide; ++r)
      for (int c = 0; c < kSide; ++c) {
        shading(r, c) = static_cast<float>(40 * std::exp(-std::hypot(r - kSide, c - kSide) / 60.0) +
                                           random.normal());
        squares(r, c) = static_cast<float>(kFrames * (16 + random.normal()));
      }
    shading(150, 140) += 15;
    const DarkPixels dark{
        .shading_dn = shading,
        .sum_of_squares = squares,
        .frames = kFrames,
        .constancy = std::vector<double>(static_cast<std::size_t>(geometry.channels()), 1.0)};
    const FoundDefects found = find_defects(dark, {}, geometry);
    ASSERT_EQ(found.listed.size(), 1u) << layout;
    EXPECT_EQ(found.listed[0].row, 150);
    EXPECT_EQ(found.listed[0].col, 140);
    EXPECT_NEAR(found.listed[0].value, 15, 3) << layout;
  }
}

// Half a code from the middle at 0.24 codes: 2 Φ(2.08) - 1 = 0.963. Of wide noise 0.282/σ of the
// pairs are equal, and 0.399/σ of the values have the middle code. Where all means lie in the
// middle of a code or at its edge, the chance is not taken for less.
TEST(Defects, TheChanceToStayIsThatOfTheMiddleOfACode) {
  EXPECT_NEAR(chance_to_stay(0.7292), 0.963, 0.002);
  EXPECT_NEAR(chance_to_stay(0.00282), 0.00399, 0.00001);
  EXPECT_EQ(chance_to_stay(1), 1);
  for (const double sd : {0.2, 0.4, 0.7, 1.5})
    for (const double mean : {0.0, 0.25, 0.5}) {
      const auto below = [&](double x) {
        return 0.5 * std::erfc(-(x - mean) / (sd * std::sqrt(2.0)));
      };
      double equal = 0, most = 0;
      for (int code = -20; code <= 20; ++code) {
        const double share = below(code + 0.5) - below(code - 0.5);
        equal += share * share;
        most = std::max(most, share);
      }
      EXPECT_GE(chance_to_stay(equal), most - 0.001) << sd << " about " << mean;
    }
}

TEST(Defects, ManyOfThemAreDoubted) {
  const auto warnings = [](int every) {
    CalibrationInput input = testing::simulated_session(narrow_camera(1.5, 0.3));
    testing::change_frames(input, [every](RawFrame& frame, int) {
      for (int k = 0; k < frame.dn.cols(); k += every)
        for (int r = 0; r < frame.dn.rows(); r += every) frame.dn(r, k) += 60;
    });
    return calibrate_physics(input, {}, silent_progress()).physics.at(0).warnings;
  };
  const auto doubt = ::testing::Contains(::testing::HasSubstr("are listed as defects"));
  EXPECT_THAT(warnings(8), doubt);                   // 1 of 64
  EXPECT_THAT(warnings(16), ::testing::Not(doubt));  // 1 of 256
}

// Student's t of 5 degrees of freedom, of deviation 1.
double heavy_tailed(std::uint64_t draw) {
  double squares = 0;
  for (std::uint32_t k = 1; k <= 5; ++k)
    squares += std::pow(testing::internal::normal_at(5, draw, k), 2);
  return testing::internal::normal_at(5, draw, 0) / std::sqrt(squares / 5) * std::sqrt(0.6);
}

// Read noise of 3 DN, and of five times that in the pixels of every 16th row and column.
CalibrationInput heavy_tailed_session(int rows, int frames) {
  testing::SimulatedCamera camera = narrow_camera(0.01, 0.3);
  camera.rows = rows;
  camera.cols = 256;
  camera.bias_frames = frames;
  camera.flat_levels = 0;
  camera.rounded = false;
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int i) {
    for (int r = 0; r < frame.dn.rows(); ++r)
      for (int c = 0; c < frame.dn.cols(); ++c) {
        const auto draw = (static_cast<std::uint64_t>(i) << 40) +
                          (static_cast<std::uint64_t>(r) << 20) + static_cast<std::uint64_t>(c);
        const double sd_dn = r % 16 == 8 && c % 16 == 8 ? 15.0 : 3.0;
        frame.dn(r, c) =
            std::round(frame.dn(r, c) + static_cast<float>(sd_dn * heavy_tailed(draw)));
      }
  });
  return input;
}

// The tail of the fitted law falls faster than that of a t distribution: 19 sound pixels of 65536
// were listed for one far value each. One pixel of five times the noise of 256 may be missed.
TEST(Defects, OneFarValueMakesNoPixelNoisy) {
  const std::vector<DefectPixel> defects =
      calibrate_physics(heavy_tailed_session(256, 20), {}, silent_progress()).defects;
  const auto noisy = std::count_if(defects.begin(), defects.end(), [](const DefectPixel& pixel) {
    return pixel.row % 16 == 8 && pixel.col % 16 == 8;
  });
  EXPECT_GE(noisy, 255);
  EXPECT_LE(static_cast<std::ptrdiff_t>(defects.size()) - noisy, 2);
}

// Means and squares of the others, worked out from the values themselves.
TEST(Defects, APixelMustStandOutWithoutItsFarthestValue) {
  constexpr int kFrames = 8;
  const std::array<std::array<float, kFrames>, 3> pixels{{{0, 9, 60, -4, 3, 2, -7, 1},
                                                          {40, 9, 60, -44, 3, -52, -7, 1},
                                                          {61, 59, 90, 60, 63, 62, 57, 61}}};
  Image mean(16, 16), squares(16, 16);
  std::vector<Image> frames(kFrames, Image(16, 16));
  for (int r = 0; r < 16; ++r)
    for (int c = 0; c < 16; ++c) {
      for (int i = 0; i < kFrames; ++i) {
        const auto k = static_cast<std::size_t>(i);
        const int place = 16 * r + c;
        frames[k](r, c) = r == 5 && c < 3
                              ? pixels[static_cast<std::size_t>(c)][k]
                              : static_cast<float>(
                                    3 * testing::internal::normal_at(
                                            2, static_cast<std::uint64_t>(kFrames * place + i), 0));
        mean(r, c) += frames[k](r, c) / kFrames;
      }
      for (const Image& frame : frames) squares(r, c) += std::pow(frame(r, c) - mean(r, c), 2.0F);
    }
  const MosaicGeometry geometry(SensorLayout::named("mono"), 16, 16, 1);
  DarkPixels dark{
      .shading_dn = mean, .sum_of_squares = squares, .frames = kFrames, .constancy = {0.0}};
  ASSERT_EQ(find_defects(dark, {}, geometry).found, 3);
  FarthestValues farthest(dark, geometry);
  for (const Image& frame : frames) farthest.add(frame, {0.0});
  dark.farthest = farthest.release();
  const std::vector<DefectPixel> defects = find_defects(dark, {}, geometry).listed;
  ASSERT_EQ(defects.size(), 2u);  // not the one of a single value
  EXPECT_EQ(defects[0].col, 1);
  EXPECT_EQ(defects[0].kind, "noisy");
  EXPECT_EQ(defects[1].col, 2);
  EXPECT_EQ(defects[1].kind, "hot");
}

// A black level that moves from frame to frame is no part of a pixel's value.
TEST(Defects, TheFarthestValueIsThatAboveItsFramesDrift) {
  Image mean(2, 2), squares(2, 2);
  const MosaicGeometry geometry(SensorLayout::named("mono"), 2, 2, 1);
  squares(1, 1) = 1e6F;
  for (const int c : {0, 1}) squares(0, c) = 6;
  squares(1, 0) = 6;
  FarthestValues farthest(
      {.shading_dn = mean, .sum_of_squares = squares, .frames = 6, .constancy = {0.0}}, geometry);
  Image frame(2, 2);
  for (const float drift : {0.0F, 50.0F, -70.0F}) {
    frame(1, 1) = drift == 0 ? 40.0F : drift;
    farthest.add(frame, {drift});
  }
  const std::vector<FarthestValue> values = farthest.release();
  ASSERT_EQ(values.size(), 1u);
  EXPECT_EQ(values[0].above_mean_dn, 40.0);
}

// Two frames leave one without the farthest value, which tells nothing.
TEST(Defects, OfFewFramesTheFarthestValueCounts) {
  Image mean(16, 16), squares(16, 16);
  for (float& v : squares.values()) v = 9;
  squares(3, 3) = 9000;
  const MosaicGeometry geometry(SensorLayout::named("mono"), 16, 16, 1);
  const DarkPixels dark{
      .shading_dn = mean, .sum_of_squares = squares, .frames = 2, .constancy = {0.0}};
  EXPECT_TRUE(FarthestValues(dark, geometry).release().empty());
  EXPECT_EQ(find_defects(dark, {}, geometry).found, 1);
}

// The list of a large sensor ended with the first channels, and none was long enough to be doubted.
TEST(Defects, ALongListHoldsTheWorstOfAllChannels) {
  constexpr int kSide = 640;
  Image mean(kSide, kSide), squares(kSide, kSide, 9.0F);
  const MosaicGeometry geometry(SensorLayout::named("polar-mono"), kSide, kSide, 1);
  std::int64_t hot = 0;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) {
      mean(r, c) = static_cast<float>((r * 7 + c * 3) % 5 - 2);
      if ((r / 2 + 3 * (c / 2)) % 10 < 3) mean(r, c) += 200.0F + static_cast<float>(hot++ % 1000);
    }
  const DarkPixels dark{.shading_dn = mean,
                        .sum_of_squares = squares,
                        .frames = 2,
                        .constancy = std::vector<double>(4, 0.0)};
  const FoundDefects defects = find_defects(dark, {}, geometry);
  EXPECT_EQ(defects.found, hot);
  ASSERT_GT(hot, 100000);
  ASSERT_EQ(defects.listed.size(), most_defects(geometry));
  ASSERT_EQ(defects.listed.size(), 100000u);
  std::array<int, 4> of_channel{};
  int before = 0;
  float lowest = 1e9F;
  for (const DefectPixel& defect : defects.listed) {
    const int channel = geometry.channel(defect.row, defect.col);
    EXPECT_GE(channel, before);
    before = channel;
    ++of_channel[static_cast<std::size_t>(channel)];
    lowest = std::min(lowest, mean(defect.row, defect.col));
  }
  for (const int count : of_channel) EXPECT_NEAR(count, 25000, 500);
  EXPECT_NEAR(lowest, 200 + 1000.0 * static_cast<double>(hot - 100000) / static_cast<double>(hot),
              10);
  EXPECT_EQ(most_defects(MosaicGeometry(SensorLayout(), 8000, 6000, 1)), 960000u);
  EXPECT_EQ(most_defects(MosaicGeometry(SensorLayout(), 10000, 15000, 1)), 1000000u);
}

// Lost columns, a fiftieth of the pixels: λ was 8 stated errors too small, sigma_TL 3 % (2.4).
TEST(Defects, ConstantPixelsAreNoPartOfTheNoisesShape) {
  testing::SimulatedCamera camera = testing::mono_camera(0.4, 0.14, 1.0, 0.3, 6);
  camera.rows = camera.cols = 128;
  camera.flat_levels = 3;
  CalibrationInput input = testing::simulated_session(camera);
  testing::change_frames(input, [](RawFrame& frame, int) {
    for (const int c : {17, 50, 51})
      for (int r = 0; r < 128; ++r) frame.dn(r, c) = 80;
  });
  const PhysicsCalibration p = calibrate_physics(input, {}, silent_progress()).physics.at(0);
  const double truth = camera.gains[0].noise.channels[0].sigma_tl_dn;
  EXPECT_NEAR(p.lambda.mean[0], 0.14, 3 * p.lambda.standard_error[0]);
  EXPECT_NEAR(p.sigma_tl.mean[0], truth, 3 * p.sigma_tl.standard_error[0]);
}

}  // namespace
}  // namespace malus
