#include "malus/noise/joint_gain.h"

#include "malus/base/statistics.h"
#include "malus/noise/internal/gain_law.h"
#include "malus/noise/internal/table_at.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include <fmt/format.h>

namespace malus {
namespace {

using Values = std::vector<double>;

using internal::fit_law;
using internal::fit_line_law;
using internal::is_power_of_K;
using internal::Logarithm;
using internal::Series;

double entry(const Values& values, std::size_t c) {
  return c < values.size() && std::isfinite(values[c]) ? values[c] : 0.0;
}

// sd of the sampling error of a standard deviation estimated from n frames.
double deviation_error(double deviation, int frames) {
  return frames > 1 ? deviation / std::sqrt(2.0 * (frames - 1)) : 0.0;
}

double frame_variance(const ChannelStatistics& statistics, std::size_t c) {
  const int i = static_cast<int>(c);
  if (statistics.covariance.n > i) return statistics.covariance(i, i);
  const double spread = entry(statistics.spread, c);
  return spread * spread;
}

using Gains = std::vector<const PhysicsCalibration*>;

Series series_of(const Gains& gains,
                 const std::function<std::pair<double, double>(const PhysicsCalibration&)>& get) {
  Series series;
  for (const PhysicsCalibration* gain : gains) {
    const auto [value, error] = get(*gain);
    series.value.push_back(value);
    series.error.push_back(error);
  }
  return series;
}

Series mean_series(const Gains& gains, ChannelStatistics PhysicsCalibration::*parameter,
                   std::size_t c, double sign = 1.0) {
  return series_of(gains, [&](const PhysicsCalibration& gain) {
    const ChannelStatistics& statistics = gain.*parameter;
    return std::pair(sign * entry(statistics.mean, c), entry(statistics.standard_error, c));
  });
}

Series variance_series(const Gains& gains, ChannelStatistics PhysicsCalibration::*parameter,
                       std::size_t c) {
  return series_of(gains, [&](const PhysicsCalibration& gain) {
    const double variance = frame_variance(gain.*parameter, c);
    return std::pair(variance, 2.0 * deviation_error(variance, gain.bias_frames));
  });
}

double mean_K(const PhysicsCalibration& gain) { return mean_of(gain.K.mean); }

Series log_K_series(const Gains& gains) {
  return series_of(gains, [](const PhysicsCalibration& gain) {
    double error2 = 0;
    for (double e : gain.K.standard_error) error2 += std::isfinite(e) ? e * e : 0.0;
    const double mean = mean_K(gain);
    const double error = std::sqrt(error2) / static_cast<double>(gain.K.mean.size());
    return std::pair(std::log(mean), error / mean);
  });
}

// The correlation matrix averaged over the gains that have one, projected; says so when that moved
// an entry visibly.
SquareMatrix joint_correlation(const Gains& gains, ChannelStatistics PhysicsCalibration::*parameter,
                               int channels, const char* symbol, std::vector<std::string>& notes) {
  constexpr double kVisible = 0.01;
  SquareMatrix mean(channels);
  int used = 0;
  for (const PhysicsCalibration* gain : gains) {
    const SquareMatrix& covariance = (gain->*parameter).covariance;
    if (covariance.n != channels) continue;
    const SquareMatrix correlation = correlation_of(covariance);
    for (std::size_t i = 0; i < mean.values.size(); ++i) mean.values[i] += correlation.values[i];
    ++used;
  }
  if (used == 0) return SquareMatrix::identity(channels);
  for (double& value : mean.values) value /= used;
  const SquareMatrix nearest = nearest_correlation(mean);
  const double moved = largest_difference(mean, nearest);
  if (moved > kVisible)
    notes.push_back(fmt::format(
        "the correlation matrix of {} was not positive semi-definite; the nearest one differs by "
        "up to {:.3f}",
        symbol, moved));
  return nearest;
}

// One kind of law for all channels: two kinds would differ between the gains, as a colour.
void fit_bias(const Gains& gains, JointSegment& segment, std::vector<std::string>& notes) {
  std::vector<Series> minus_mu;
  std::size_t others = 0;
  for (std::size_t c = 0; c < segment.K_ratio.size(); ++c) {
    minus_mu.push_back(mean_series(gains, &PhysicsCalibration::mu, c, -1.0));
    const Values& value = minus_mu.back().value;
    const auto [lowest, highest] = std::minmax_element(value.begin(), value.end());
    others += *lowest != *highest && !is_power_of_K(segment.knots_log_K, minus_mu.back());
  }
  for (const Series& series : minus_mu)
    segment.minus_mu.push_back(
        fit_law(segment.knots_log_K, series, others > 0 ? Logarithm::kNone : Logarithm::kOfAll));
  if (others > 0)
    notes.push_back(fmt::format(
        "from {} to {} -mu is no power of K in {} of {} channels (it is near 0 or "
        "changes its sign at a gain, or is a line in K): linear in K between the gains",
        gains.front()->gain.text(), gains.back()->gain.text(), others, minus_mu.size()));
}

JointSegment fit_segment(const Gains& gains, std::vector<std::string>& notes) {
  const auto channels = gains[0]->K.mean.size();
  JointSegment segment;
  for (const PhysicsCalibration* gain : gains) {
    segment.knots_db.push_back(*gain->gain.decibel());
    segment.lambda.push_back(gain->lambda.mean);
    segment.row_drift.push_back(gain->row_drift.drift);
  }
  if (std::all_of(segment.row_drift.begin(), segment.row_drift.end(),
                  [](const RowDrift& drift) { return drift.white(); }))
    segment.row_drift.clear();
  const Series log_K = log_K_series(gains);
  segment.knots_log_K = log_K.value;
  if (gains.size() > 1)
    segment.K_of_gain = fit_line_law(segment.knots_db, log_K.value, log_K.error,
                                     std::vector<bool>(gains.size(), true));
  else
    segment.K_of_gain = {.intercept = log_K.value[0], .residual = {0.0}};
  for (std::size_t c = 0; c < channels; ++c) {
    double ratio = 0;
    for (const PhysicsCalibration* gain : gains) ratio += gain->K.mean[c] / mean_K(*gain);
    segment.K_ratio.push_back(ratio / static_cast<double>(gains.size()));
    const auto fit = [&](const Series& series) {
      return fit_law(segment.knots_log_K, series, Logarithm::kOfPositive);
    };
    using P = PhysicsCalibration;
    segment.mu_variance.push_back(fit(variance_series(gains, &P::mu, c)));
    segment.sigma_row.push_back(fit(mean_series(gains, &P::sigma_row, c)));
    segment.sigma_row_variance.push_back(fit(variance_series(gains, &P::sigma_row, c)));
    segment.sigma_tl.push_back(fit(mean_series(gains, &P::sigma_tl, c)));
    segment.sigma_tl_spread.push_back(fit(series_of(gains, [&](const P& gain) {
      const double spread = entry(gain.sigma_tl.spread, c);
      return std::pair(spread, deviation_error(spread, gain.bias_frames));
    })));
  }
  fit_bias(gains, segment, notes);
  std::vector<std::string> names;
  for (const PhysicsCalibration* gain : gains) names.push_back(gain->gain.text());
  for (std::string& note : wide_gap_notes(segment, names)) notes.push_back(std::move(note));
  const int n = static_cast<int>(channels);
  segment.mu_correlation = joint_correlation(gains, &PhysicsCalibration::mu, n, "mu", notes);
  segment.sigma_row_correlation =
      joint_correlation(gains, &PhysicsCalibration::sigma_row, n, "sigma_row", notes);
  return segment;
}

// log of the read noise in DN, averaged over the channels; not finite where one's is not known.
double log_read_noise(const PhysicsCalibration& gain) {
  double sum = 0;
  for (std::size_t c = 0; c < gain.sigma_tl.mean.size(); ++c)
    sum += std::log(gain.sigma_tl.mean[c]) +
           0.5 * std::log(tukey_lambda_variance(gain.lambda.mean[c]));
  return sum / static_cast<double>(gain.sigma_tl.mean.size());
}

// Where no logarithm was fitted (is_power_of_K), a bias goes linearly in K between the gains, and
// beyond the outer two.
double signed_value(const LogLinear& law, const JointSegment& segment, double log_K,
                    double gain_db) {
  const auto& knots = segment.knots_log_K;
  if (knots.size() < 2) return law.at(log_K, segment.knots_db, gain_db);
  const auto above =
      std::upper_bound(segment.knots_db.begin() + 1, segment.knots_db.end() - 1, gain_db);
  const auto i = static_cast<std::size_t>(above - segment.knots_db.begin());
  const auto knot = [&](std::size_t k) {
    return law.at(knots[k], segment.knots_db, segment.knots_db[k]);
  };
  const double low_K = std::exp(knots[i - 1]), high_K = std::exp(knots[i]);
  const double share = high_K > low_K ? (std::exp(log_K) - low_K) / (high_K - low_K)
                                      : (gain_db - segment.knots_db[i - 1]) /
                                            (segment.knots_db[i] - segment.knots_db[i - 1]);
  return knot(i - 1) + share * (knot(i) - knot(i - 1));
}

RowDrift drift_at(const JointSegment& segment, double gain_db) {
  const auto& knots = segment.knots_db;
  if (segment.row_drift.empty()) return {};
  const auto above = std::upper_bound(knots.begin(), knots.end(), gain_db);
  if (above == knots.begin()) return segment.row_drift.front();
  if (above == knots.end()) return segment.row_drift.back();
  const auto i = static_cast<std::size_t>(above - knots.begin());
  return interpolated(segment.row_drift[i - 1], segment.row_drift[i],
                      (gain_db - knots[i - 1]) / (knots[i] - knots[i - 1]));
}

}  // namespace

double LogLinear::law(double log_K) const {
  const double y = intercept + slope * log_K;
  return signed_linear ? y : std::exp(y);
}

double LogLinear::at(double x, std::span<const double> knots_db, double gain_db) const {
  const double y =
      intercept + slope * x + residual_weight * internal::table_at(knots_db, residual, gain_db);
  return signed_linear ? y : std::exp(y);
}

Estimate<JointGainModel> fit_joint_model(const std::vector<PhysicsCalibration>& all) {
  JointGainModel model;
  Gains gains;
  for (const PhysicsCalibration& gain : all) {
    if (gain.K.mean.empty() || !gain.gain.decibel())
      model.notes.push_back(fmt::format("{} is left out of the joint model: {}", gain.gain.text(),
                                        gain.K.mean.empty() ? "no K" : "its gain is unknown"));
    else
      gains.push_back(&gain);
  }
  if (gains.size() < 2)
    return Undecided{fmt::format("the joint model over gain needs K at 2 gains or more; {} found",
                                 gains.size())};
  Values db, log_K, noise;
  for (const PhysicsCalibration* gain : gains) {
    db.push_back(*gain->gain.decibel());
    log_K.push_back(std::log(mean_K(*gain)));
    noise.push_back(log_read_noise(*gain));
  }
  auto from = gains.begin();
  for (int i : conversion_gain_breaks(db, log_K, noise)) {
    const auto to = gains.begin() + i + 1;
    const auto k = static_cast<std::size_t>(i);
    const double noise_step = noise[k + 1] - noise[k];
    model.notes.push_back(fmt::format(
        "the sensor changes its conversion gain between {} and {}: {}K x{:.2f}",
        (*(to - 1))->gain.text(), (*to)->gain.text(),
        std::isfinite(noise_step) ? fmt::format("read noise x{:.2f}, ", std::exp(noise_step)) : "",
        std::exp(log_K[k + 1] - log_K[k])));
    model.segments.push_back(fit_segment({from, to}, model.notes));
    from = to;
  }
  model.segments.push_back(fit_segment({from, gains.end()}, model.notes));
  return model;
}

double gain_db_of_log_K(const JointSegment& segment, double log_K) {
  double low = segment.knots_db.front(), high = segment.knots_db.back();
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (segment.K_of_gain.at(middle, segment.knots_db, middle) < std::exp(log_K) ? low : high) =
        middle;
  }
  return 0.5 * (low + high);
}

