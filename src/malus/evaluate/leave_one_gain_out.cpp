#include "malus/evaluate/leave_one_gain_out.h"

#include "malus/base/error.h"
#include "malus/evaluate/divergence.h"
#include "malus/noise/physics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <functional>

namespace malus {
namespace {

using Values = std::vector<double>;

// Of the channels, the largest finite error(predicted, measured), whatever its sign.
template <class Error>
double worst_of(const Values& predicted, const Values& measured, const Error& error_of) {
  double worst = 0;
  for (std::size_t c = 0; c < std::min(predicted.size(), measured.size()); ++c)
    if (const double error = error_of(predicted[c], measured[c]);
        std::isfinite(error) && std::abs(error) > std::abs(worst))
      worst = error;
  return worst;
}

double worst_error(const Values& predicted, const Values& measured) {
  return worst_of(predicted, measured, [](double p, double m) { return p / m - 1; });
}

// sqrt(JSD) of two Tukey-lambda laws of mean 0 as a converter with this step writes them.
double read_distance(double lambda_a, double sigma_a, double lambda_b, double sigma_b,
                     double step_dn) {
  constexpr double kReach = 15, kFinest = 1e-2;  // in standard deviations; finer steps add nothing
  const double sd = std::max(tukey_lambda_deviation(sigma_a, lambda_a),
                             tukey_lambda_deviation(sigma_b, lambda_b));
  const double step = step_dn > 0 ? std::max(step_dn, kFinest * sd) : sd / 8;
  const auto half = static_cast<int>(std::ceil(kReach * sd / step));
  Values a, b;
  double below_a = 0, below_b = 0;
  for (int i = -half; i <= half; ++i) {
    const double edge = (i + 0.5) * step;
    const double upto_a = i == half ? 1 : tukey_lambda_cdf(edge / sigma_a, lambda_a);
    const double upto_b = i == half ? 1 : tukey_lambda_cdf(edge / sigma_b, lambda_b);
    a.push_back(upto_a - below_a);
    b.push_back(upto_b - below_b);
    below_a = upto_a;
    below_b = upto_b;
  }
  return std::sqrt(jsd_bits_of(a, b));
}

double worst_read_distance(const Values& lambda, const Values& sigma,
                           const PhysicsCalibration& truth, double step_dn) {
  double worst = 0;
  for (std::size_t c = 0; c < lambda.size(); ++c)
    worst = std::max(worst, read_distance(lambda[c], sigma[c], truth.lambda.mean[c],
                                          truth.sigma_tl.mean[c], step_dn));
  return worst;
}

template <class Calibration>
NoiseModel without(const NoiseModel& model, std::vector<Calibration> NoiseModel::*part,
                   std::size_t index) {
  NoiseModel rest = sensor_alone(model);
  rest.*part = model.*part;
  (rest.*part).erase((rest.*part).begin() + static_cast<std::ptrdiff_t>(index));
  return rest;
}

template <class Calibration>
const Calibration& nearest(const std::vector<Calibration>& calibrations, const GainSetting& gain) {
  const auto distance = [&](const Calibration& c) {
    return std::abs(*c.gain.decibel() - *gain.decibel());
  };
  return *std::min_element(
      calibrations.begin(), calibrations.end(),
      [&](const Calibration& a, const Calibration& b) { return distance(a) < distance(b); });
}

// The probabilities of a channel at a signal in the bins of another calibration.
Values in_bins_of(const NonparametricChannel& bins, const NonparametricChannel& from,
                  std::size_t level) {
  const Values& edges = from.bin_edges_dn;
  Values out(bins.bin_edges_dn.size() - 1, 0.0);
  for (std::size_t i = 0; i + 1 < edges.size(); ++i) {
    const double width = edges[i + 1] - edges[i];
    for (std::size_t b = 0; b < out.size(); ++b) {
      const bool first = b == 0, last = b + 1 == out.size();  // the outermost bins take the tails
      const double low = first ? edges[i] : std::max(edges[i], bins.bin_edges_dn[b]);
      const double high = last ? edges[i + 1] : std::min(edges[i + 1], bins.bin_edges_dn[b + 1]);
      if (high > low) out[b] += from.pmf[level][i] * (high - low) / width;
    }
  }
  return out;
}

std::size_t nearest_level(const NonparametricChannel& channel, double level_dn) {
  std::size_t best = 0;
  for (std::size_t i = 0; i < channel.level_dn.size(); ++i)
    if (std::abs(channel.level_dn[i] - level_dn) < std::abs(channel.level_dn[best] - level_dn))
      best = i;
  return best;
}

double worst_level_distance(const NonparametricCalibration& predicted,
                            const NonparametricCalibration& truth) {
  double worst = 0;
  for (std::size_t c = 0; c < truth.channels.size(); ++c) {
    const NonparametricChannel& measured = truth.channels[c];
    double sum = 0;
    for (std::size_t level = 0; level < measured.level_dn.size(); ++level)
      sum += jsd_bits_of(in_bins_of(measured, predicted.channels[c],
                                    nearest_level(predicted.channels[c], measured.level_dn[level])),
                         measured.pmf[level]);
    worst = std::max(worst, std::sqrt(sum / static_cast<double>(measured.level_dn.size())));
  }
  return worst;
}

}  // namespace

std::vector<LeftOutGain> leave_one_gain_out_physics(const NoiseModel& model) {
  NoiseModel usable = model;
  std::erase_if(usable.physics,
                [](const PhysicsCalibration& p) { return p.K.mean.empty() || !p.gain.decibel(); });
  if (usable.physics.size() < 3) return {};
  std::vector<LeftOutGain> all;
  for (std::size_t i = 0; i < usable.physics.size(); ++i) {
    const PhysicsCalibration& truth = usable.physics[i];
    NoiseModel rest = without(usable, &NoiseModel::physics, i);
    if (auto joint = fit_joint_model(rest.physics)) rest.joint = joint.value();
    LeftOutGain out;
    out.gain = truth.gain;
    try {
      const GainParameters p = rest.parameters_at(truth.gain);
      PhysicsCalibration predicted;
      predicted.sigma_tl.mean = p.sigma_tl_dn;
      predicted.lambda.mean = p.lambda;
      const PhysicsCalibration& neighbour = nearest(rest.physics, truth.gain);
      out.K_error = worst_error(p.K, truth.K.mean);
      out.read_error = worst_error(read_noise_dn(predicted), read_noise_dn(truth));
      out.row_error = worst_error(p.sigma_row_dn, truth.sigma_row.mean);
      out.mu_error_dn = worst_of(p.mu_dn, truth.mu.mean, std::minus<>());
      out.sqrt_jsd = worst_read_distance(p.lambda, p.sigma_tl_dn, truth, usable.quantization_dn);
      out.sqrt_jsd_nearest = worst_read_distance(neighbour.lambda.mean, neighbour.sigma_tl.mean,
                                                 truth, usable.quantization_dn);
    } catch (const InputError& error) {
      out.why_not = error.problem();
    }
    all.push_back(out);
  }
  return all;
}

std::vector<LeftOutGain> leave_one_gain_out_nonparametric(const NoiseModel& model) {
  if (model.nonparametric.size() < 3) return {};
  std::vector<LeftOutGain> all;
  for (std::size_t i = 0; i < model.nonparametric.size(); ++i) {
    const NonparametricCalibration& truth = model.nonparametric[i];
    const NoiseModel rest = without(model, &NoiseModel::nonparametric, i);
    LeftOutGain out;
    out.gain = truth.gain;
    try {
      const NonparametricCalibration predicted = rest.nonparametric_at(truth.gain);
      out.row_error = worst_error(predicted.sigma_row_dn, truth.sigma_row_dn);
      out.sqrt_jsd = worst_level_distance(predicted, truth);
      out.sqrt_jsd_nearest = worst_level_distance(nearest(rest.nonparametric, truth.gain), truth);
    } catch (const InputError& error) {
      out.why_not = error.problem();
    }
    all.push_back(out);
  }
  return all;
}

}  // namespace malus
