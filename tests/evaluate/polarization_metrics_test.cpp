#include "malus/evaluate/polarization_metrics.h"

#include "malus/evaluate/evaluation.h"
#include "malus/evaluate/image_metrics.h"
#include "malus/image/pack.h"
#include "malus/polar/stokes.h"

#include <cmath>
#include <fstream>
#include <string>

#include <gtest/gtest.h>

namespace malus {
namespace {

StokesPlanes pixel(double s0, double dolp, double aolp_deg) {
  const double twice = aolp_deg * std::numbers::pi / 90;
  return {Image(1, 1, static_cast<float>(s0)),
          Image(1, 1, static_cast<float>(s0 * dolp * std::cos(twice))),
          Image(1, 1, static_cast<float>(s0 * dolp * std::sin(twice)))};
}

PolarizationError error_of(std::vector<StokesPlanes> reference, std::vector<StokesPlanes> test) {
  return polarization_error(reference, test);
}

TEST(AxisDistance, LivesOnTheCircleOf180Degrees) {
  EXPECT_DOUBLE_EQ(axis_distance_deg(179, 1), 2);
  EXPECT_DOUBLE_EQ(axis_distance_deg(1, 179), 2);
  EXPECT_DOUBLE_EQ(axis_distance_deg(0, 90), 90);
  EXPECT_DOUBLE_EQ(axis_distance_deg(10, 120), 70);
  EXPECT_DOUBLE_EQ(axis_distance_deg(0, 180), 0);
}

TEST(PolarizationMetrics, LinearPunishesTheWrapCircularDoesNot) {
  const auto e = error_of({pixel(10, 0.5, 1)}, {pixel(10, 0.5, 179)});
  EXPECT_NEAR(*aolp_circular_deg(e), 2, 1e-4);
  EXPECT_NEAR(*aolp_psnr_db(e), -20 * std::log10(178.0 / 180), 1e-4);
}

TEST(PolarizationMetrics, CircularErrorIsWeightedByTheReferencesDolp) {
  const auto e =
      error_of({pixel(10, 0.6, 30), pixel(10, 0.2, 30)}, {pixel(10, 0.9, 40), pixel(10, 0.1, 60)});
  EXPECT_NEAR(*aolp_circular_deg(e), std::sqrt((0.6 * 100 + 0.2 * 900) / 0.8), 1e-3);
  EXPECT_NEAR(*aolp_psnr_db(e), -10 * std::log10((100.0 + 900.0) / 2 / (180.0 * 180.0)), 1e-3);
  EXPECT_NEAR(*dolp_psnr_db(e), -10 * std::log10((0.09 + 0.01) / 2), 1e-4);
}

TEST(PolarizationMetrics, DolpIsHeldToItsRangeAndLostLightCountsAsZero) {
  EXPECT_NEAR(*dolp_psnr_db(error_of({pixel(10, 0.5, 0)}, {pixel(10, 7, 0)})),
              -20 * std::log10(0.5), 1e-5)
      << "7 counts as 1";
  const auto dark = error_of({pixel(10, 0.5, 20)}, {pixel(-10, -0.5, 20)});
  EXPECT_NEAR(*dolp_psnr_db(dark), -20 * std::log10(0.5), 1e-5) << "counts as 0";
  EXPECT_NEAR(*aolp_circular_deg(dark), 0, 1e-4) << "the direction is still there";
}

TEST(PolarizationMetrics, PixelsWithoutAReferenceAreLeftOut) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto e = error_of({pixel(0, 1, 0), pixel(10, 0.5, 0), pixel(nan, 1, 0)},
                          {pixel(5, 1, 0), pixel(10, 0.5, 0), pixel(5, 1, 0)});
  EXPECT_EQ(e.dolp_count, 1);
  EXPECT_FALSE(dolp_psnr_db(error_of({pixel(-1, 1, 0)}, {pixel(1, 1, 0)})).decided());
  const auto unpolarized = error_of({pixel(10, 0, 0)}, {pixel(10, 0.3, 50)});
  EXPECT_FALSE(aolp_psnr_db(unpolarized).decided());
  EXPECT_FALSE(aolp_circular_deg(unpolarized).decided());
  EXPECT_NEAR(*dolp_psnr_db(unpolarized), -20 * std::log10(0.3), 1e-5);
}

// A uniform scene against itself turned by 10 degrees, through mosaics of every layout.
TEST(EvaluateMosaics, EveryLayout) {
  for (const auto& name : SensorLayout::known_names()) {
    const auto layout = SensorLayout::named(name);
    Image reference(48, 52), test(48, 52);
    for (int r = 0; r < 48; ++r)
      for (int c = 0; c < 52; ++c) {
        const int angle = layout.site(layout.channel_at(r, c)).angle_deg.value_or(0);
        const auto light = [&](double aolp_deg) {
          const double twice = aolp_deg * std::numbers::pi / 90;
          return intensity_behind({1000, 400 * std::cos(twice), 400 * std::sin(twice)}, angle);
        };
        reference(r, c) = static_cast<float>(light(20));
        test(r, c) = static_cast<float>(light(30));
      }
    const Evaluation e = evaluate_mosaics(reference, test, layout, 4095);
    ASSERT_TRUE(e.image_psnr_db.decided() && e.image_ssim.decided()) << name;
    EXPECT_EQ(e.aolp_circular_deg.decided(), layout.polarized()) << name;
    EXPECT_EQ(quantities_of(e).size(), layout.polarized() ? 5u : 2u) << name;
    if (!layout.polarized()) continue;
    EXPECT_NEAR(*e.aolp_circular_deg, 10, 1e-3) << name;
    EXPECT_NEAR(*e.aolp_psnr_db, 20 * std::log10(18), 1e-3) << name;
    EXPECT_GT(*e.dolp_psnr_db, 100) << name;
  }
}

// One wrong pixel, wherever it lies: the mean squared error is its square over all pixels.
TEST(EvaluateMosaics, EveryPixelCountsOnceInPsnrAlsoInCellsThatTheEdgeCuts) {
  for (const auto& name : SensorLayout::known_names()) {
    const auto layout = SensorLayout::named(name);
    const int rows = 9, cols = 7, cells = (rows / layout.rows()) * (cols / layout.cols());
    const Image reference(rows, cols, 100.0f);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        Image test = reference;
        test(r, c) = 110;
        const Evaluation e = evaluate_mosaics(reference, test, layout, 10);
        ASSERT_NEAR(*e.image_psnr_db, 10 * std::log10(rows * cols), 1e-9) << name << r << ' ' << c;
        test(r, c) = std::numeric_limits<float>::quiet_NaN();
        ASSERT_EQ(evaluate_mosaics(reference, test, layout, 10).pixels_left_out, 1) << name;
        if (!layout.polarized()) continue;
        // The changed angle's colour has S0 = 410 / 2 and S1 or S2 = 10 in one cell.
        const bool whole =
            r < rows / layout.rows() * layout.rows() && c < cols / layout.cols() * layout.cols();
        const double colors = layout.channels() / 4.0, dolp = 10 / 205.0;
        if (whole)
          ASSERT_NEAR(*e.dolp_psnr_db, 10 * std::log10(cells * colors / (dolp * dolp)), 1e-4)
              << name << r << ' ' << c;
        else
          ASSERT_TRUE(std::isinf(*e.dolp_psnr_db)) << name << r << ' ' << c;
      }
  }
}

