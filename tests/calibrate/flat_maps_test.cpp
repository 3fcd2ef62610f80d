// Maps of the flats that are all noise, or made of known parts.
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/gain_map.h"
#include "malus/calibrate/internal/response.h"
#include "malus/calibrate/internal/response_checks.h"

#include <cmath>
#include <utility>
#include <vector>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Levels close to each other hardly tell a bend, whose error is one of all blocks. Of healthy
// cameras with five such levels seven gains in a thousand were said to differ; 20000 have none now.
TEST(GainMap, OfFewBrightLevelsIsNone) {
  constexpr int kSessions = 4000;
  constexpr double kError = 0.0255;  // of 1024 pixels, four frames
  RandomSequence random(5, 0, Draw::kScene);
  int told = 0;
  for (int session = 0; session < kSessions; ++session) {
    std::vector<GainBlocks> levels;
    for (const double share : {0.45, 0.5, 0.55, 0.6, 0.65}) {
      GainBlocks level;
      level.frames = 4;
      level.mean_dn = share * 4031;
      level.light_variance_dn2 = 0.4 * level.mean_dn;
      for (int b = 0; b < 16; ++b) {
        const double x = (b % 4 - 1.5) / 2, y = (b / 4 - 1.5) / 2;
        level.light.push_back((1 - 0.15 * (x * x + y * y)) / (1 - 0.15 * 0.625));
        level.gain.push_back(1 + kError * random.normal());
        level.gain_stderr.push_back(kError);
      }
      levels.push_back(std::move(level));
    }
    PhysicsCalibration out;
    warn_of_gain_map(levels, {}, out);
    told += out.warnings.empty() ? 0 : 1;
  }
  EXPECT_EQ(told, 0);
}

TEST(ResponsePattern, IsWhatItIsMadeOf) {
  constexpr int kSize = 128;
  constexpr double kWhite = 0.01, kPeriodic = 0.008;
  const MosaicGeometry geometry(SensorLayout(), kSize, kSize, 1);
  Response response{testing::white_noise(kSize, kSize, 2, 0, kWhite), {0}, {0}};
  response.prnu[0] = std::hypot(kWhite, kPeriodic);
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c)
      response.map(r, c) += static_cast<float>(1 + (c % 2 ? kPeriodic : -kPeriodic));
  const ResponsePattern found = response_pattern(response, geometry);
  EXPECT_EQ(found.period, 2);
  EXPECT_NEAR(found.periodic, kPeriodic * kPeriodic, 0.05 * kPeriodic * kPeriodic);
  EXPECT_LT(std::abs(found.neighbours), 4 * found.neighbours_stderr);
}

// Maps that are all noise, of which the PRNU that is left is little: what chance makes repeat was
// told of one in a hundred.
TEST(ResponsePattern, OfNoiseAloneIsNotTold) {
  constexpr int kSize = 64, kMaps = 400;
  const MosaicGeometry geometry(SensorLayout(), kSize, kSize, 1);
  int told = 0;
  for (std::uint32_t seed = 0; seed < kMaps; ++seed) {
    Response response{testing::white_noise(kSize, kSize, seed, 3, 0.06), {0.003}, {0.002}};
    for (float& v : response.map.values()) v += 1;
    PhysicsCalibration out;
    warn_of_response(response_pattern(response, geometry), SensorLayout(), out);
    for (const std::string& line : out.warnings) told += line.find("repeat") != std::string::npos;
  }
  EXPECT_EQ(told, 0);
}

// So was that of rows whose noise is left in the map, of which few are of one place modulo 4: 323
// of these 400.
TEST(ResponsePattern, OfRowsThatDifferIsNotTold) {
  constexpr int kRows = 112, kCols = 84;
  constexpr std::uint32_t kMaps = 400;
  const MosaicGeometry geometry(SensorLayout(), kRows, kCols, 1);
  int told = 0;
  for (std::uint32_t seed = 0; seed < kMaps; ++seed) {
    Response response{testing::white_noise(kRows, kCols, seed, 4, 0.04), {0.004}, {0.004}};
    const Image rows = testing::white_noise(kRows, 1, seed, 5, 0.03);
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c) response.map(r, c) += 1 + rows(r, 0);
    PhysicsCalibration out;
    warn_of_response(response_pattern(response, geometry), SensorLayout(), out);
    for (const std::string& line : out.warnings) told += line.find("repeat") != std::string::npos;
  }
  EXPECT_EQ(told, 0);
}

