// Truth: maps of a drawn pattern with drawn sampling error.
#include "malus/noise/fixed_pattern.h"

#include "malus/base/random.h"
#include "malus/noise/model.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kRows = 200, kCols = 240, kWeakColumn = 60;
constexpr double kPatternSd = 0.006, kErrorSd = 0.004;

// The map is as far from the truth as a Wiener filter leaves it, and so is a column of four fifths
// of the response, which that filter alone would draw a third of the way to 1.
TEST(FixedPatternAt, SamplingErrorIsTakenOutOfAMapAndOutliersStay) {
  NoiseModel model;
  model.layout = SensorLayout::named("polar-mono");
  PhysicsCalibration p;
  p.prnu.assign(4, kPatternSd);
  p.prnu_map = Image(kRows, kCols);
  Image truth(kRows, kCols);
  RandomSequence random(21, 0, Draw::kUser);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      truth(r, c) = static_cast<float>(c == kWeakColumn ? 0.8 : 1 + kPatternSd * random.normal());
      p.prnu_map(r, c) = static_cast<float>(truth(r, c) + kErrorSd * random.normal());
    }
  model.physics.push_back(p);
  const auto pattern = fixed_pattern_at(model, {});
  ASSERT_TRUE(pattern);
  EXPECT_TRUE(pattern->dark_dn.empty());
  double square = 0, product = 0, size = 0, column = 0;
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      const double off = pattern->response(r, c) - 1;
      if (c == kWeakColumn) {
        column += off / kRows;
        continue;
      }
      square += std::pow(pattern->response(r, c) - truth(r, c), 2);
      product += off * (truth(r, c) - 1);
      size += off * off;
    }
  const double wiener = std::pow(std::hypot(1 / kPatternSd, 1 / kErrorSd), -2);
  EXPECT_NEAR(square / (kRows * (kCols - 1)) / wiener, 1, 0.03);  // 47800 pixels: ± 0.0065
  EXPECT_NEAR(product / size, 1, 0.02);  // how much of the map a frame shows
  EXPECT_NEAR(column, -0.2, 0.003);
  model.physics[0].prnu.clear();  // of a model that does not know it
  EXPECT_EQ(fixed_pattern_at(model, {})->response, p.prnu_map);
}

}  // namespace
}  // namespace malus
