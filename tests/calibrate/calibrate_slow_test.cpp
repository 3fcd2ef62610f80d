// Coverage of the standard errors over repeated sessions, and the real camera of the EMVA 1288 data
// sets.
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"
#include "malus/io/emva_description.h"

#include <array>
#include <cmath>
#include <map>

#include "simulated_session.h"
#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::calibrated;
using testing::polar_gain;
using testing::SimulatedCamera;

struct Coverage {
  int inside = 0, all = 0;
  double sum = 0, square = 0;
  void add(double value, double standard_error, double truth) {
    const double z = (value - truth) / standard_error;
    ++all;
    inside += std::abs(z) < 2;
    sum += z;
    square += z * z;
  }
};

// Every parameter of every channel over independent sessions.
std::map<std::string, Coverage> cover(SimulatedCamera camera, int repeats) {
  std::map<std::string, Coverage> coverage;
  for (int i = 0; i < repeats; ++i) {
    camera.seed = 4000 + static_cast<std::uint64_t>(i);
    const NoiseModel model = calibrated(camera);
    for (std::size_t g = 0; g < camera.gains.size(); ++g) {
      const PhysicsCalibration& p = model.physics[g];
      for (std::size_t c = 0; c < camera.gains[g].noise.channels.size(); ++c) {
        const PhysicsChannel& truth = camera.gains[g].noise.channels[c];
        const auto add = [&](const char* name, const ChannelStatistics& found, double value) {
          coverage[name].add(found.mean[c], found.standard_error[c], value);
        };
        add("K", p.K, truth.gain_dn_per_e);
        add("mu", p.mu, truth.mu_dn);
        add("sigma_row", p.sigma_row, truth.sigma_row_dn);
        add("sigma_tl", p.sigma_tl, truth.sigma_tl_dn);
        add("lambda", p.lambda, truth.lambda);
        coverage["temporal_sd_dark"].add(p.temporal_sd_dark_dn[c], p.temporal_sd_dark_stderr_dn[c],
                                         std::sqrt(read_variance_dn2(truth) + 1.0 / 12 +
                                                   truth.sigma_row_dn * truth.sigma_row_dn));
      }
    }
  }
  return coverage;
}

// Within two standard errors in 95.4 % of the cases, up to three deviations of a binomial share.
void expect_inside(const Coverage& c, const std::string& name) {
  const double share = static_cast<double>(c.inside) / c.all;
  EXPECT_NEAR(share, 0.954, 3 * std::sqrt(0.954 * 0.046 / c.all)) << name;
}

// That, and no bias beyond a third of a standard error.
void expect_covered(const std::map<std::string, Coverage>& coverage) {
  for (const auto& [name, c] : coverage) {
    expect_inside(c, name);
    EXPECT_LT(std::abs(c.sum / c.all), 0.33) << name;
    std::printf("  %-17s n %5d  inside two SE %.1f %%  mean z %+.2f  rms z %.2f\n", name.c_str(),
                c.all, 100.0 * c.inside / c.all, c.sum / c.all, std::sqrt(c.square / c.all));
  }
}

TEST(CalibrationCoverage, SmallFramesAtFourGains) {
  SimulatedCamera camera;
  for (double gain_db : {0.0, 8.0, 16.0, 24.0}) camera.gains.push_back(polar_gain(gain_db));
  expect_covered(cover(camera, 15));
}

TEST(CalibrationCoverage, LargeFrames) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 192;
  camera.gains.push_back(polar_gain(12));
  expect_covered(cover(camera, 12));
}

TEST(CalibrationCoverage, ParametersThatVaryFromFrameToFrame) {
  SimulatedCamera camera;
  camera.gains.push_back(polar_gain(12));
  auto& gain = camera.gains[0];
  for (const auto& channel : gain.noise.channels) {
    gain.mu_spread_dn.push_back(0.15);
    gain.sigma_row_spread_dn.push_back(0.1 * channel.sigma_row_dn);
    gain.sigma_tl_spread_dn.push_back(0.03 * channel.sigma_tl_dn);
  }
  expect_covered(cover(camera, 40));
}

TEST(CalibrationCoverage, MonoAndBayerSensors) {
  for (const char* layout : {"mono", "bayer-rggb"}) {
    SimulatedCamera camera;
    camera.gains.push_back(polar_gain(12, layout, 1));
    for (const auto& [name, c] : cover(camera, 40)) expect_inside(c, layout + (" " + name));
  }
}