// Masked lines lie side by side: the response of neighbours was said to be alike.
TEST(ResponsePattern, OfPixelsWithoutLightIsNotTold) {
  constexpr int kSize = 128, kMasked = 24;
  constexpr double kPrnu = 0.01;
  const MosaicGeometry geometry(SensorLayout(), kSize, kSize, 1);
  Response response{testing::white_noise(kSize, kSize, 2, 0, kPrnu), {kPrnu}, {0}};
  for (int r = kMasked; r < kSize; ++r)
    for (int c = kMasked; c < kSize; ++c) response.map(r, c) += 1;
  const ResponsePattern found = response_pattern(response, geometry);
  EXPECT_LT(std::abs(found.neighbours), 4 * found.neighbours_stderr);
  PhysicsCalibration out;
  warn_of_response(found, SensorLayout(), out);
  EXPECT_TRUE(out.warnings.empty());
}

// PRNU in a light of this place, from -1 to 1 down and across.
template <class Light>
double prnu_in(const char* layout, int rows, int cols, double prnu, const Light& light) {
  const MosaicGeometry geometry(SensorLayout::named(layout), rows, cols, 1);
  const auto channels = static_cast<std::size_t>(geometry.channels());
  constexpr double kShot = 0.005;
  TemporalAccumulator flat(geometry, std::vector<double>(channels, 0.0),
                           FrameAlignment::kMultiplicative);
  const Image response = testing::white_noise(rows, cols, 11, 0, prnu);
  for (std::uint32_t frame = 1; frame <= 4; ++frame) {
    Image dn = testing::white_noise(rows, cols, 11, frame, kShot);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const double own = light(2.0 * r / (rows - 1) - 1, 2.0 * c / (cols - 1) - 1);
        dn(r, c) =
            static_cast<float>(1000 * (own * (1 + response(r, c)) + std::sqrt(own) * dn(r, c)));
      }
    flat.add(dn);
  }
  ResponseAccumulator sum(geometry);
  const Image dark(rows, cols);
  sum.add(flat, {.shading_dn = dark,
                 .error_dn2 = std::vector<double>(channels, 0.0),
                 .doubt_dn2 = std::vector<double>(channels, 0.0)});
  return mean_of(sum.response({std::vector<double>(channels, 0.0), {}}).prnu);
}

// Light that is no polynomial of low degree was PRNU: of 1 % it made 1.51, 1.50, 2.4 and 2.3 %.
// Even light loses nothing to more terms. Four standard errors of 4096 pixels, or of 1024.
TEST(LightPolynomial, TakesLightOfAnyShapeAndNoResponse) {
  constexpr double kPi = 3.14159265358979;
  const auto cosine = [](double y, double) { return 1 - 0.3 * (1 - std::cos(kPi * y)); };
  const auto spot = [](double y, double x) { return 0.5 + 0.5 * std::exp(-4 * (x * x + y * y)); };
  const auto even = [](double, double) { return 1.0; };
  for (const double prnu : {0.01, 0.03}) {
    const double off = 4 * prnu / std::sqrt(2.0 * 4096);
    EXPECT_NEAR(prnu_in("mono", 16, 256, prnu, cosine), prnu, off);
    EXPECT_NEAR(prnu_in("mono", 8, 512, prnu, cosine), prnu, off);
    EXPECT_NEAR(prnu_in("mono", 16, 256, prnu, spot), prnu, off);
    EXPECT_NEAR(prnu_in("mono", 64, 64, prnu, spot), prnu, off);
    EXPECT_NEAR(prnu_in("mono", 64, 64, prnu, even), prnu, off);
    EXPECT_NEAR(prnu_in("polar-bayer-rggb", 64, 64, prnu, even), prnu, off);
    EXPECT_NEAR(prnu_in("polar-bayer-rggb", 32, 32, prnu, even), prnu, 2 * off);
  }
}

// A fifth of the sensor without light had made PRNU 0, or thousands of per cent. Four standard
// errors of the 3200 pixels that see light.
TEST(UnlitLines, TakeNoPartInPrnu) {
  constexpr double kPrnu = 0.01;
  const double off = 4 * kPrnu / std::sqrt(2.0 * 3200);
  const auto falling = [](double y, double x) { return 1 - 0.2 * (x * x + y * y); };
  const auto columns = [&](double y, double x) { return x < -0.6 ? 0 : falling(y, x); };
  const auto rows = [&](double y, double x) { return y > 0.6 ? 0 : falling(y, x); };
  for (const char* layout : {"mono", "polar-mono"}) {
    EXPECT_NEAR(prnu_in(layout, 64, 64, kPrnu, columns), kPrnu, off);
    EXPECT_NEAR(prnu_in(layout, 64, 64, kPrnu, rows), kPrnu, off);
  }
}

}  // namespace
}  // namespace malus
