// Random parameters of a frame (000 Eq. 5-6) and random gains.
#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/random.h"
#include "malus/noise/interpolate_kinds.h"
#include "malus/noise/model.h"
#include "malus/noise/parameter_sampler.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace malus {
namespace {

constexpr int kMaxRedraws = 32;

bool any_negative(const std::vector<double>& values) {
  return std::any_of(values.begin(), values.end(), [](double v) { return v < 0; });
}

std::vector<double> draw_deviations(const std::vector<double>& mean, const GaussianSampler& sampler,
                                    RandomSequence& random) {
  std::vector<double> draw = sampler.draw(mean, random);
  for (int i = 0; i < kMaxRedraws && any_negative(draw); ++i) draw = sampler.draw(mean, random);
  for (double& v : draw) v = std::max(v, 0.0);
  return draw;
}

double draw_deviation(double mean, double spread, RandomSequence& random) {
  double draw = mean + spread * random.normal();
  for (int i = 0; i < kMaxRedraws && draw < 0; ++i) draw = mean + spread * random.normal();
  return std::max(draw, 0.0);
}

GainSetting gain_like(const GainSetting& example, double db) {
  return GainSetting::at_decibel(db, !example.gain_db);
}

// Uniform choice over intervals: u in (0,1) runs through their joined length.
struct Interval {
  double low, high;
};

struct Place {
  std::size_t interval;
  double value;
};

double total_length(const std::vector<Interval>& intervals) {
  double length = 0;
  for (const Interval& interval : intervals) length += interval.high - interval.low;
  return length;
}

Place place_in(const std::vector<Interval>& intervals, double u) {
  double rest = u * total_length(intervals);
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    const double length = intervals[i].high - intervals[i].low;
    if (rest <= length) return {i, intervals[i].low + rest};
    rest -= length;
  }
  return {intervals.size() - 1, intervals.back().high};
}

template <class Calibration>
GainSetting one_of(const std::vector<Calibration>& calibrations, double u) {
  return calibrations[static_cast<std::size_t>(u * static_cast<double>(calibrations.size()))].gain;
}

double gain_draw(std::uint64_t seed, std::uint32_t frame) {
  return RandomSequence(seed, frame, Draw::kParameters, kStreamGain).uniform();
}

template <class Calibration>
GainSetting random_gain_of(const std::vector<Calibration>& calibrations, double u) {
  const std::vector<int> breaks = conversion_gain_breaks(calibrations);
  std::vector<Interval> unbroken;
  for (std::size_t i = 0; i + 1 < calibrations.size(); ++i)
    if (std::find(breaks.begin(), breaks.end(), static_cast<int>(i)) == breaks.end())
      unbroken.push_back({*calibrations[i].gain.decibel(), *calibrations[i + 1].gain.decibel()});
  if (unbroken.empty()) return one_of(calibrations, u);
  return gain_like(calibrations[0].gain, place_in(unbroken, u).value);
}

}  // namespace

bool are_possible(const GainParameters& p) {
  const auto finite = [](const std::vector<double>& values) {
    return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
  };
  return finite(p.K) && std::all_of(p.K.begin(), p.K.end(), [](double K) { return K > 0; }) &&
         finite(p.lambda) && finite(p.mu_dn) && finite(p.sigma_row_dn) && finite(p.sigma_tl_dn) &&
         finite(p.sigma_tl_spread_dn) && finite(p.mu_covariance.values) &&
         finite(p.sigma_row_covariance.values);
}

ParameterSampler::ParameterSampler(const NoiseModel& model, GainParameters parameters)
    : parameters_(std::move(parameters)),
      mean_(physics_of(model, parameters_)),
      mu_(parameters_.mu_covariance),
      sigma_row_(parameters_.sigma_row_covariance) {}

PhysicsNoise ParameterSampler::draw(std::uint64_t seed, std::uint32_t frame) const {
  RandomSequence mu_draws(seed, frame, Draw::kParameters, kStreamMu);
  const auto mu_dn = mu_.draw(parameters_.mu_dn, mu_draws);
  RandomSequence row_draws(seed, frame, Draw::kParameters, kStreamSigmaRow);
  const auto sigma_row_dn = draw_deviations(parameters_.sigma_row_dn, sigma_row_, row_draws);
  RandomSequence read_draws(seed, frame, Draw::kParameters, kStreamSigmaTl);
  PhysicsNoise noise = mean_;
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    PhysicsChannel& channel = noise.channels[c];
    channel.mu_dn = mu_dn[c];
    channel.sigma_row_dn = sigma_row_dn[c];
    channel.sigma_tl_dn =
        draw_deviation(parameters_.sigma_tl_dn[c], parameters_.sigma_tl_spread_dn[c], read_draws);
  }
  return noise;
}

PhysicsNoise NoiseModel::sample_physics_at(const GainSetting& gain, std::uint64_t seed,
                                           std::uint32_t frame, GainRange range) const {
  return ParameterSampler(*this, parameters_at(gain, range)).draw(seed, frame);
}

GainSetting random_gain(const std::vector<GaussianCalibration>& calibrations, std::uint64_t seed,
                        std::uint32_t frame) {
  return random_gain_of(calibrations, gain_draw(seed, frame));
}

GainSetting random_gain(const std::vector<NonparametricCalibration>& calibrations,
                        std::uint64_t seed, std::uint32_t frame) {
  return random_gain_of(calibrations, gain_draw(seed, frame));
}

GainSetting NoiseModel::random_gain(std::uint64_t seed, std::uint32_t frame) const {
  const double u = gain_draw(seed, frame);
  if (physics.empty()) {
    if (!gaussian.empty()) return random_gain_of(gaussian, u);
    if (!nonparametric.empty()) return random_gain_of(nonparametric, u);
    throw InputError(name(), "holds no model that reaches between gains", "name the gain");
  }
  std::vector<Interval> log_K;
  if (joint)
    for (const auto& segment : joint->segments)
      log_K.push_back({segment.log_K_low(), segment.log_K_high()});
  if (total_length(log_K) <= 0) {
    std::vector<PhysicsCalibration> with_K;
    std::copy_if(physics.begin(), physics.end(), std::back_inserter(with_K),
                 [](const PhysicsCalibration& p) { return !p.K.mean.empty(); });
    return one_of(with_K.empty() ? physics : with_K, u);  // without any, drawing tells why
  }
  const Place place = place_in(log_K, u);
  return gain_like(physics[0].gain, gain_db_of_log_K(joint->segments[place.interval], place.value));
}

}  // namespace malus