// Interpolation by the joint model to a gain that was left out: sigma and K within 5 % on a sensor
// that follows the papers' laws (000 Eq. 7: straight lines in log K).
TEST(CalibratedJointModel, PredictsAGainThatWasLeftOut) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 256;
  camera.seed = 77;
  for (double gain_db : {0.0, 8.0, 16.0, 24.0}) {
    camera.gains.push_back(polar_gain(gain_db));
    const double amplification = std::pow(10.0, gain_db / 20);
    for (auto& channel : camera.gains.back().noise.channels) {
      channel.sigma_tl_dn *= 0.57 * std::pow(amplification, 0.9) / (0.15 + 0.42 * amplification);
      channel.sigma_row_dn *= 0.17 * std::pow(amplification, 0.93) / (0.03 + 0.14 * amplification);
    }
  }
  NoiseModel model = calibrated(camera);
  ASSERT_TRUE(model.joint.has_value());
  for (const std::size_t left_out : {1u, 2u}) {
    NoiseModel partial = model;
    partial.physics.erase(partial.physics.begin() + static_cast<std::ptrdiff_t>(left_out));
    const auto joint = fit_joint_model(partial.physics);
    ASSERT_TRUE(joint.decided());
    partial.joint = *joint;
    const PhysicsNoise found = partial.physics_at(camera.gains[left_out].gain);
    for (std::size_t c = 0; c < 16; ++c) {
      const PhysicsChannel& truth = camera.gains[left_out].noise.channels[c];
      EXPECT_NEAR(found.channels[c].gain_dn_per_e / truth.gain_dn_per_e, 1.0, 0.05) << c;
      EXPECT_NEAR(std::sqrt(read_variance_dn2(found.channels[c]) / read_variance_dn2(truth)), 1.0,
                  0.05)
          << c;
      EXPECT_NEAR(found.channels[c].sigma_row_dn / truth.sigma_row_dn, 1.0, 0.08) << c;
    }
  }
}

// Basler CCD of the EMVA 1288 data sets; expected values by independent scripts (its SOURCES.md).
TEST(RealCamera, Emva001) {
  MALUS_NEEDS_SHARED("emva001");
  const Session session =
      load_emva_description(testing::shared_data() / "emva001" / "EMVA1288_Data.txt").session;
  const NoiseModel model = calibrate_physics(calibration_input(session), {}, silent_progress());
  ASSERT_EQ(model.physics.size(), 1u);
  const PhysicsCalibration& p = model.physics[0];
  EXPECT_GT(p.K.mean[0], 0.277);
  EXPECT_LT(p.K.mean[0], 0.284);
  EXPECT_NEAR(p.K.mean[0], 0.2804, 2 * p.K.standard_error[0]);
  EXPECT_NEAR(p.temporal_sd_dark_dn[0], 3.08, 0.01 * 3.08);
  EXPECT_NEAR(p.sigma_row.mean[0], 0.504, 0.03 * 0.504);
  EXPECT_NEAR(p.mu.mean[0], 14.76, 0.02);
  // The published 0.46 DN is the spread of a mean of 50 frames, their noise included.
  EXPECT_NEAR(std::hypot(p.dsnu_dn[0], 3.08 / std::sqrt(50.0)), 0.46, 0.02);
  EXPECT_EQ(model.row_group, 1);
  EXPECT_EQ(model.row_group_origin, "detected");
  for (const std::string& warning : p.warnings)  // true of it, and all that there is to say
    EXPECT_NE(warning.find("the sensor is not linear"), std::string::npos) << warning;
  // An independent Whittle fit (NumPy and SciPy) to the same 50 frames: share 0.331, decay 0.601.
  const MeasuredRowDrift& drift = p.row_drift;
  EXPECT_NEAR(drift.drift.share, 0.331, 0.01);
  EXPECT_NEAR(std::exp(-1 / drift.drift.length_groups), 0.601, 0.01);
  std::printf("  row drift: share %.3f ± %.3f, length %.2f ± %.2f rows\n", drift.drift.share,
              drift.share_stderr, drift.drift.length_groups, drift.length_stderr);
  std::printf(
      "  K %.4f ± %.4f, intercept %.2f ± %.2f, dark sd %.4f, row %.4f ± %.4f, column %.4f, "
      "lambda %.3f, dsnu %.3f, prnu %.4f\n",
      p.K.mean[0], p.K.standard_error[0], p.K_intercept_dn2[0], p.K_intercept_stderr_dn2[0],
      p.temporal_sd_dark_dn[0], p.sigma_row.mean[0], p.sigma_row.standard_error[0],
      p.sigma_column.mean[0], p.lambda.mean[0], p.dsnu_dn[0], p.prnu.at(0));
}