Image light_of(int rows, int cols, double phase) {
  Image light(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      light(r, c) = static_cast<float>(1000 + 300 * std::sin(r / 7.0 + phase) * std::cos(c / 5.0));
  return light;
}

// DoLP and AoLP are taken in bands of rows.
TEST(EvaluateMosaics, ATallMosaicIsThatOfItsPlanes) {
  for (const char* name : {"polar-mono", "polar-bayer-rggb"}) {
    const auto layout = SensorLayout::named(name);
    const Image reference = light_of(2400, 48, 0), test = light_of(2400, 48, 0.1);
    const Evaluation e = evaluate_mosaics(reference, test, layout, 4095);
    const Planes a = pack(reference, layout), b = pack(test, layout);
    const PolarizationError whole =
        polarization_error(stokes_per_color(a, layout), stokes_per_color(b, layout));
    EXPECT_NEAR(*e.dolp_psnr_db, *dolp_psnr_db(whole), 1e-9) << name;
    EXPECT_NEAR(*e.aolp_psnr_db, *aolp_psnr_db(whole), 1e-9) << name;
    EXPECT_NEAR(*e.aolp_circular_deg, *aolp_circular_deg(whole), 1e-9) << name;
    EXPECT_DOUBLE_EQ(*e.image_ssim, *ssim(a, b, 4095)) << name;
  }
}

// The most memory that the process held, in bytes; 0 where the system does not tell.
double most_memory() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmHWM:")) return 1024 * std::stod(line.substr(6));
  return 0;
}

TEST(EvaluateMosaics, ALargeFrameIsNotHeldOnceMore) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers keep freed memory";
#endif
  const Image reference = light_of(2048, 4096, 0), test = light_of(2048, 4096, 0.1);
  const double frame = 4.0 * static_cast<double>(reference.size());
  for (const char* name : {"polar-mono", "polar-bayer-rggb"}) {
    std::ofstream("/proc/self/clear_refs") << 5;  // what was held before is forgotten
    const double before = most_memory();
    if (before == 0) GTEST_SKIP() << "this system does not tell";
    evaluate_mosaics(reference, test, SensorLayout::named(name), 4095);
    EXPECT_LT(most_memory() - before, 0.75 * frame) << name;
  }
}

}  // namespace
}  // namespace malus
