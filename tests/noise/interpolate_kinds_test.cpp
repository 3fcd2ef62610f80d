#include "malus/noise/interpolate_kinds.h"

#include "malus/base/error.h"
#include "malus/noise/model.h"

#include <cmath>
#include <numbers>

#include "sample_model.h"
#include "support.h"

namespace malus {
namespace {

using testing::iso;
using Values = std::vector<double>;

double normal_cdf(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

// A sensor with K = iso/400 DN/e- and 2 e- of read noise before the amplifier and 0.5 DN behind it.
double true_sd(double iso_value, double signal_dn) {
  const double K = iso_value / 400.0;
  return std::sqrt(K * signal_dn + 4.0 * K * K + 0.25);
}

NonparametricCalibration gaussian_noise(double iso_value, const Values& levels,
                                        const Values& edges) {
  NonparametricChannel channel;
  channel.level_dn = levels;
  channel.bin_edges_dn = edges;
  for (double level : levels) {
    Values pmf;
    double sum = 0;
    for (std::size_t b = 0; b + 1 < channel.bin_edges_dn.size(); ++b) {
      const double sd = true_sd(iso_value, level);
      pmf.push_back(normal_cdf(channel.bin_edges_dn[b + 1] / sd) -
                    normal_cdf(channel.bin_edges_dn[b] / sd));
      sum += pmf.back();
    }
    for (double& p : pmf) p /= sum;
    channel.pmf.push_back(pmf);
    channel.samples.push_back(static_cast<std::int64_t>(200000 + iso_value));
  }
  NonparametricCalibration n;
  n.gain = iso(iso_value);
  n.frames = 50;
  n.channels = {channel};
  n.sigma_row_dn = {0.1 * iso_value / 100};
  n.K = {iso_value / 400};
  return n;
}

NonparametricCalibration gaussian_noise(double iso_value, const Values& levels, double step_dn) {
  Values edges;
  for (double edge = -40; edge <= 40; edge += step_dn) edges.push_back(edge);
  return gaussian_noise(iso_value, levels, edges);
}

// As calibration chooses them: a sixth of the dark deviation near zero, growing outwards.
Values growing_edges(double iso_value, double brightest_dn) {
  double width = true_sd(iso_value, 0) / 6;
  Values edges{0};
  for (int i = 0; edges.back() < 7 * true_sd(iso_value, brightest_dn); ++i) {
    if (i >= 42) width *= 1.05;
    edges.insert(edges.begin(), edges.front() - width);
    edges.push_back(edges.back() + width);
  }
  return edges;
}

// √JSD in bits of the interpolated level against the true Gaussian, on the interpolated bins.
double distance_to_truth(const NonparametricChannel& channel, std::size_t level, double sd) {
  double divergence = 0;
  for (std::size_t b = 0; b < channel.pmf[level].size(); ++b) {
    const double p = channel.pmf[level][b];
    const double q =
        normal_cdf(channel.bin_edges_dn[b + 1] / sd) - normal_cdf(channel.bin_edges_dn[b] / sd);
    const double m = 0.5 * (p + q);
    if (p > 0) divergence += 0.5 * p * std::log2(p / m);
    if (q > 0) divergence += 0.5 * q * std::log2(q / m);
  }
  return std::sqrt(std::max(divergence, 0.0));
}

TEST(InterpolateNonparametric, LeavesOneIsoOut) {
  const Values levels = {0, 50, 100, 200};
  const auto low = gaussian_noise(100, levels, 0.25), high = gaussian_noise(400, levels, 0.5);
  const NonparametricCalibration middle = interpolated(low, high, iso(200));
  ASSERT_EQ(middle.channels.size(), 1U);
  ASSERT_EQ(middle.channels[0].level_dn, levels);
  for (std::size_t level = 0; level < levels.size(); ++level) {
    const double sd = true_sd(200, levels[level]);
    const LevelMoments moments = level_moments(middle.channels[0], level);
    EXPECT_NEAR(moments.mean_dn, 0.0, 0.01);
    // In the dark the two kinds of read noise bend the law between ISOs a factor 4 apart.
    const double tolerance = level == 0 ? 0.10 : 0.04;
    EXPECT_NEAR(std::sqrt(moments.variance_dn2) / sd, 1.0, tolerance) << levels[level];
    const double distance = distance_to_truth(middle.channels[0], level, sd);
    EXPECT_LT(distance, tolerance) << levels[level];
    EXPECT_LT(distance, 0.3 * distance_to_truth(low.channels[0], level, sd));
  }
  EXPECT_NEAR(middle.sigma_row_dn[0], 0.2, 1e-12);
  EXPECT_NEAR(middle.K[0], 0.5, 1e-12);
  EXPECT_EQ(middle.channels[0].samples[0], 200100);
  EXPECT_EQ(middle.frames, 0);
}

// Uniform noise of widths 1 and 4: at the middle uniform of width 2.
TEST(InterpolateNonparametric, UniformStaysUniform) {
  NonparametricCalibration low, high;
  low.gain = iso(100);
  high.gain = iso(1600);
  low.channels = {{{0}, {10}, {-0.5, 0.5}, {{1.0}}}};
  high.channels = {{{0}, {10}, {-4, -2, -1, 0, 1, 2, 4}, {{0, 0.25, 0.25, 0.25, 0.25, 0}}}};
  const NonparametricChannel middle = interpolated(low, high, iso(400)).channels[0];
  EXPECT_NEAR(middle.bin_edges_dn.front(), -1.0, 1e-12);
  EXPECT_NEAR(middle.bin_edges_dn.back(), 1.0, 1e-12);
  for (std::size_t b = 0; b < middle.pmf[0].size(); ++b)
    EXPECT_NEAR(middle.pmf[0][b], 0.5 * (middle.bin_edges_dn[b + 1] - middle.bin_edges_dn[b]),
                1e-12);
}

TEST(InterpolateNonparametric, BinsThatGrowOutwardsLeaveTheDarkNoiseAsItIs) {
  const Values levels = {0, 100, 4000};
  const auto low = gaussian_noise(100, levels, growing_edges(100, 4000));
  const auto high = gaussian_noise(800, levels, growing_edges(800, 4000));
  const auto sd = [](const NonparametricCalibration& n, std::size_t level) {
    return std::sqrt(level_moments(n.channels[0], level).variance_dn2);
  };
  for (const double iso_value : {110.0, 200.0, 400.0, 760.0}) {
    const NonparametricCalibration middle = interpolated(low, high, iso(iso_value));
    const double t = std::log(iso_value / 100) / std::log(8.0);
    for (std::size_t level = 0; level < levels.size(); ++level)
      EXPECT_NEAR(sd(middle, level),
                  std::exp((1 - t) * std::log(sd(low, level)) + t * std::log(sd(high, level))),
                  0.01 * sd(middle, level))
          << "ISO " << iso_value << ", " << levels[level] << " DN";
    EXPECT_LE(middle.channels[0].pmf[0].size(), 2 + low.channels[0].pmf[0].size());
  }
}

TEST(InterpolateNonparametric, LevelsOfBothInTheSharedRange) {
  const auto low = gaussian_noise(100, {0, 40, 80}, 0.5);
  const auto high = gaussian_noise(200, {20, 60, 100}, 0.5);
  const NonparametricCalibration middle = interpolated(low, high, iso(150));
  EXPECT_EQ(middle.channels[0].level_dn, (Values{20, 40, 60, 80}));
  for (std::size_t level = 0; level < 4; ++level)
    EXPECT_NEAR(std::sqrt(level_moments(middle.channels[0], level).variance_dn2) /
                    true_sd(150, middle.channels[0].level_dn[level]),
                1.0, 0.04);
}

NoiseModel model_of(const std::vector<NonparametricCalibration>& calibrations) {
  NoiseModel model;
  model.layout = SensorLayout::named("mono");
  model.black_dn = {64};
  model.white_dn = 1023;
  model.nonparametric = calibrations;
  return model;
}

TEST(InterpolateNonparametric, ThroughTheModel) {
  const Values levels = {0, 100};
  NoiseModel model = model_of({gaussian_noise(100, levels, 0.5), gaussian_noise(200, levels, 0.5),
                               gaussian_noise(400, levels, 0.5), gaussian_noise(800, levels, 0.5)});
  EXPECT_EQ(model.nonparametric_at(iso(200)), model.nonparametric[1]);
  const NonparametricCalibration between = model.nonparametric_at(iso(300));
  EXPECT_EQ(contradiction_in(model_of({between})), "");
  EXPECT_NEAR(std::sqrt(level_moments(between.channels[0], 1).variance_dn2) / true_sd(300, 100),
              1.0, 0.02);
  EXPECT_NEAR(model.profile_at(iso(300)).channels[0].variance(100),
              level_moments(between.channels[0], 1).variance_dn2, 1e-12);
  EXPECT_THROW((void)model.nonparametric_at(iso(50)), InputError);
  EXPECT_THROW((void)model.nonparametric_at(iso(900)), InputError);
  EXPECT_THROW((void)model.gaussian_at(iso(200)), InputError);
  // ISO 400 and 800 on a higher conversion gain: a third of the noise.
  for (std::size_t i : {2U, 3U})
    for (double& edge : model.nonparametric[i].channels[0].bin_edges_dn) edge /= 3;
  EXPECT_THROW((void)model.nonparametric_at(iso(300)), InputError);
  EXPECT_NO_THROW((void)model.nonparametric_at(iso(150)));
  EXPECT_NO_THROW((void)model.nonparametric_at(iso(600)));
  // A random gain lies inside 100 to 200 or 400 to 800, equally often.
  int low = 0;
  for (std::uint32_t frame = 0; frame < 400; ++frame) {
    const double drawn = *model.random_gain(1, frame).iso;
    EXPECT_TRUE((drawn >= 100 && drawn <= 200) || (drawn >= 400 && drawn <= 800)) << drawn;
    low += drawn <= 200;
  }
  EXPECT_NEAR(low, 200, 40);
}

TEST(ConversionGainBreaks, AreNoneBetweenGainsThatKnowKAndGainsThatDoNot) {
  const Values levels = {0, 100};
  std::vector<NonparametricCalibration> gains;
  for (const double iso_value : {100.0, 200.0, 400.0, 800.0})
    gains.push_back(gaussian_noise(iso_value, levels, 0.5));
  EXPECT_TRUE(conversion_gain_breaks(gains).empty());
  for (const std::size_t unknown : {0U, 1U, 3U}) {
    auto some = gains;
    some[unknown].K.clear();
    EXPECT_TRUE(conversion_gain_breaks(some).empty()) << unknown;
  }
  // Where all know it, a step of K alone is one.
  for (const std::size_t i : {2U, 3U}) gains[i].K[0] *= 3;
  EXPECT_EQ(conversion_gain_breaks(gains), (std::vector<int>{1}));
}

TEST(InterpolateGaussian, GoesGeometricallyAndThroughZeroLinearly) {
  GaussianCalibration low, high;
  low.gain = iso(100);
  high.gain = iso(400);
  low.slope_dn = {0.1, 0.1};
  high.slope_dn = {0.4, 0.4};
  low.offset_dn2 = {1.0, -1.0};
  high.offset_dn2 = {4.0, 3.0};
  const GaussianCalibration middle = interpolated(low, high, iso(200));
  EXPECT_NEAR(middle.slope_dn[0], 0.2, 1e-12);
  EXPECT_NEAR(middle.offset_dn2[0], 2.0, 1e-12);
  EXPECT_NEAR(middle.offset_dn2[1], 1.0, 1e-12);
  EXPECT_TRUE(middle.bias_dn.empty());
}

// -1 e- before the amplifier, and an offset of the converter behind it. Linear in dB it was -1.42
// DN at 6 dB in place of -0.60.
TEST(InterpolateGaussian, BiasGoesLinearlyInK) {
  for (const double offset_dn : {0.0, 0.5}) {
    const auto at = [&](double iso_value) {
      GaussianCalibration g;
      g.gain = iso(iso_value);
      g.slope_dn = {iso_value / 400};
      g.offset_dn2 = {1};
      g.bias_dn = {offset_dn - iso_value / 400};
      return g;
    };
    for (const double between : {150.0, 400.0, 1200.0})
      EXPECT_NEAR(interpolated(at(100), at(1600), iso(between)).bias_dn[0], at(between).bias_dn[0],
                  1e-12);
  }
}

}  // namespace
}  // namespace malus
