// Noise on noise: the deconvolution against Gaussians, and renoised frames against frames that were
// noisy at the target gain from the start.
#include "malus/synthesize/renoise.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/noise/distribution.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/model_renoiser.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "bayer_model.h"
#include "sample_moments.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

std::vector<double> gaussian_bins(double sd, int bins, double width) {
  std::vector<double> p;
  const auto cdf = [sd](double x) { return 0.5 * std::erfc(-x / sd / std::numbers::sqrt2); };
  for (int b = 0; b < bins; ++b)
    p.push_back(cdf(width * (b + 1 - 0.5 * bins)) - cdf(width * (b - 0.5 * bins)));
  return p;
}

TEST(Deconvolve, GaussianFromGaussianLeavesTheDifferenceOfVariances) {
  const auto p1 = gaussian_bins(1.0, 121, 0.2), p2 = gaussian_bins(2.0, 121, 0.2);
  const auto d = deconvolve(p1, p2);
  ASSERT_EQ(d.size(), 241u);
  double total = 0, mean = 0, square = 0;
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double x = 0.2 * (static_cast<double>(i) - 120);
    ASSERT_GE(d[i], 0);
    total += d[i];
    mean += d[i] * x;
    square += d[i] * x * x;
  }
  EXPECT_NEAR(total, 1, 1e-12);
  EXPECT_NEAR(mean, 0, 1e-6);
  EXPECT_NEAR(square, 3.0, 0.02);
  for (std::size_t k = 0; k < 121; ++k) {  // p1 * d
    double sum = 0;
    for (std::size_t j = 0; j < 121; ++j) sum += p1[j] * d[k + 120 - j];
    EXPECT_NEAR(sum, p2[k], 2e-4);
  }
}

TEST(Deconvolve, EqualDistributionsNeedNoChange) {
  const auto p = gaussian_bins(0.7, 41, 0.5);
  const auto d = deconvolve(p, p, 2000);
  EXPECT_GT(d[40] + d[39] + d[41], 0.97);
}

PhysicsNoise mono(double K, double sigma_tl, double sigma_row, double mu) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.channels = {{.gain_dn_per_e = K,
                     .lambda = 0.05,
                     .mu_dn = mu,
                     .sigma_tl_dn = sigma_tl,
                     .sigma_row_dn = sigma_row}};
  return noise;
}

TEST(PixelBins, AgreeWithTheNumericDistribution) {
  const PhysicsNoise noise = mono(2.0, 0.8, 0, -1);
  const PixelDistribution truth(noise.channels[0], noise.parts, 1.0, 30.0);
  const auto p = PixelBins(noise, 0).probabilities(30.0, 0.7, 101);
  double total = 0;
  for (int b = 1; b < 100; ++b) {
    const double low = 30.0 + 0.7 * (b - 50.5);
    EXPECT_NEAR(p[static_cast<std::size_t>(b)], truth.cdf(low + 0.7) - truth.cdf(low), 2e-5);
  }
  for (const double v : p) total += v;
  EXPECT_NEAR(total, 1, 1e-12);
}

TEST(Renoiser, GivesTheTargetsMomentsAtEveryLevel) {
  const PhysicsNoise from = mono(0.5, 0.6, 0.2, -1), to = mono(2.0, 1.5, 0.7, -3);
  const Renoiser renoiser(from, to, 2000);
  const CompiledNoise source(from);
  for (const double level : {0.0, 7.0, 150.0, 1900.0}) {
    const Image clean(500, 600, static_cast<float>(level));
    Image noisy(500, 600), again(500, 600);
    source.apply(clean.view(), noisy.view(), {.seed = 1, .frame = 0});
    // The same seed and number as the source: the noises must be independent all the same.
    renoiser.apply(noisy, clean, again, {.seed = 1, .frame = 0});
    const Moments m = testing::moments_of(again);
    const PixelDistribution truth(to.channels[0], to.parts, 1.0, level);
    const double row_variance = 0.49, variance = truth.variance_dn2() + row_variance;
    // The rows' 500 draws bound the mean; 1 % for bins and the end of the iteration.
    EXPECT_NEAR(m.mean(), level - 3,
                5 * std::sqrt(truth.variance_dn2() / 3e5 + row_variance / 500) +
                    0.002 * truth.variance_dn2() / 2);
    EXPECT_NEAR(
        m.variance() / variance, 1.0,
        5 * std::sqrt(2.0 / 3e5) + 5 * row_variance / variance * std::sqrt(2.0 / 500) + 0.01)
        << level;
  }
}

