#include "malus/noise/joint_gain.h"

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/noise/builtin_models.h"
#include "malus/noise/model.h"
#include "malus/noise/physics.h"

#include <cmath>
#include <functional>
#include <limits>

#include "support.h"
#include <fmt/format.h>

namespace malus {
namespace {

using Values = std::vector<double>;

constexpr double kLogPerDb = 0.11512925464970229;  // ln(10)/20

// A sensor that follows Eq. 7 exactly; error is the relative sampling error of every estimate.
struct JointLaw {
  double K0 = 0.4, error = 0.0;
  int channels = 3;
  double K(double db, int c) const { return K0 * std::exp(kLogPerDb * db) * (1 + 0.01 * c); }
  double mean_K(double db) const {
    return K0 * std::exp(kLogPerDb * db) * (1 + 0.005 * (channels - 1));
  }
  double minus_mu(double db, int c) const { return (0.5 + 0.1 * c) * std::pow(mean_K(db), 1.3); }
  double sigma_row(double db, int c) const { return (0.2 + 0.02 * c) * std::pow(mean_K(db), 0.9); }
  double sigma_tl(double db, int c) const { return (1.2 + 0.1 * c) * std::pow(mean_K(db), 0.8); }
  double mu_sd(double db, int c) const { return (0.02 + 0.003 * c) * std::pow(mean_K(db), 0.7); }
  double lambda(double db) const { return 0.14 - 0.003 * db; }
};

double noisy(double truth, double error, RandomSequence& random) {
  return truth * (1.0 + error * random.normal());
}

PhysicsCalibration measured(const JointLaw& law, double db, std::uint64_t seed = 0) {
  RandomSequence random(seed, static_cast<std::uint32_t>(db * 16), Draw::kOther);
  RandomSequence of_spread(seed, static_cast<std::uint32_t>(db * 16) + 10000, Draw::kOther);
  PhysicsCalibration p;
  p.gain.gain_db = db;
  p.bias_frames = 100;
  Values mu_sd;
  const auto add = [&](ChannelStatistics& s, double truth, double error) {
    s.mean.push_back(noisy(truth, error, random));
    s.standard_error.push_back(std::abs(truth) * error);
  };
  for (int c = 0; c < law.channels; ++c) {
    add(p.K, law.K(db, c), 0.5 * law.error);
    add(p.mu, -law.minus_mu(db, c), law.error);
    add(p.sigma_row, law.sigma_row(db, c), law.error);
    add(p.sigma_tl, law.sigma_tl(db, c), law.error);
    add(p.lambda, law.lambda(db), 0.0);
    mu_sd.push_back(noisy(law.mu_sd(db, c), law.error > 0 ? std::sqrt(1.0 / 198) : 0.0, random));
    p.sigma_row.spread.push_back(
        noisy(0.05 * law.sigma_row(db, c), law.error > 0 ? std::sqrt(1.0 / 198) : 0.0, of_spread));
    p.sigma_tl.spread.push_back(0.01 * law.sigma_tl(db, c));
  }
  p.mu.spread = mu_sd;
  SquareMatrix r = SquareMatrix::identity(law.channels);
  if (law.channels > 1) r(0, 1) = r(1, 0) = 0.9;
  p.mu.covariance = covariance_of(r, mu_sd);
  return p;
}

std::vector<PhysicsCalibration> session(const JointLaw& law, const Values& gains,
                                        std::uint64_t seed = 0) {
  std::vector<PhysicsCalibration> all;
  for (double db : gains) all.push_back(measured(law, db, seed));
  return all;
}

TEST(JointGain, RecoversExactLaws) {
  const JointLaw law;
  const JointGainModel joint = fit_joint_model(session(law, {0, 6, 12, 18, 24, 30})).value();
  ASSERT_EQ(joint.segments.size(), 1U);
  EXPECT_TRUE(joint.notes.empty());
  const JointSegment& s = joint.segments[0];
  EXPECT_NEAR(s.K_of_gain.slope, kLogPerDb, 1e-12);
  EXPECT_NEAR(s.log_K_low(), std::log(law.mean_K(0)), 1e-12);
  EXPECT_NEAR(s.log_K_high(), std::log(law.mean_K(30)), 1e-12);
  for (std::size_t c = 0; c < 3; ++c) {
    const auto i = static_cast<double>(c);
    EXPECT_NEAR(s.K_ratio[c], (1 + 0.01 * i) / 1.01, 1e-12);
    EXPECT_NEAR(s.minus_mu[c].slope, 1.3, 1e-10);
    EXPECT_NEAR(s.minus_mu[c].intercept, std::log(0.5 + 0.1 * i), 1e-10);
    EXPECT_NEAR(s.mu_variance[c].slope, 1.4, 1e-10);
    EXPECT_NEAR(s.mu_variance[c].intercept, 2 * std::log(0.02 + 0.003 * i), 1e-10);
    EXPECT_NEAR(s.sigma_row[c].slope, 0.9, 1e-10);
    EXPECT_NEAR(s.sigma_row_variance[c].slope, 1.8, 1e-10);
    EXPECT_NEAR(s.sigma_tl[c].slope, 0.8, 1e-10);
    EXPECT_NEAR(s.sigma_tl_spread[c].intercept, std::log(0.01 * (1.2 + 0.1 * i)), 1e-10);
    EXPECT_FALSE(s.minus_mu[c].signed_linear);
  }
  EXPECT_NEAR(s.mu_correlation(0, 1), 0.9, 1e-9);
  EXPECT_NEAR(s.mu_correlation(0, 2), 0.0, 1e-9);
}

// Issue: interpolation to a gain left out within 5 % in sigma and K; estimates with 1 % error.
TEST(JointGain, InterpolatesALeftOutGainOfASimulatedLaw) {
  JointLaw law;
  law.error = 0.01;
  const Values gains = {0, 6, 12, 18, 24};
  double worst = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed)
    for (double left_out : {6.0, 12.0, 18.0}) {
      Values rest = gains;
      std::erase(rest, left_out);
      const JointGainModel joint = fit_joint_model(session(law, rest, seed)).value();
      ASSERT_EQ(joint.segments.size(), 1U);
      const GainParameters p = joint_parameters(joint.segments[0], left_out);
      for (std::size_t c = 0; c < 3; ++c) {
        const int i = static_cast<int>(c);
        for (double error :
             {p.K[c] / law.K(left_out, i), p.sigma_tl_dn[c] / law.sigma_tl(left_out, i),
              p.sigma_row_dn[c] / law.sigma_row(left_out, i),
              -p.mu_dn[c] / law.minus_mu(left_out, i)})
          worst = std::max(worst, std::abs(error - 1));
        EXPECT_NEAR(p.lambda[c], law.lambda(left_out), 1e-9);
        // A line through four sd of 7 % each tells one between them to 4.7 %: four standard errors.
        EXPECT_NEAR(p.mu_covariance(i, i) / std::pow(law.mu_sd(left_out, i), 2), 1.0, 0.45);
      }
    }
  EXPECT_LT(worst, 0.05);
  EXPECT_GT(worst, 0.005);  // the errors did reach the estimates
}

// On a true law the residuals are sampling error and must be smoothed away.
TEST(JointGain, ResidualsThatAreErrorsAreLeftOut) {
  JointLaw law;
  law.error = 0.02;
  for (const auto laws :
       {&JointSegment::sigma_tl, &JointSegment::mu_variance, &JointSegment::sigma_row_variance}) {
    Moments weight;
    for (std::uint64_t seed = 0; seed < 60; ++seed) {
      const auto joint = fit_joint_model(session(law, {0, 4, 8, 12, 16, 20, 24, 28}, seed)).value();
      for (const LogLinear& x : joint.segments[0].*laws) weight.add(x.residual_weight);
    }
    EXPECT_LT(weight.mean(), 0.3);
  }
}

// Noise before and after the amplifier: bent in log-log, as real sensors are.
TEST(JointGain, ResidualsThatAreRealAreKept) {
  const auto bent = [](double db) {
    return std::hypot(0.35, 0.8 * std::exp(kLogPerDb * db) * 0.4);
  };
  std::vector<PhysicsCalibration> gains = session({}, {0, 3, 6, 9, 12, 15, 18});
  for (auto& gain : gains) gain.sigma_tl.mean.assign(3, bent(*gain.gain.gain_db));
  for (auto& gain : gains) gain.sigma_tl.standard_error.assign(3, 0.002);
  const JointGainModel joint = fit_joint_model(gains).value();
  ASSERT_EQ(joint.segments.size(), 1U);
  const LogLinear& law = joint.segments[0].sigma_tl[0];
  EXPECT_GT(law.residual_weight, 0.95);
  EXPECT_GT(std::abs(law.law(joint.segments[0].knots_log_K[0]) / bent(0) - 1), 0.05);
  for (double db : {1.5, 7.5, 16.0})
    EXPECT_NEAR(joint_parameters(joint.segments[0], db).sigma_tl_dn[0] / bent(db), 1.0, 0.02);
}

TEST(JointGain, SignedBiasIsFittedWithoutLogarithmAndSaidSo) {
  std::vector<PhysicsCalibration> gains = session({}, {0, 6, 12});
  for (std::size_t g = 0; g < 3; ++g) gains[g].mu.mean[1] = static_cast<double>(g) - 1.0;
  const JointGainModel joint = fit_joint_model(gains).value();
  const JointSegment& s = joint.segments[0];
  for (const LogLinear& law : s.minus_mu) EXPECT_TRUE(law.signed_linear);  // one kind for all
  EXPECT_NEAR(joint_parameters(s, 6.0).mu_dn[1], 0.0, 1e-12);
  ASSERT_EQ(joint.notes.size(), 1U);
  EXPECT_NE(joint.notes[0].find("1 of 3 channels"), std::string::npos);
}

// The converter's offset plus an offset before the amplifier: mu = a + b K, whatever their signs. A
// line in log K through three gains 12 and 24 dB apart was 0.65 DN off 0.4 at 18 dB.
TEST(JointGain, ABiasThatIsNotNegativeFollowsKBetweenTheGains) {
  const JointLaw law;
  for (const double offset : {0.0, 0.2, -0.3, 0.05}) {
    const double per_K = offset == 0.05 ? -0.125 : 0.125;  // -mu just above 0 at 0 dB
    const auto mu = [&](double db) { return offset + per_K * law.mean_K(db); };
    std::vector<PhysicsCalibration> gains = session(law, {0, 12, 36});
    for (auto& gain : gains) {
      gain.mu.mean.assign(3, mu(*gain.gain.gain_db));
      gain.mu.standard_error.assign(3, 1e-4);
    }
    const JointSegment segment = fit_joint_model(gains).value().segments.at(0);
    for (const double db : {-3.0, 3.0, 6.0, 18.0, 24.0, 30.0, 38.0})
      EXPECT_NEAR(joint_parameters(segment, db).mu_dn[0], mu(db), 1e-4 + 1e-3 * std::abs(mu(db)))
          << offset << ' ' << db;
  }
}

// A black level that is right at the lowest gain: -mu = 1 e- K - 0.3 DN, there 0.0004 DN by chance,
// with an error of 0.004. Its logarithm made it -0.009, -0.34 and -13 DN between the gains.
TEST(JointGain, ABiasThatIsZeroWithinItsErrorDoesNotTurnTheLaw) {
  const JointLaw law{.K0 = 0.3, .channels = 1};
  const auto mu = [&](double db) { return 0.3 - law.mean_K(db); };
  std::vector<PhysicsCalibration> gains = session(law, {0, 12, 24, 36});
  for (auto& gain : gains) {
    gain.mu.mean = {mu(*gain.gain.gain_db)};
    gain.mu.standard_error = {0.004 * std::exp(kLogPerDb * *gain.gain.gain_db)};
    gain.mu.covariance = {};
  }
  for (const double by_chance : {0.0004, 0.0, -0.0004}) {
    gains[0].mu.mean = {-by_chance};
    const JointGainModel joint = fit_joint_model(gains).value();
    ASSERT_EQ(joint.segments.size(), 1U);
    for (const double db : {6.0, 18.0, 30.0})
      EXPECT_NEAR(joint_parameters(joint.segments[0], db).mu_dn[0] / mu(db), 1, 0.005) << db;
  }
}

// Errors of the bias in DN, as of 20 frames: 0.016 at 0 dB, 0.5 at 36 dB.
double bias_error(double db) { return std::hypot(0.014, 0.008 * std::exp(kLogPerDb * db)); }

// rms over 100 sessions of the joint model's error at a gain, in bias_error there. The errors of
// the knots in `unknown` are not told.
double relative_bias_error(const std::function<double(double)>& mu, const Values& dbs, double at,
                           const std::vector<std::size_t>& unknown = {}) {
  Moments square;
  for (std::uint32_t seed = 0; seed < 100; ++seed) {
    RandomSequence random(7, seed, Draw::kOther);
    std::vector<PhysicsCalibration> gains = session({.channels = 1}, dbs);
    for (auto& gain : gains) {
      const double db = *gain.gain.gain_db;
      gain.mu.mean = {mu(db) + bias_error(db) * random.normal()};
      gain.mu.standard_error = {bias_error(db)};
      gain.mu.covariance = {};
    }
    for (const std::size_t i : unknown)
      gains[i].mu.standard_error = {std::numeric_limits<double>::quiet_NaN()};
    const JointSegment segment = fit_joint_model(gains).value().segments.at(0);
    square.add(std::pow((joint_parameters(segment, at).mu_dn[0] - mu(at)) / bias_error(at), 2));
  }
  return std::sqrt(square.mean());
}

// With equal weights the highest gain's error turned the line: 3 dB was 3 errors off, 1.5 dB 4.7.
TEST(JointGain, ABiasBetweenGainsIsAsWellKnownAsAtThem) {
  const Values seven = {0, 6, 12, 18, 24, 30, 36},
               thirteen = {0, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30, 33, 36};
  const auto constant = [](double) { return 0.3; };
  const auto line_in_log = [](double db) { return 0.5 - 0.02 * db; };                 // 0 at 25 dB
  const auto line = [](double db) { return 0.3 - 0.05 * std::exp(kLogPerDb * db); };  // 0 at 16 dB
  for (const std::function<double(double)>& mu :
       {std::function<double(double)>(constant), std::function<double(double)>(line_in_log),
        std::function<double(double)>(line)}) {
    for (const double db : {3.0, 9.0, 21.0, 33.0})
      EXPECT_LT(relative_bias_error(mu, seven, db), 1.3);
    for (const double db : {1.5, 4.5, 25.5}) EXPECT_LT(relative_bias_error(mu, thirteen, db), 1.3);
    for (const std::size_t unknown : {0u, 2u, 6u})
      EXPECT_LT(relative_bias_error(mu, seven, 3, {unknown}), 1.3);
  }
  // Where none is known, the values are kept as they are.
  EXPECT_LT(relative_bias_error(constant, seven, 3, {0, 1, 2, 3, 4, 5, 6}), 1.3);
}

// 2 e- before and 1 DN after the amplifier, as simulated sessions found it: 0.25 DN/e- at 0 dB.
TEST(JointGain, SaysWhereTwoGainsAreTooFarApart) {
  const auto bent = [](double db) { return std::hypot(1.0, 0.5 * std::exp(kLogPerDb * db)); };
  const auto joint_of = [&](const Values& dbs) {
    std::vector<PhysicsCalibration> gains = session({}, dbs);
    for (auto& gain : gains) gain.sigma_tl.mean.assign(3, bent(*gain.gain.gain_db));
    return fit_joint_model(gains).value();
  };
  const JointGainModel far = joint_of({0, 30});
  const double most = joint_parameters(far.segments[0], 15).sigma_tl_dn[0] / bent(15) - 1;
  EXPECT_GT(most, 0.3);
  ASSERT_EQ(far.notes.size(), 1U);
  EXPECT_NE(far.notes[0].find("between 0 dB and 30 dB"), std::string::npos) << far.notes[0];
  EXPECT_NE(far.notes[0].find(fmt::format("up to {:.0f} %", 100 * most)), std::string::npos)
      << far.notes[0];
  EXPECT_TRUE(joint_of({0, 6, 12, 18, 24, 30}).notes.empty());
}

TEST(JointGain, VariancesLostInSamplingErrorDoNotBreakTheLaw) {
  std::vector<PhysicsCalibration> gains = session({}, {0, 6, 12, 18});
  gains[0].mu.covariance(2, 2) = -1e-5;
  const JointGainModel joint = fit_joint_model(gains).value();
  const GainParameters p = joint_parameters(joint.segments[0], 3.0);
  EXPECT_NEAR(p.mu_covariance(2, 2) / std::pow(JointLaw().mu_sd(3.0, 2), 2), 1.0, 1e-6);
}

TEST(JointGain, FewerThanTwoGainsAreUndecided) {
  EXPECT_FALSE(fit_joint_model(session({}, {6})).decided());
  std::vector<PhysicsCalibration> gains = session({}, {0, 6, 12});
  gains[1].K = {};
  const auto joint = fit_joint_model(gains);
  ASSERT_TRUE(joint.decided());
  EXPECT_EQ(joint->segments[0].knots_db, (Values{0, 12}));
  EXPECT_NE(joint->notes.at(0).find("6 dB"), std::string::npos);
  gains[0].K = {};
  EXPECT_FALSE(fit_joint_model(gains).decided());
}

TEST(ConversionGain, SmoothLawsHaveNoBreak) {
  for (const Values& gains :
       {Values{0, 6, 12, 18}, Values{0, 24}, Values{0, 12, 24}, Values{0, 30, 36}}) {
    Values log_K, flat, proportional, bent;
    for (double db : gains) {
      log_K.push_back(std::log(0.4) + kLogPerDb * db);
      flat.push_back(0.3);
      proportional.push_back(log_K.back());
      bent.push_back(std::log(std::hypot(0.7, std::exp(log_K.back()))));
    }
    for (const Values& noise : {flat, proportional, bent})
      EXPECT_TRUE(conversion_gain_breaks(gains, log_K, noise).empty());
  }
}

// 0 where the converter's step hides it: no step of read noise, and the gains between are those of
// one law. A step of K is still seen there.
TEST(ConversionGain, ReadNoiseThatIsNotKnownIsNoJump) {
  for (const double hidden : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
    std::vector<PhysicsCalibration> gains = session({}, {0, 12, 24, 36});
    gains[0].sigma_tl.mean.assign(3, hidden);
    const JointGainModel joint = fit_joint_model(gains).value();
    ASSERT_EQ(joint.segments.size(), 1U);
    EXPECT_NEAR(joint_parameters(joint.segments[0], 6).sigma_tl_dn[1], JointLaw().sigma_tl(6, 1),
                1e-9);
    for (double& K : gains[0].K.mean) K /= 3;
    const JointGainModel broken = fit_joint_model(gains).value();
    ASSERT_EQ(broken.segments.size(), 2U);
    EXPECT_EQ(broken.notes.at(0),
              "the sensor changes its conversion gain between 0 dB and 12 dB: K x11.94");
  }
}

TEST(ConversionGain, AJumpOfReadNoiseOrOfKIsABreak) {
  const Values gains = {0, 6, 12, 18, 24};
  for (std::size_t at = 0; at + 1 < gains.size(); ++at) {
    const bool end = at == 0 || at + 2 == gains.size();
    Values log_K, noise, jumping_K, falling;
    for (std::size_t i = 0; i < gains.size(); ++i) {
      log_K.push_back(kLogPerDb * gains[i]);
      noise.push_back(0.8 * log_K.back());
      falling.push_back(noise.back() - (i > at ? std::log(end ? 3.0 : 2.0) : 0.0));
      jumping_K.push_back(log_K.back() + (i > at ? std::log(3.0) : 0.0));
    }
    EXPECT_EQ(conversion_gain_breaks(gains, log_K, falling),
              std::vector<int>{static_cast<int>(at)});
    EXPECT_EQ(conversion_gain_breaks(gains, jumping_K, noise).at(0), static_cast<int>(at));
  }
}

// The published A7S2 calibration: the break is found, nothing is interpolated over it, and leaving
// out one ISO at a time predicts it. ISO 50 to 160 are excluded: the camera's noise there does not
// rise with ISO (80 and 160 stand 10 to 40 % above both neighbours), so no interpolation can hit
// it.
TEST(ConversionGain, SonyA7S2LeaveOneIsoOut) {
  const NoiseModel model = load_model("builtin:sony-a7s2");
  ASSERT_EQ(model.joint->segments.size(), 2U);
  EXPECT_NE(model.joint->notes.at(0).find("between ISO 1600 and ISO 2000"), std::string::npos);
  EXPECT_NEAR(std::exp(model.joint->segments[0].log_K_high()), 1.530, 1e-3);
  Values errors;
  for (std::size_t i = 1; i + 1 < model.physics.size(); ++i) {
    const PhysicsCalibration& truth = model.physics[i];
    const double iso = *truth.gain.iso;
    if (iso <= 200 || iso == 1600 || iso == 2000) continue;  // ends of the segments extrapolate
    std::vector<PhysicsCalibration> rest = model.physics;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(i));
    const JointGainModel joint = fit_joint_model(rest).value();
    ASSERT_EQ(joint.segments.size(), 2U) << iso;
    const GainParameters p =
        joint_parameters(joint.segments[iso < 1800 ? 0 : 1], *truth.gain.decibel());
    PhysicsCalibration predicted;
    predicted.sigma_tl.mean = p.sigma_tl_dn;
    predicted.lambda.mean = p.lambda;
    EXPECT_NEAR(p.K[0] / truth.K.mean[0], 1.0, 0.001) << iso;
    EXPECT_NEAR(read_noise_dn(predicted)[0] / read_noise_dn(truth)[0], 1.0, 0.05) << iso;
    EXPECT_NEAR(p.sigma_row_dn[0] / truth.sigma_row.mean[0], 1.0, 0.05) << iso;
    errors.push_back(std::abs(read_noise_dn(predicted)[0] / read_noise_dn(truth)[0] - 1.0));
  }
  EXPECT_EQ(errors.size(), 18U);
  EXPECT_LT(median_of(errors), 0.02);
}

}  // namespace
}  // namespace malus