PhysicsCalibration calibration_of(const GainParameters& parameters) {
  PhysicsCalibration entry;
  entry.gain = parameters.gain;
  entry.K.mean = parameters.K;
  entry.mu.mean = parameters.mu_dn;
  entry.mu.covariance = parameters.mu_covariance;
  entry.sigma_row.mean = parameters.sigma_row_dn;
  entry.sigma_row.covariance = parameters.sigma_row_covariance;
  entry.sigma_tl.mean = parameters.sigma_tl_dn;
  entry.sigma_tl.spread = parameters.sigma_tl_spread_dn;
  entry.lambda.mean = parameters.lambda;
  entry.row_drift.drift = parameters.row_drift;
  return entry;
}

GainParameters joint_parameters(const JointSegment& segment, double gain_db) {
  const double K = segment.K_of_gain.at(gain_db, segment.knots_db, gain_db);
  const double log_K = std::log(K);
  const auto value = [&](const LogLinear& law) {
    return law.signed_linear ? signed_value(law, segment, log_K, gain_db)
                             : law.at(log_K, segment.knots_db, gain_db);
  };
  GainParameters p;
  Values mu_deviation, row_deviation;
  for (std::size_t c = 0; c < segment.K_ratio.size(); ++c) {
    p.K.push_back(K * segment.K_ratio[c]);
    p.mu_dn.push_back(0.0 - value(segment.minus_mu[c]));
    p.sigma_row_dn.push_back(value(segment.sigma_row[c]));
    p.sigma_tl_dn.push_back(value(segment.sigma_tl[c]));
    p.sigma_tl_spread_dn.push_back(value(segment.sigma_tl_spread[c]));
    mu_deviation.push_back(std::sqrt(value(segment.mu_variance[c])));
    row_deviation.push_back(std::sqrt(value(segment.sigma_row_variance[c])));
    Values lambda;
    for (const Values& knot : segment.lambda) lambda.push_back(knot[c]);
    p.lambda.push_back(internal::table_at(segment.knots_db, lambda, gain_db));
  }
  p.mu_covariance = covariance_of(segment.mu_correlation, mu_deviation);
  p.sigma_row_covariance = covariance_of(segment.sigma_row_correlation, row_deviation);
  p.row_drift = drift_at(segment, gain_db);
  return p;
}

}  // namespace malus
