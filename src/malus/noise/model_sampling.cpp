// Random parameters of a frame (000 Eq. 5-6) and random gains.
#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr int kMaxRedraws = 32;
// Index of RandomSequence per parameter: redrawing one leaves the others as they are.
enum ParameterStream : std::uint64_t { kStreamMu, kStreamSigmaRow, kStreamSigmaTl, kStreamGain };

bool any_negative(const std::vector<double>& values) {
  return std::any_of(values.begin(), values.end(), [](double v) { return v < 0; });
}

std::vector<double> draw_deviations(const std::vector<double>& mean, const SquareMatrix& covariance,
                                    RandomSequence& random) {
  std::vector<double> draw = draw_gaussian(mean, covariance, random);
  for (int i = 0; i < kMaxRedraws && any_negative(draw); ++i)
    draw = draw_gaussian(mean, covariance, random);
  for (double& v : draw) v = std::max(v, 0.0);
  return draw;
}

double draw_deviation(double mean, double spread, RandomSequence& random) {
  double draw = mean + spread * random.normal();
  for (int i = 0; i < kMaxRedraws && draw < 0; ++i) draw = mean + spread * random.normal();
  return std::max(draw, 0.0);
}

GainSetting gain_like(const GainSetting& example, double db) {
  GainSetting gain;
  if (example.gain_db)
    gain.gain_db = db;
  else
    gain.iso = 100.0 * std::pow(10.0, db / 20.0);
  return gain;
}

}  // namespace

PhysicsNoise NoiseModel::sample_physics_at(const GainSetting& gain, std::uint64_t seed,
                                           std::uint32_t frame, GainRange range) const {
  GainParameters p = parameters_at(gain, range);
  RandomSequence mu_draws(seed, frame, Draw::kParameters, kStreamMu);
  p.mu_dn = draw_gaussian(p.mu_dn, p.mu_covariance, mu_draws);
  RandomSequence row_draws(seed, frame, Draw::kParameters, kStreamSigmaRow);
  p.sigma_row_dn = draw_deviations(p.sigma_row_dn, p.sigma_row_covariance, row_draws);
  RandomSequence read_draws(seed, frame, Draw::kParameters, kStreamSigmaTl);
  for (std::size_t c = 0; c < p.sigma_tl_dn.size(); ++c)
    p.sigma_tl_dn[c] = draw_deviation(p.sigma_tl_dn[c], p.sigma_tl_spread_dn[c], read_draws);
  return physics_of(*this, p);
}

GainSetting NoiseModel::random_gain(std::uint64_t seed, std::uint32_t frame) const {
  if (physics.empty())
    throw InputError(sensor.empty() ? "noise model" : sensor,
                     "holds no physics model to draw a gain from", "calibrate with --kind physics");
  RandomSequence random(seed, frame, Draw::kParameters, kStreamGain);
  const double u = random.uniform();
  double length = 0;
  if (joint)
    for (const auto& segment : joint->segments)
      length += segment.log_K_high() - segment.log_K_low();
  if (length <= 0)
    return physics[static_cast<std::size_t>(u * static_cast<double>(physics.size()))].gain;
  double rest = u * length;
  for (const auto& segment : joint->segments) {
    const double span = segment.log_K_high() - segment.log_K_low();
    if (rest <= span)
      return gain_like(physics[0].gain, gain_db_of_log_K(segment, segment.log_K_low() + rest));
    rest -= span;
  }
  return physics.back().gain;
}

PhysicsNoise NoiseModel::sample_physics_at_random_gain(std::uint64_t seed,
                                                       std::uint32_t frame) const {
  return sample_physics_at(random_gain(seed, frame), seed, frame);
}

}  // namespace malus