// √JSD (base 2) of two sets of samples on 60 bins over ±5 deviations of the second.
double root_jsd(const Image& a, const Image& b) {
  constexpr std::size_t kHistogram = 60;
  const Moments m = testing::moments_of(b);
  const auto histogram = [&](const Image& image) {
    std::vector<double> p(kHistogram, 0.0);
    for (const float v : image.values()) {
      const double z = (static_cast<double>(v) - m.mean()) / std::sqrt(m.variance());
      p[static_cast<std::size_t>(std::clamp((z + 5) * 0.1 * kHistogram, 0.0, kHistogram - 1.0))] +=
          1.0 / static_cast<double>(image.size());
    }
    return p;
  };
  const auto p = histogram(a), q = histogram(b);
  double jsd = 0;
  for (std::size_t i = 0; i < kHistogram; ++i)
    for (const double v : {p[i], q[i]})
      if (v > 0) jsd += 0.5 * v * std::log2(2 * v / (p[i] + q[i]));
  return std::sqrt(jsd);
}

// What calibration gives: levels and bins of each gain's own, narrow in the middle and growing
// outwards, up to a brightest level well below white.
NonparametricCalibration as_calibrated(const PhysicsNoise& noise, int levels, double growth) {
  NonparametricCalibration n;
  const PhysicsChannel& channel = noise.channels[0];
  NonparametricChannel measured;
  std::vector<double> half{0.15};
  for (double width = 0.3; half.back() < 300; width *= growth) half.push_back(half.back() + width);
  for (const double edge : half) {
    measured.bin_edges_dn.push_back(edge);
    measured.bin_edges_dn.insert(measured.bin_edges_dn.begin(), -edge);
  }
  for (int l = 0; l <= levels; ++l) {
    const double level = 600.0 * l * l / (levels * levels);
    const PixelDistribution pixel(channel, noise.parts, noise.quantization_dn, level);
    std::vector<double> pmf;
    for (std::size_t b = 0; b + 1 < measured.bin_edges_dn.size(); ++b)
      pmf.push_back(pixel.cdf(level + measured.bin_edges_dn[b + 1]) -
                    pixel.cdf(level + measured.bin_edges_dn[b]));
    measured.level_dn.push_back(level);
    measured.pmf.push_back(pmf);
    measured.samples.push_back(100000);
  }
  n.channels = {measured};
  n.sigma_row_dn = {channel.sigma_row_dn};
  n.K = {channel.gain_dn_per_e};
  return n;
}

// Frames of the lower gain against frames that the camera took at the higher one, rounded; 1500 DN
// lies above all levels.
TEST(Renoiser, MeasuredNoiseOfUnlikeLevelsAndBinsBecomesTheTargets) {
  const PhysicsNoise from = mono(0.5, 0.9, 0, -1), to = mono(2.0, 2.2, 0, -3);
  const SensorLayout layout = SensorLayout::named("mono");
  const Renoiser renoiser(layout, as_calibrated(from, 24, 1.05), as_calibrated(to, 20, 1.08), 1,
                          2000, 1.0);
  const auto round = [](Image& image) {
    for (float& v : image.values()) v = std::nearbyint(v);
  };
  PhysicsNoise camera_from = from, camera_to = to;
  camera_from.parts.quantization = camera_to.parts.quantization = false;
  for (const double level : {0.0, 12.3, 150.0, 590.0, 1500.0}) {
    const Image clean(600, 600, static_cast<float>(level));
    Image noisy(600, 600), ours(600, 600), target(600, 600);
    CompiledNoise(camera_from).apply(clean.view(), noisy.view(), {.seed = 5});
    round(noisy);
    renoiser.apply(noisy, clean, ours, {.seed = 5});
    round(ours);
    CompiledNoise(camera_to).apply(clean.view(), target.view(), {.seed = 6});
    round(target);
    const Moments mine = testing::moments_of(ours), truth = testing::moments_of(target);
    EXPECT_NEAR(mine.mean(), truth.mean(), 0.02 * std::sqrt(truth.variance())) << level;
    EXPECT_NEAR(mine.variance() / truth.variance(), 1.0, 0.02) << level;
    // Two samples of one distribution give 0.008.
    EXPECT_LT(root_jsd(ours, target), 0.02) << level;
  }
}

