#include "malus/noise/data_sheet.h"

#include <cmath>
#include <numbers>
#include <random>

#include <gtest/gtest.h>

namespace malus {
namespace {

const Quantity& named(const std::vector<Quantity>& sheet, const std::string& name) {
  for (const Quantity& quantity : sheet)
    if (quantity.name == name) return quantity;
  throw std::logic_error("no " + name);
}

NoiseModel sensor_of_4000_dn() {
  NoiseModel model;
  model.black_dn = {95};
  model.white_dn = 4095;
  return model;
}

TEST(DataSheet, FollowsTheStandardsFormulas) {
  const NoiseModel model = sensor_of_4000_dn();
  PhysicsCalibration p;
  p.K.mean = {0.5};
  p.K.standard_error = {0.005};
  p.temporal_sd_dark_dn = {2.0};
  p.temporal_sd_dark_stderr_dn = {0.03};
  p.dsnu_dn = {0.5};
  p.dsnu_stderr_dn = {0.02};
  p.prnu = {0.012};
  p.prnu_stderr = {0.0003};
  const auto sheet = data_sheet(model, p);
  // σ_q² = 1/12 DN² is no noise of the sensor.
  const double dark = std::sqrt(4 - 1.0 / 12) / 0.5;
  EXPECT_DOUBLE_EQ(named(sheet, "temporal_dark_noise").value[0], dark);
  // Relative errors add in squares: those of the variance without σ_q² and 1 %.
  EXPECT_NEAR(named(sheet, "temporal_dark_noise").standard_error[0],
              dark * std::hypot(2 * 0.03 / (4 - 1.0 / 12), 0.01), 1e-12);
  EXPECT_DOUBLE_EQ(named(sheet, "saturation").value[0], 8000);
  EXPECT_DOUBLE_EQ(named(sheet, "dsnu").value[0], 1);
  EXPECT_NEAR(named(sheet, "dsnu").standard_error[0], std::hypot(0.02 / 0.5, 0.01), 1e-12);
  EXPECT_DOUBLE_EQ(named(sheet, "prnu").value[0], 1.2);
  EXPECT_DOUBLE_EQ(named(sheet, "prnu").standard_error[0], 0.03);
  const double threshold = std::sqrt(16.25) + 0.5;
  EXPECT_DOUBLE_EQ(named(sheet, "threshold").value[0], threshold);
  EXPECT_NEAR(named(sheet, "dynamic_range").value[0], 20 * std::log10(8000 / threshold), 1e-12);
  EXPECT_NEAR(named(sheet, "snr_max").value[0], 20 * std::log10(std::sqrt(8000.0)), 1e-12);
  EXPECT_TRUE(std::isnan(named(sheet, "linearity_error").value[0]));
}

// With 2 DN of noise in the dark, all without error.
PhysicsCalibration half_a_dn_per_electron() {
  PhysicsCalibration p;
  p.K.mean = {0.5};
  p.K.standard_error = {0};
  p.temporal_sd_dark_dn = {2.0};
  return p;
}

// What a pixel can tell of light begins at the dark signal, whatever black level was declared.
TEST(DataSheet, TheDarkSignalIsNoLight) {
  NoiseModel model = sensor_of_4000_dn();
  PhysicsCalibration p = half_a_dn_per_electron();
  for (const double declared_black_dn : {0.0, 95.0, 100.0}) {
    model.black_dn = {declared_black_dn};
    p.mu.mean = {95 - declared_black_dn};
    const auto sheet = data_sheet(model, p);
    EXPECT_DOUBLE_EQ(named(sheet, "saturation").value[0], 8000) << declared_black_dn;
    EXPECT_NEAR(named(sheet, "dynamic_range").value[0],
                20 * std::log10(8000 / (std::sqrt(16.25) + 0.5)), 1e-12);
    EXPECT_NEAR(named(sheet, "snr_max").value[0], 10 * std::log10(8000), 1e-12);
  }
}

TEST(DataSheet, FullWellIsWhereTheVarianceFallsNotWhite) {
  const NoiseModel model = sensor_of_4000_dn();
  PhysicsCalibration p = half_a_dn_per_electron();
  p.transfer.resize(3);
  p.transfer[0].mean_dn = 2400;
  p.transfer[1].mean_dn = 2500;
  p.transfer[2].mean_dn = 2501;
  p.transfer[1].saturated = p.transfer[2].saturated = true;
  const auto sheet = data_sheet(model, p);
  EXPECT_DOUBLE_EQ(named(sheet, "saturation").value[0], 5000);
  EXPECT_NEAR(named(sheet, "dynamic_range").value[0],
              20 * std::log10(5000 / (std::sqrt(16.25) + 0.5)), 1e-12);
}

// Red and blue get less light than green, so their flats end before the full well that the greens
// show: their own may be anything up to white, which is not theirs to claim.
TEST(DataSheet, WhiteIsNoFullWellWhereAnotherChannelsLiesBelowIt) {
  NoiseModel model = sensor_of_4000_dn();
  model.layout = SensorLayout::named("bayer-rggb");
  model.black_dn = {95, 95, 95, 95};
  PhysicsCalibration p;
  p.K.mean = {0.5, 0.5, 0.5, 0.5};
  p.K.standard_error = {0, 0, 0, 0};
  p.temporal_sd_dark_dn = {2, 2, 2, 2};
  p.transfer.resize(4);
  for (int channel = 0; channel < 4; ++channel) {
    p.transfer[static_cast<std::size_t>(channel)].channel = channel;
    p.transfer[static_cast<std::size_t>(channel)].mean_dn = channel == 1 ? 2500 : 1200;
  }
  EXPECT_DOUBLE_EQ(named(data_sheet(model, p), "saturation").value[0], 8000);
  p.transfer[1].saturated = true;
  p.transfer[3].at_white = true;
  const auto sheet = data_sheet(model, p);
  EXPECT_DOUBLE_EQ(named(sheet, "saturation").value[1], 5000);
  EXPECT_DOUBLE_EQ(named(sheet, "saturation").value[3], 8000);
  for (const char* name : {"saturation", "dynamic_range", "snr_max"})
    for (const std::size_t unknown : {0U, 2U})
      EXPECT_TRUE(std::isnan(named(sheet, name).value[unknown])) << name;
  EXPECT_DOUBLE_EQ(named(sheet, "threshold").value[0], std::sqrt(16.25) + 0.5);
}

// Rounded normal noise of 0.8 DN has a variance of 0.64 + 1/12 DN².
TEST(DataSheet, DarkNoiseIsThatOfTheSensorAndNotOfTheStep) {
  NoiseModel model = sensor_of_4000_dn();
  PhysicsCalibration p;
  p.K.mean = {0.5};
  p.K.standard_error = {0};
  p.temporal_sd_dark_stderr_dn = {0.01};
  const auto dark = [&](double variance_dn2, double step_dn) {
    model.quantization_dn = step_dn;
    p.temporal_sd_dark_dn = {std::sqrt(variance_dn2)};
    return named(data_sheet(model, p), "temporal_dark_noise");
  };
  EXPECT_NEAR(dark(0.64 + 1.0 / 12, 1).value[0], 1.6, 1e-12);
  EXPECT_NEAR(dark(256 * (0.64 + 1.0 / 12), 16).value[0], 16 * 1.6, 1e-12);
  EXPECT_NEAR(dark(0.64, 0).value[0], 1.6, 1e-12);
  // Below 0.24 DN² the standard gives the limit. Light must top it too.
  for (const double variance : {0.0, 0.05, 0.2399}) {
    EXPECT_NEAR(dark(variance, 1).value[0], std::sqrt(0.24 - 1.0 / 12) / 0.5, 1e-12);
    EXPECT_TRUE(std::isnan(dark(variance, 1).standard_error[0]));
    const double threshold = std::sqrt(0.24 / 0.25 + 0.25) + 0.5;
    const auto sheet = data_sheet(model, p);
    EXPECT_NEAR(named(sheet, "threshold").value[0], threshold, 1e-12);
    EXPECT_NEAR(named(sheet, "dynamic_range").value[0], 20 * std::log10(8000 / threshold), 1e-9);
  }
}

std::vector<PhotonTransferPoint> ladder(const std::function<double(double)>& signal) {
  std::vector<PhotonTransferPoint> points;
  for (int i = 1; i <= 10; ++i) {
    PhotonTransferPoint point;
    point.exposure_s = 0.01 * i;
    point.mean_dn = signal(point.exposure_s);
    points.push_back(point);
  }
  return points;
}

TEST(LinearityError, IsZeroForALineAndKnownForAnAlternatingDeviation) {
  EXPECT_NEAR(linearity_error_percent(ladder([](double t) { return 5 + 3000 * t; }), 0, 4000), 0,
              1e-9);
  int sign = 1;
  const auto alternating =
      ladder([&](double t) { return 30000 * t * (1 + 0.02 * (sign = -sign)); });
  // The line follows a small part of the alternation itself.
  EXPECT_NEAR(linearity_error_percent(alternating, 0, 4000), 2, 0.15);
}

// Bright levels lose what white cuts off, long before their mean is at 95 %.
TEST(LinearityError, IsNotOfLevelsAtWhite) {
  auto points = ladder([](double t) { return 36000 * t; });
  points.back().mean_dn = 3500;  // of 3600
  EXPECT_GT(linearity_error_percent(points, 0, 4000), 0.3);
  points.back().at_white = true;
  EXPECT_NEAR(linearity_error_percent(points, 0, 4000), 0, 1e-9);
}

// EMVA 1288 counts 5 to 95 % of saturation; what bends outside is no error.
TEST(LinearityError, CountsFiveToNinetyFivePercent) {
  for (const auto& [share, counts] :
       {std::pair{0.045, false}, {0.055, true}, {0.945, true}, {0.955, false}}) {
    auto points = ladder([](double t) { return 20000 * t + 1000; });
    points.front().mean_dn = share * 4000;
    points.front().exposure_s = 1.3 * (points.front().mean_dn - 1000) / 20000 + 0.2;
    EXPECT_EQ(linearity_error_percent(points, 0, 4000) > 0.1, counts) << share;
  }
}

// Two settings of a lamp at every exposure: 27 % was said of a straight camera.
TEST(LinearityError, IsNotKnownWhereLevelsOfOneExposureDiffer) {
  for (const double second_lamp : {1.7, 1.25, 1.03}) {
    auto points = ladder([](double t) { return 5 + 20000 * t; });
    for (auto point : ladder([&](double t) { return 5 + second_lamp * 20000 * t; }))
      points.push_back(point);
    EXPECT_FALSE(exposure_tells_light(points, 0, 4000)) << second_lamp;
    EXPECT_TRUE(std::isnan(linearity_error_percent(points, 0, 4000))) << second_lamp;
  }
  auto steady = ladder([](double t) { return 5 + 20000 * t; });
  for (auto point : ladder([](double t) { return 1.01 * (5 + 20000 * t); }))
    steady.push_back(point);
  EXPECT_TRUE(exposure_tells_light(steady, 0, 4000));
  EXPECT_NEAR(linearity_error_percent(steady, 0, 4000), 0.5, 0.05);
}

TEST(LinearityLine, IsTheOneThatTheErrorIsMeasuredFrom) {
  const auto line = linearity_line(ladder([](double t) { return 5 + 3000 * t; }), 0, 4000);
  ASSERT_TRUE(line);
  EXPECT_NEAR(line->slope, 3000, 1e-6);
  EXPECT_NEAR(line->intercept, 5, 1e-6);
}

TEST(SignalToNoise, IsLightsOwnNoiseAndTheDarkOne) {
  EXPECT_DOUBLE_EQ(signal_to_noise(10000, 0), 100);
  EXPECT_DOUBLE_EQ(signal_to_noise(16, 3), 16.0 / 5);
}

// Three points one standard error off the line have a chi square of 3; K is the line's parameter,
// and where the dark noise is cut off so is the intercept.
TEST(TransferMisfit, CountsThePointsThatTheFitUsed) {
  PhysicsCalibration p;
  p.K.mean = {2.0};
  p.K_intercept_dn2 = {7.0};
  for (int i = 1; i <= 5; ++i) {
    PhotonTransferPoint point;
    point.mean_dn = 100 * i;
    point.variance_stderr_dn2 = i;
    point.variance_dn2 = 200 * i + (i % 2 == 0 ? i : -i);
    point.used = i <= 3;
    p.transfer.push_back(point);
  }
  EXPECT_DOUBLE_EQ(transfer_misfit(p, 0).chi_square, 3);
  EXPECT_EQ(transfer_misfit(p, 0).degrees_of_freedom, 2);
  EXPECT_EQ(transfer_misfit(p, 1).degrees_of_freedom, 0);
  p.dark_zero_share = {0.5};
  EXPECT_DOUBLE_EQ(transfer_intercept_dn2(p, 0), 7);
  for (PhotonTransferPoint& point : p.transfer) point.variance_dn2 += 7;
  EXPECT_NEAR(transfer_misfit(p, 0).chi_square, 3, 1e-9);
  EXPECT_EQ(transfer_misfit(p, 0).degrees_of_freedom, 1);
  p.cut_off_undone = true;
  EXPECT_EQ(transfer_intercept_dn2(p, 0), 0);
  p.line_intercept_dn2 = {7.0};
  EXPECT_EQ(transfer_intercept_dn2(p, 0), 7);
}

TEST(LinearityError, NeedsThreeExposuresInsideTheRange) {
  EXPECT_TRUE(
      std::isnan(linearity_error_percent(ladder([](double t) { return 40000 * t; }), 1, 4000)));
  EXPECT_TRUE(
      std::isnan(linearity_error_percent(ladder([](double t) { return 190000 * t; }), 0, 4000)));
}

TEST(Spectrum, OfASineIsOneLineOfKnownHeight) {
  // Amplitude a at k periods: |Y_k| = a N / 2, so sqrt(|Y_k|²/N) = a sqrt(N) / 2.
  Image map(6, 60);
  for (int r = 0; r < 6; ++r)
    for (int c = 0; c < 60; ++c)
      map(r, c) = static_cast<float>(2 * std::sin(2 * std::numbers::pi * 7 * c / 60 + r));
  const auto spectrum = row_spectrum(map);
  ASSERT_EQ(spectrum.size(), 31U);
  for (std::size_t k = 0; k < spectrum.size(); ++k)
    EXPECT_NEAR(spectrum[k], k == 7 ? std::sqrt(60.0) : 0, 1e-5) << k;
  EXPECT_EQ(column_spectrum(map).size(), 4U);
}

TEST(Spectrum, OfWhiteNoiseIsItsDeviation) {
  std::mt19937 engine(11);
  std::normal_distribution<float> gauss(0, 3);
  Image map(400, 250);
  for (float& value : map.values()) value = gauss(engine);
  const auto spectrum = row_spectrum(map);
  // Power is a mean of 400 exponential variables: relative error of its root 1/(2 sqrt(400)), five
  // of them allowed. The ends have half the degrees of freedom.
  for (std::size_t k = 1; k + 1 < spectrum.size(); ++k) EXPECT_NEAR(spectrum[k], 3, 5 * 3 * 0.025);
}

TEST(Spectrum, OfOneColumnIsItsRootMeanSquare) {
  Image map(2, 1);
  map.values() = {3, -4};
  EXPECT_EQ(row_spectrum(map), std::vector<double>{std::sqrt(12.5)});
  EXPECT_EQ(column_spectrum(Image(1, 2, 2.0f)), std::vector<double>{2});
  EXPECT_TRUE(row_spectrum(Image(3, 0)).empty() && row_spectrum(Image(0, 3)).empty());
}

TEST(Profiles, AreMeansOfRowsAndColumns) {
  Image map(2, 3);
  map.values() = {1, 2, 3, 5, 7, 9};
  EXPECT_EQ(row_profile(map), (std::vector<double>{2, 7}));
  EXPECT_EQ(column_profile(map), (std::vector<double>{3, 4.5, 6}));
}

}  // namespace
}  // namespace malus
