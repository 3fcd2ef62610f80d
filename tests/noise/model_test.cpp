#include "malus/noise/model.h"

#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/builtin_models.h"

#include <algorithm>
#include <cmath>

#include "../problem_of.h"
#include "sample_model.h"
#include "support.h"

namespace malus {
namespace {

using testing::db;
using testing::iso;
using testing::problem_of;
using Values = std::vector<double>;

TEST(ModelAtGain, MeasuredGainsGiveTheMeasuredValues) {
  const NoiseModel model = testing::full_model();
  for (const PhysicsCalibration& truth : model.physics) {
    const GainParameters p = model.parameters_at(truth.gain);
    EXPECT_TRUE(p.measured);
    EXPECT_EQ(p.K, truth.K.mean);
    EXPECT_EQ(p.mu_dn, truth.mu.mean);
    EXPECT_EQ(p.sigma_row_dn, truth.sigma_row.mean);
    EXPECT_EQ(p.sigma_tl_dn, truth.sigma_tl.mean);
    EXPECT_EQ(p.lambda, truth.lambda.mean);
    EXPECT_LT(largest_difference(p.mu_covariance, truth.mu.covariance), 1e-12);
    const PhysicsNoise noise = model.physics_at(truth.gain);
    EXPECT_EQ(noise.row_group, 2);
    EXPECT_EQ(noise.quantization_dn, 2);
    EXPECT_EQ(noise.channels[1].gain_dn_per_e, truth.K.mean[1]);
    EXPECT_EQ(noise.channels[1].mu_dn, truth.mu.mean[1]);
  }
}

TEST(ModelAtGain, BetweenGainsFollowsTheLaw) {
  const GainParameters p = testing::full_model().parameters_at(db(9));
  EXPECT_FALSE(p.measured);
  const double K = 0.4 * std::pow(10.0, 9.0 / 20.0);
  EXPECT_NEAR(p.K[0] / (0.98 * K), 1.0, 1e-9);
  EXPECT_NEAR(p.K[1] / (1.02 * K), 1.0, 1e-9);
  EXPECT_NEAR(p.mu_dn[1] / (-0.6 * K), 1.0, 1e-9);
  EXPECT_NEAR(p.sigma_tl_dn[0] / (1.3 * K), 1.0, 1e-9);
}

TEST(ModelAtGain, RefusesWhatIsNotCalibrated) {
  const NoiseModel model = testing::full_model();
  EXPECT_NE(problem_of([&] { (void)model.physics_at(db(15)); }).find("0 dB to 12 dB"),
            std::string::npos);
  EXPECT_NE(problem_of([&] { (void)model.physics_at(db(-1)); }), "");
  const PhysicsNoise beyond = model.physics_at(db(18), GainRange::kAllowExtrapolation);
  EXPECT_NEAR(beyond.channels[0].gain_dn_per_e, 0.98 * 0.4 * std::pow(10.0, 0.9), 1e-9);
  for (const double far_db : {-9000.0, 9000.0})
    EXPECT_NE(problem_of([&] {
                (void)model.physics_at(db(far_db), GainRange::kAllowExtrapolation);
              }).find("possible"),
              std::string::npos)
        << far_db;
  EXPECT_NE(problem_of([&] { (void)model.physics_at(iso(200)); }).find("dB"), std::string::npos);
  EXPECT_NE(problem_of([&] { (void)model.physics_at({}); }).find("give gain"), std::string::npos);
  NoiseModel no_joint = model;
  no_joint.joint.reset();
  EXPECT_NE(problem_of([&] { (void)no_joint.physics_at(db(9)); }), "");
  NoiseModel no_physics = model;
  no_physics.physics.clear();
  EXPECT_NE(problem_of([&] { (void)no_physics.physics_at(db(6)); }).find("kinds physics"),
            std::string::npos);
}

NoiseModel model_without_K_at(std::size_t gain) {
  NoiseModel model = testing::full_model();
  model.physics[gain].K = {};
  model.joint = fit_joint_model(model.physics).value();
  return model;
}

TEST(ModelAtGain, WithoutKIsReachedByTheJointModelAlone) {
  const NoiseModel lowest = model_without_K_at(0), middle = model_without_K_at(1);
  EXPECT_NE(problem_of([&] { (void)lowest.physics_at(db(0)); }).find("flat"), std::string::npos);
  EXPECT_NE(problem_of([&] { (void)lowest.physics_at(db(3)); }).find("6 dB to 12 dB"),
            std::string::npos);
  const GainParameters at = middle.parameters_at(db(6)), beside = middle.parameters_at(db(6.0001));
  EXPECT_FALSE(at.measured);
  EXPECT_EQ(at.gain, db(6));
  EXPECT_NEAR(at.K[0] / beside.K[0], 1.0, 1e-4);
  EXPECT_NEAR(at.sigma_tl_dn[1] / beside.sigma_tl_dn[1], 1.0, 1e-4);
}

TEST(ModelSampling, RandomGainIsOneThatCanBeDrawn) {
  NoiseModel model = model_without_K_at(1);
  for (const bool joint : {true, false}) {
    if (!joint) model.joint.reset();
    for (std::uint32_t frame = 0; frame < 50; ++frame)
      EXPECT_NO_THROW((void)model.physics_at(model.random_gain(1, frame))) << joint;
  }
}

TEST(ModelAtGain, AnUnknownGainMeansTheOnlyOne) {
  NoiseModel model = testing::full_model();
  model.physics.resize(1);
  model.joint.reset();
  EXPECT_EQ(model.parameters_at({}).K, model.physics[0].K.mean);
  EXPECT_NE(problem_of([&] { (void)model.physics_at(db(6)); }), "");
}

// One bias frame gives means and no spread: a model that draws without varying.
TEST(ModelAtGain, ASpreadThatIsNotKnownIsNone) {
  NoiseModel model = testing::full_model();
  model.joint.reset();
  model.physics.resize(1);
  for (auto parameter :
       {&PhysicsCalibration::mu, &PhysicsCalibration::sigma_row, &PhysicsCalibration::sigma_tl}) {
    (model.physics[0].*parameter).spread = {NAN, NAN};
    (model.physics[0].*parameter).standard_error = {NAN, NAN};
    (model.physics[0].*parameter).covariance = {};
  }
  EXPECT_EQ(contradiction_in(model), "");
  const PhysicsNoise drawn = model.sample_physics_at(db(0), 1, 1);
  const PhysicsNoise mean = model.physics_at(db(0));
  EXPECT_EQ(drawn.channels[0].mu_dn, mean.channels[0].mu_dn);
  EXPECT_EQ(drawn.channels[1].sigma_row_dn, mean.channels[1].sigma_row_dn);
  EXPECT_EQ(drawn.channels[1].sigma_tl_dn, mean.channels[1].sigma_tl_dn);
}

TEST(ModelAtGain, NeverAcrossConversionGains) {
  const NoiseModel model = load_model("sony-a7s2");
  EXPECT_NO_THROW((void)model.physics_at(iso(1500)));
  EXPECT_NO_THROW((void)model.physics_at(iso(2200)));
  for (GainRange range : {GainRange::kCalibratedOnly, GainRange::kAllowExtrapolation})
    EXPECT_NE(problem_of([&] {
                (void)model.physics_at(iso(1800), range);
              }).find("between ISO 1600 and ISO 2000"),
              std::string::npos);
  EXPECT_LT(model.physics_at(iso(2000)).channels[0].sigma_tl_dn,
            0.5 * model.physics_at(iso(1600)).channels[0].sigma_tl_dn);
}

// Gaussian noise whose own lines are smooth over the break that read noise shows.
TEST(ModelAtGain, NeverAcrossABreakThatThePhysicsPartKnows) {
  NoiseModel model = testing::full_model();
  model.gaussian.clear();
  for (const double gain_db : {0.0, 6.0, 12.0}) {
    GaussianCalibration gaussian;
    gaussian.gain = db(gain_db);
    gaussian.slope_dn.assign(2, 0.4 * std::pow(10.0, gain_db / 20));
    gaussian.offset_dn2 = gaussian.bias_dn = {1.0, 1.0};
    model.gaussian.push_back(gaussian);
  }
  EXPECT_NO_THROW((void)model.gaussian_at(db(3)));
  EXPECT_NO_THROW((void)model.gaussian_at(db(9)));
  JointSegment low, high;
  low.knots_db = {0, 6};
  high.knots_db = {12};
  model.joint->segments = {low, high};
  EXPECT_NO_THROW((void)model.gaussian_at(db(3)));
  EXPECT_NE(problem_of([&] { (void)model.gaussian_at(db(9)); }).find("between 6 dB and 12 dB"),
            std::string::npos);
}

TEST(BuiltinModels, AreConsistentAndFoundByName) {
  ASSERT_GE(builtin_models().size(), 7U);
  for (const BuiltinModel& entry : builtin_models()) {
    const NoiseModel model = load_model(entry.name);
    EXPECT_EQ(contradiction_in(model), "") << entry.name;
    EXPECT_EQ(load_model("builtin:" + entry.name), model);
    EXPECT_FALSE(model.origin.empty());
    EXPECT_FALSE(entry.licence.empty());
    ASSERT_TRUE(model.joint.has_value());
    EXPECT_EQ(model.joint->segments.size(), entry.name == "sony-a7s2" ? 2U : 1U) << entry.name;
  }
  EXPECT_NE(problem_of([] { (void)load_model("builtin:sony-a7s3"); }).find("sony-a7s2"),
            std::string::npos);
}

// ELD's laws are given over K: the model made of them reproduces a law at a gain between.
TEST(BuiltinModels, EldLawsAreReproduced) {
  const NoiseModel model = load_model("canon-5d4");
  const PhysicsNoise noise = model.physics_at(iso(1131));
  const double K = noise.channels[0].gain_dn_per_e;
  EXPECT_NEAR(K, 0.2181895124454343 * 11.31, 1e-6);
  EXPECT_NEAR(noise.channels[2].sigma_tl_dn,
              std::exp(0.6558756156508007 * std::log(K) + 1.09268679594838), 1e-5);
  EXPECT_NEAR(noise.channels[2].sigma_row_dn,
              std::exp(0.4712797750747537 * std::log(K) - 0.8078958947116487), 1e-5);
}

// χ² bounds by Wilson and Hilferty's cube-root normal, at two-sided level 1e-4 (|z| < 3.89).
void expect_chi_squared(double value, double degrees, const char* what) {
  const double scale = 2.0 / (9.0 * degrees);
  const double z = (std::cbrt(value / degrees) - (1.0 - scale)) / std::sqrt(scale);
  EXPECT_LT(std::abs(z), 3.89) << what << ": " << value << " on " << degrees;
}

// Draws against their Gaussian: Mahalanobis distance of the mean, total of the squares, and the
// sum of the squared correlations of whitened draws. Whitened by an independent Cholesky factor.
void expect_gaussian(const std::vector<Values>& draws, const Values& mean,
                     const SquareMatrix& cov) {
  const auto n = mean.size();
  SquareMatrix l(cov.n);
  for (int j = 0; j < cov.n; ++j)
    for (int i = j; i < cov.n; ++i) {
      double sum = cov(i, j);
      for (int k = 0; k < j; ++k) sum -= l(i, k) * l(j, k);
      l(i, j) = i == j ? std::sqrt(sum) : sum / l(j, j);
    }
  Values first(n, 0.0);
  SquareMatrix second(cov.n);
  for (const Values& draw : draws) {
    Values z(n);
    for (int i = 0; i < cov.n; ++i) {
      double sum = draw[static_cast<std::size_t>(i)] - mean[static_cast<std::size_t>(i)];
      for (int k = 0; k < i; ++k) sum -= l(i, k) * z[static_cast<std::size_t>(k)];
      z[static_cast<std::size_t>(i)] = sum / l(i, i);
      first[static_cast<std::size_t>(i)] += z[static_cast<std::size_t>(i)];
    }
    for (int i = 0; i < cov.n; ++i)
      for (int k = 0; k <= i; ++k)
        second(i, k) += z[static_cast<std::size_t>(i)] * z[static_cast<std::size_t>(k)];
  }
  const auto count = static_cast<double>(draws.size());
  double distance = 0, total = 0, cross = 0;
  for (double sum : first) distance += sum * sum / count;
  for (int i = 0; i < cov.n; ++i) {
    total += second(i, i);
    for (int k = 0; k < i; ++k) cross += second(i, k) * second(i, k) / count;
  }
  const auto d = static_cast<double>(n);
  expect_chi_squared(distance, d, "mean");
  expect_chi_squared(total, d * count, "variance");
  expect_chi_squared(cross, d * (d - 1) / 2, "correlation");
}

TEST(ModelSampling, DrawsFollowEquations5And6) {
  const NoiseModel model = load_model("imx250myr-simulated");
  for (double gain_db : {24.0, 15.0}) {  // measured, and from the joint model
    const GainParameters p = model.parameters_at(db(gain_db));
    std::vector<Values> mu, row, read;
    SquareMatrix read_covariance(16);
    for (int c = 0; c < 16; ++c)
      read_covariance(c, c) = std::pow(p.sigma_tl_spread_dn[static_cast<std::size_t>(c)], 2);
    for (std::uint32_t frame = 0; frame < 3000; ++frame) {
      const PhysicsNoise noise = model.sample_physics_at(db(gain_db), 11, frame);
      mu.emplace_back();
      row.emplace_back();
      read.emplace_back();
      for (const PhysicsChannel& channel : noise.channels) {
        mu.back().push_back(channel.mu_dn);
        row.back().push_back(channel.sigma_row_dn);
        read.back().push_back(channel.sigma_tl_dn);
      }
      EXPECT_EQ(noise.channels[3].gain_dn_per_e, p.K[3]);
      EXPECT_EQ(noise.channels[3].lambda, p.lambda[3]);
    }
    expect_gaussian(mu, p.mu_dn, p.mu_covariance);
    expect_gaussian(row, p.sigma_row_dn, p.sigma_row_covariance);
    expect_gaussian(read, p.sigma_tl_dn, read_covariance);
    EXPECT_GT(p.mu_covariance(0, 2), 0.8 * p.mu_covariance(0, 0));  // R90 and G1_90 share rows
    EXPECT_LT(p.mu_covariance(0, 8), 0.1 * p.mu_covariance(0, 0));  // R90 and G2_90 do not
  }
}

TEST(ModelSampling, IsAFunctionOfSeedAndFrame) {
  const NoiseModel model = load_model("imx250myr-simulated");
  const auto mu = [&](std::uint64_t seed, std::uint32_t frame) {
    return model.sample_physics_at(db(12), seed, frame).channels[0].mu_dn;
  };
  EXPECT_EQ(mu(1, 2), mu(1, 2));
  EXPECT_NE(mu(1, 2), mu(1, 3));
  EXPECT_NE(mu(1, 2), mu(2, 2));
  EXPECT_NE(mu(0, 2), mu(1, 2));
}

// σ_b whose spread is as large as its mean: a Gaussian cut at zero, mean m + s φ(1)/Φ(1).
TEST(ModelSampling, NegativeDeviationsAreDrawnAgain) {
  NoiseModel model = testing::full_model();
  model.physics[0].sigma_row.mean = {0.5, 0.5};
  model.physics[0].sigma_row.covariance = testing::matrix2(0.25, 0.0, 1e-12);
  model.physics[0].sigma_tl.mean = {1.0, 1.0};
  model.physics[0].sigma_tl.spread = {1.0, 0.0};
  Moments row, read;
  for (std::uint32_t frame = 0; frame < 20000; ++frame) {
    const PhysicsNoise noise = model.sample_physics_at(db(0), 5, frame);
    ASSERT_GE(noise.channels[0].sigma_row_dn, 0.0);
    ASSERT_GE(noise.channels[0].sigma_tl_dn, 0.0);
    row.add(noise.channels[0].sigma_row_dn);
    read.add(noise.channels[0].sigma_tl_dn);
    EXPECT_EQ(noise.channels[1].sigma_tl_dn, 1.0);
  }
  constexpr double kShift = 0.24197072451914337 / 0.8413447460685429;  // φ(1)/Φ(1)
  const double deviation = std::sqrt(1.0 - kShift - kShift * kShift);
  const double error = 4.0 * deviation / std::sqrt(20000.0);
  EXPECT_NEAR(row.mean(), 0.5 * (1.0 + kShift), 0.5 * error);
  EXPECT_NEAR(read.mean(), 1.0 + kShift, error);
  EXPECT_NEAR(std::sqrt(read.variance()), deviation, 0.02);
}

// Kolmogorov-Smirnov at level 1e-4 (2.23/√n).
void expect_uniform(Values u) {
  std::sort(u.begin(), u.end());
  double distance = 0;
  const auto n = static_cast<double>(u.size());
  for (std::size_t i = 0; i < u.size(); ++i)
    distance = std::max(
        {distance, u[i] - static_cast<double>(i) / n, static_cast<double>(i + 1) / n - u[i]});
  EXPECT_LT(distance, 2.23 / std::sqrt(n));
}

// Of parameters drawn at the frame's own random gain.
double log_mean_K(const NoiseModel& model, std::uint64_t seed, std::uint32_t frame) {
  const PhysicsNoise noise = model.sample_physics_at(model.random_gain(seed, frame), seed, frame);
  double sum = 0;
  for (const PhysicsChannel& channel : noise.channels) sum += channel.gain_dn_per_e;
  return std::log(sum / static_cast<double>(noise.channels.size()));
}

TEST(ModelSampling, RandomGainIsUniformInLogK) {
  const NoiseModel model = load_model("imx250myr-simulated");
  const JointSegment& s = model.joint->segments[0];
  Values u;
  for (std::uint32_t frame = 0; frame < 3000; ++frame)
    u.push_back((log_mean_K(model, 3, frame) - s.log_K_low()) / (s.log_K_high() - s.log_K_low()));
  expect_uniform(u);
}

TEST(ModelSampling, RandomGainKeepsToTheConversionGains) {
  const NoiseModel model = load_model("sony-a7s2");
  const auto& s = model.joint->segments;
  const double first = s[0].log_K_high() - s[0].log_K_low();
  const double both = first + s[1].log_K_high() - s[1].log_K_low();
  Values u;
  for (std::uint32_t frame = 0; frame < 3000; ++frame) {
    const double log_K = log_mean_K(model, 4, frame);
    const bool low = log_K < 0.5 * (s[0].log_K_high() + s[1].log_K_low());
    if (low)
      EXPECT_LE(log_K, s[0].log_K_high() + 1e-9);
    else
      EXPECT_GE(log_K, s[1].log_K_low() - 1e-9);
    u.push_back((low ? log_K - s[0].log_K_low() : first + log_K - s[1].log_K_low()) / both);
  }
  expect_uniform(u);
}

TEST(ModelSampling, RandomGainWithoutAJointModelIsAMeasuredOne) {
  NoiseModel model = testing::full_model();
  model.joint.reset();
  Values counts(3, 0.0);
  for (std::uint32_t frame = 0; frame < 300; ++frame)
    counts.at(static_cast<std::size_t>(*model.random_gain(1, frame).gain_db / 6.0)) += 1;
  for (double count : counts) EXPECT_NEAR(count, 100, 40);
}

}  // namespace
}  // namespace malus