// Both distributions hold their frames' rounding: that of the result is not added to it.
TEST(Renoiser, RoundingOfTheResultIsNoMoreNoise) {
  const PhysicsNoise from = mono(0.01, 0.5, 0, 0), to = mono(0.02, 0.8, 0, 0);
  const Renoiser renoiser(SensorLayout::named("mono"), as_calibrated(from, 2, 1.05),
                          as_calibrated(to, 2, 1.05), 1, 10, 1.0);
  const Image clean(600, 600, 0.0f);
  const auto recorded = [&](PhysicsNoise camera, std::uint64_t seed) {
    camera.parts.quantization = false;
    Image dn(600, 600);
    CompiledNoise(camera).apply(clean.view(), dn.view(), {.seed = seed});
    return dn;
  };
  const auto round = [](Image dn) {
    for (float& v : dn.values()) v = std::nearbyint(v);
    return dn;
  };
  Image ours = round(recorded(from, 5));
  renoiser.apply(ours, clean, ours, {.seed = 5});
  const double target = testing::moments_of(round(recorded(to, 6))).variance();
  // q²/12 twice would be 0.046 of it more; five standard errors of the two are 0.017.
  EXPECT_NEAR(testing::moments_of(round(ours)).variance(), target, 0.02 * target);
}

// Frames of floats have no step: what is written is whole numbers all the same.
TEST(ModelRenoiser, RoundsToWholeNumbersWhereTheModelHasNoStep) {
  NoiseModel model = testing::bayer_model();
  model.quantization_dn = 0;
  for (const char* method : {"naive", "noise-on-noise"}) {
    RenoiseSettings settings;
    settings.method = method;
    const ModelRenoiser renoiser(model, testing::kGain, testing::kGain, settings, true);
    const Image noisy(64, 64, 500.0f);
    Image dn(64, 64, 500.0f);
    renoiser.apply(noisy, dn, {.seed = 3});
    EXPECT_NEAR(testing::moments_of(dn).mean(), 64 + 500, 10) << method;
    for (const float v : dn.values()) ASSERT_EQ(v, std::nearbyint(v)) << method;
  }
}

NonparametricCalibration of_four_channels(NonparametricCalibration levels) {
  levels.gain = testing::kGain;
  levels.channels.assign(4, levels.channels[0]);
  levels.sigma_row_dn.assign(4, 0.0);
  levels.K.assign(4, levels.K[0]);
  return levels;
}

// Physics is quiet here beside what was measured, whose rounding its levels hold already.
TEST(ModelRenoiser, NaiveNoiseIsOfTheKindThatIsAskedFor) {
  NoiseModel model = testing::bayer_model();
  const PhysicsNoise measured = mono(2.0, 5.0, 0, -3);
  model.nonparametric = {of_four_channels(as_calibrated(measured, 8, 1.2))};
  for (const bool rounded : {false, true})
    for (const double level : {150.0, 900.0}) {
      const ModelRenoiser renoiser(model, testing::kGain, testing::kGain,
                                   {.kind = "nonparametric", .method = "naive"}, rounded);
      const Image noisy(200, 200);
      Image dn(200, 200, static_cast<float>(level));
      const LevelCoverage coverage = renoiser.apply(noisy, dn, {.seed = 3});
      EXPECT_EQ(coverage.pixels, 40000);
      EXPECT_EQ(coverage.above, level > 700 ? 40000 : 0);
      const PixelDistribution truth(measured.channels[0], measured.parts, 1.0, level);
      const Moments m = testing::moments_of(dn);
      // Five standard errors of a variance are 3.5 %.
      EXPECT_NEAR(m.variance() / truth.variance_dn2(), 1, 0.05) << level << rounded;
      EXPECT_NEAR(m.mean(), level - 3 + (rounded ? 64 : 0), 0.03 * std::sqrt(truth.variance_dn2()));
    }
}