// Distribution of the codes that a level's bins, uniform inside, plus normal row noise, rounded,
// give.
std::vector<double> code_distribution(const NonparametricChannel& channel, std::size_t level,
                                      double sigma_row_dn, int codes) {
  const auto integral = [&](double x) {
    const double z = x / sigma_row_dn;
    return sigma_row_dn * (z * 0.5 * std::erfc(-z / std::sqrt(2.0)) +
                           std::exp(-0.5 * z * z) / std::sqrt(2 * 3.14159265358979323846));
  };
  std::vector<double> out(static_cast<std::size_t>(codes), 0.0);
  for (int k = 0; k < codes; ++k)
    for (std::size_t b = 0; b < channel.pmf[level].size(); ++b) {
      const double from = channel.bin_edges_dn[b], to = channel.bin_edges_dn[b + 1];
      out[static_cast<std::size_t>(k)] += channel.pmf[level][b] / (to - from) *
                                          (integral(k + 0.5 - from) - integral(k + 0.5 - to) -
                                           integral(k - 0.5 - from) + integral(k - 0.5 - to));
    }
  return out;
}

double root_jensen_shannon(const std::vector<double>& p, const std::vector<double>& q) {
  double sum = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const double middle = 0.5 * (p[i] + q[i]);
    if (p[i] > 0) sum += 0.5 * p[i] * std::log2(p[i] / middle);
    if (q[i] > 0) sum += 0.5 * q[i] * std::log2(q[i] / middle);
  }
  return std::sqrt(std::max(sum, 0.0));
}

// Every second dark frame calibrates, the others judge: the distribution with its row noise put
// back must be within .006 of theirs, and three times nearer than a rounded Gaussian.
TEST(RealCamera, NonparametricDarkLevelMatchesHeldOutFrames) {
  MALUS_NEEDS_SHARED("emva001");
  CalibrationInput input = calibration_input(
      load_emva_description(testing::shared_data() / "emva001" / "EMVA1288_Data.txt").session);
  constexpr int kCodes = 80;
  std::vector<double> held(kCodes, 0.0), gauss(kCodes, 0.0);
  Moments moments;
  for (FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kBias || set.count < 20) continue;
    for (int i = 1; i < set.count; i += 2) {
      const RawFrame frame = set.load(i);
      for (const float dn : frame.dn.values()) {
        held[static_cast<std::size_t>(std::min(dn, kCodes - 1.0F))] += 1;
        moments.add(dn);
      }
    }
    set.count /= 2;
    set.load = [load = set.load](int i) { return load(2 * i); };
  }
  for (double& h : held) h /= static_cast<double>(moments.count());
  const double sd = std::sqrt(moments.variance() - 1.0 / 12);
  for (int k = 0; k < kCodes; ++k)
    gauss[static_cast<std::size_t>(k)] =
        0.5 * (std::erfc(-(k + 0.5 - moments.mean()) / sd / std::sqrt(2.0)) -
               std::erfc(-(k - 0.5 - moments.mean()) / sd / std::sqrt(2.0)));
  CalibrationSettings settings;
  settings.level_samples = 50000;
  const NoiseModel model =
      calibrate(input, settings, {ModelKind::kNonparametric}, silent_progress());
  const NonparametricCalibration& n = model.nonparametric.at(0);
  const double found =
      root_jensen_shannon(held, code_distribution(n.channels[0], 0, n.sigma_row_dn[0], kCodes));
  const double gaussian = root_jensen_shannon(held, gauss);
  std::printf("  root JSD: non-parametric %.4f, rounded Gaussian %.4f\n", found, gaussian);
  EXPECT_LE(found, 0.006);
  EXPECT_LE(found, gaussian / 3);
}

}  // namespace
}  // namespace malus