// Its pixels are those of their channels, wherever it begins.
TEST(ModelRenoiser, APartOfAFrameIsThatOfTheWhole) {
  NoiseModel model = testing::bayer_model();
  model.black_dn = {64, 100, 140, 180};
  model.quantization_dn = 0;
  NonparametricCalibration levels = of_four_channels(as_calibrated(mono(2.0, 5.0, 0, -3), 8, 1.2));
  levels.channels[0].level_dn.resize(5);
  levels.channels[0].pmf.resize(5);
  levels.channels[0].samples.resize(5);
  model.nonparametric = {levels};
  const Image noisy(32, 32, 400.0f);
  for (const RenoiseSettings& settings :
       {RenoiseSettings{}, {.method = "naive"}, {.kind = "nonparametric", .method = "naive"}}) {
    const ModelRenoiser renoiser(model, testing::kGain, testing::kGain, settings, true);
    Image whole(32, 32, 400.0f), part(9, 7, 400.0f);
    renoiser.apply(noisy, whole, {.seed = 3});
    const LevelCoverage coverage =
        renoiser.apply(noisy.view().window(3, 5, 9, 7), part, {.seed = 3, .row0 = 3, .col0 = 5});
    for (int r = 0; r < 9; ++r)
      for (int c = 0; c < 7; ++c)
        ASSERT_EQ(part(r, c), whole(3 + r, 5 + c)) << settings.kind << settings.method;
    // Of channel 0, known up to 150 DN: rows 4, 6, 8, 10 and columns 6, 8, 10.
    EXPECT_EQ(coverage.above, settings.kind == "nonparametric" ? 12 : 0);
  }
}

// Under the same seed and number: noise added twice would otherwise be the same words twice.
TEST(ModelRenoiser, AddsOtherNoiseAtEveryStep) {
  const NoiseModel model = load_model("imx250mzr-simulated");
  const auto at = [](double gain_db) { return GainSetting{gain_db, {}}; };
  const Image clean(512, 512, 200.0f);
  const auto physics = [&](double gain_db) {
    Image dn(512, 512);
    CompiledNoise(model.physics_at(at(gain_db))).apply(clean, dn, {.seed = 8});
    return dn;
  };
  Image dn = physics(0);
  for (const double from_db : {0.0, 12.0}) {
    Image guide = clean;
    ModelRenoiser(model, at(from_db), at(from_db + 12), {}, false).apply(dn, guide, {.seed = 3});
    dn = std::move(guide);
  }
  const double target = testing::moments_of(physics(24)).variance();
  EXPECT_NEAR(testing::moments_of(dn).variance(), target, 0.05 * target);  // it was 1.7 of it
}

TEST(ModelRenoiser, SettingsThatAreNoneAreRefused) {
  const NoiseModel model = testing::bayer_model();
  const auto make = [&](const RenoiseSettings& settings) {
    return ModelRenoiser(model, testing::kGain, testing::kGain, settings, true);
  };
  EXPECT_NO_THROW(make({.method = "naive"}));
  for (const RenoiseSettings& settings :
       {RenoiseSettings{.kind = "gaussian"}, RenoiseSettings{.method = "best"}})
    try {
      make(settings);
      FAIL();
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("is not known"), std::string::npos) << error.what();
    }
}

TEST(Renoiser, GainsWithoutACommonLevelAreRefused) {
  NonparametricCalibration from = as_calibrated(mono(0.5, 0.9, 0, 0), 2, 1.2),
                           to = as_calibrated(mono(2.0, 2.2, 0, 0), 2, 1.2);
  for (double& level : to.channels[0].level_dn) level += 1000;
  from.K.clear();
  EXPECT_THROW(Renoiser(SensorLayout::named("mono"), from, to, 1, 2000, 1.0), InputError);
}

// Rows of the target's autocorrelation, whatever the source's: 40 frames of 400 row means; the
// error of a covariance of drifting rows is below 2.5 times that of white ones.
TEST(Renoiser, RowsGetTheTargetsDrift) {
  PhysicsNoise from = mono(0.5, 0.6, 0.5, 0), to = mono(2.0, 1.5, 1.5, 0);
  from.row_drift = {0.3, 2.0};
  to.row_drift = {0.6, 4.0};
  const Renoiser renoiser(from, to, 2000);
  const CompiledNoise source(from);
  const Image clean(400, 64, 0.0f);
  Image noisy(400, 64), again(400, 64);
  Moments lagged[3];
  for (std::uint32_t frame = 0; frame < 40; ++frame) {
    source.apply(clean.view(), noisy.view(), {.seed = 2, .frame = frame});
    renoiser.apply(noisy, clean, again, {.seed = 2, .frame = frame});
    std::vector<double> mean(400, 0.0);
    for (int r = 0; r < 400; ++r)
      for (int c = 0; c < 64; ++c) mean[static_cast<std::size_t>(r)] += double{again(r, c)} / 64;
    for (std::size_t lag = 1; lag <= 3; ++lag)
      for (std::size_t r = lag; r < 400; ++r) lagged[lag - 1].add(mean[r] * mean[r - lag]);
  }
  // The source's slow part keeps its shorter length: the sum is the target's at lag 1 only nearly.
  const double slow_from = 0.25 * 0.3, slow_added = 2.25 * 0.6 - slow_from;
  for (int lag = 1; lag <= 3; ++lag) {
    const Moments& m = lagged[lag - 1];
    const double error = 2.5 * std::sqrt(m.variance() / static_cast<double>(m.count()));
    EXPECT_NEAR(m.mean(), slow_from * std::exp(-lag / 2.0) + slow_added * std::exp(-lag / 4.0),
                4 * error)
        << lag;
  }
}

// A guide that lost all detail: noise on noise keeps the detail of the noisy frame, the naive
// scheme (guide + new noise) has lost it.
TEST(Renoiser, KeepsDetailThatTheGuideLost) {
  const PhysicsNoise from = mono(0.5, 0.6, 0, 0), to = mono(1.0, 1.2, 0, 0);
  const Renoiser renoiser(from, to, 2000);
  Image clean(300, 400), guide(300, 400, 500.0f), noisy(300, 400), ours(300, 400), naive(300, 400);
  for (int r = 0; r < 300; ++r)
    for (int c = 0; c < 400; ++c) clean(r, c) = (r + c) % 2 != 0 ? 480.0f : 520.0f;
  CompiledNoise(from).apply(clean.view(), noisy.view(), {.seed = 2});
  renoiser.apply(noisy, guide, ours, {.seed = 3});
  CompiledNoise(to).apply(guide.view(), naive.view(), {.seed = 3});
  double detail = 0, naive_detail = 0;
  for (int r = 0; r < 300; ++r)
    for (int c = 0; c < 400; ++c) {
      const double sign = (r + c) % 2 != 0 ? -1 : 1;
      detail += sign * static_cast<double>(ours(r, c));
      naive_detail += sign * static_cast<double>(naive(r, c));
    }
  const double error = 5 * std::sqrt(502.0 / 120000);
  EXPECT_NEAR(detail / 120000, 20.0, error);
  EXPECT_NEAR(naive_detail / 120000, 0.0, error);
}

TEST(Renoiser, QuieterTargetsAreRefused) {
  EXPECT_THROW(Renoiser(mono(2.0, 1.0, 0, 0), mono(0.5, 0.5, 0, 0), 1000), InputError);
}

}  // namespace
}  // namespace malus
