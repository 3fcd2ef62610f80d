#include "malus/noise/noise_law.h"

#include "malus/base/error.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/normal_nodes.h"
#include "malus/noise/distribution.h"
#include "malus/noise/level_noise.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

// Below, the Poisson sum; above, three nodes with a Gaussian's moments. For 2 sqrt(n) its skewness
// then costs n^-1.5 / 8 deviations.
constexpr int kPoissonMean = 60;
constexpr double kLeastWeight = 1e-10;  // of a node
constexpr double kNodesApart = 0.05;    // deviations: costs less than 2e-4 of the variance
// Above this many deviations of the read noise nothing of it meets the bend of a stabilisation at
// the signal 0, and three nodes with its moments up to the fifth err by less than 1e-5 deviations,
// if its tails are not heavier than this (logistic: 4.2; normal: 3).
constexpr double kFarDeviations = 8.0, kMostKurtosis = 5.0;

}  // namespace

NoiseLaw::Nodes NoiseLaw::normal_nodes(double deviation) {
  if (!(deviation > 0)) return {{0.0, 1.0}};
  // The trapezoidal rule, which converges faster than any power here.
  constexpr double kStep = 0.25, kLimit = 6.0;
  Nodes nodes;
  double total = 0;
  for (double z = -kLimit; z <= kLimit; z += kStep) {
    nodes.push_back({deviation * z, std::exp(-0.5 * z * z)});
    total += nodes.back().weight;
  }
  for (Node& node : nodes) node.weight /= total;
  return nodes;
}

// One node for all that lie nearer together than this, at their mean.
NoiseLaw::Nodes NoiseLaw::merged(Nodes nodes, double apart_dn) {
  std::sort(nodes.begin(), nodes.end(),
            [](const Node& a, const Node& b) { return a.x_dn < b.x_dn; });
  Nodes result;
  double first_dn = 0;
  for (const Node& node : nodes) {
    if (result.empty() || node.x_dn - first_dn >= apart_dn) {
      result.push_back(node);
      first_dn = node.x_dn;
      continue;
    }
    Node& last = result.back();
    const double weight = last.weight + node.weight;
    last.x_dn += (node.x_dn - last.x_dn) * node.weight / weight;
    last.weight = weight;
  }
  return result;
}

// Of noise that is the same at every signal; symmetric nodes.
void NoiseLaw::set_read_nodes(Nodes nodes, double deviation_dn) {
  double second = 0, fourth = 0;
  for (const Node& node : nodes) {
    const double squared = node.x_dn * node.x_dn;
    second += node.weight * squared;
    fourth += node.weight * squared * squared;
  }
  far_dn_ = kFarDeviations * deviation_dn;
  if (second > 0 && fourth <= kMostKurtosis * second * second) {
    const double x = std::sqrt(fourth / second), weight = 0.5 * second * second / fourth;
    far_nodes_ = {{-x, weight}, {0, 1 - 2 * weight}, {x, weight}};
  }
  nodes_ = {merged(std::move(nodes), kNodesApart * deviation_dn)};
}

// In a single frame the dark signal's differences are read noise.
NoiseLaw NoiseLaw::with_pattern(double prnu, double dsnu_dn) const {
  NoiseLaw law = *this;
  law.prnu_ = prnu;
  if (!(dsnu_dn > 0)) return law;
  for (Nodes& nodes : law.nodes_) {
    Nodes sums;
    double variance_dn2 = dsnu_dn * dsnu_dn;
    for (const Node& node : nodes) {
      variance_dn2 += node.weight * node.x_dn * node.x_dn;
      for (const Node& dark : normal_nodes(dsnu_dn))
        sums.push_back({node.x_dn + dark.x_dn, node.weight * dark.weight});
    }
    const double deviation_dn = std::sqrt(variance_dn2);
    nodes = merged(std::move(sums), kNodesApart * deviation_dn);
    law.far_dn_ = kFarDeviations * deviation_dn;
  }
  if (level_dn_.empty())
    law.set_read_nodes(Nodes(law.nodes_.front()), law.far_dn_ / kFarDeviations);
  return law;
}

NoiseLaw NoiseLaw::gaussian(const VarianceCurve& variance) {
  NoiseLaw law;
  if (const VarianceCurve temporal = variance.temporal(); temporal.is_affine()) {
    law.shot_dn_per_e_ = std::max(temporal.slope_dn(), 0.0);
    law.prnu_ = variance.prnu();
    const double deviation = std::sqrt(std::max(variance(0), 0.0));
    law.set_read_nodes(normal_nodes(deviation), deviation);
  } else {
    law.deviation_ = variance;
    law.nodes_ = {normal_nodes(1.0)};
  }
  return law;
}

NoiseLaw NoiseLaw::physics(const PhysicsChannel& channel, const PhysicsParts& parts,
                           double quantization_dn) {
  NoiseLaw law;
  law.shot_dn_per_e_ = parts.shot ? channel.gain_dn_per_e : 0.0;
  law.lambda_ = channel.lambda;
  law.sigma_tl_dn_ = parts.read ? channel.sigma_tl_dn : 0.0;
  const ReadDistribution read(channel.lambda, parts.read ? channel.sigma_tl_dn : 0.0,
                              parts.quantization ? quantization_dn : 0.0);
  Nodes nodes;
  for (const ReadDistribution::Node& node : read.nodes())
    if (node.weight > kLeastWeight) nodes.push_back({node.x_dn, node.weight});
  law.set_read_nodes(std::move(nodes), std::sqrt(read.variance_dn2()));
  return law;
}

NoiseLaw NoiseLaw::measured(const NonparametricChannel& channel, double bias_dn,
                            double gain_dn_per_e) {
  MALUS_REQUIRE(!channel.level_dn.empty() && channel.level_dn.size() == channel.pmf.size());
  NoiseLaw law;
  law.level_dn_ = channel.level_dn;
  law.brightest_variance_dn2_ = level_moments(channel, channel.pmf.size() - 1).variance_dn2;
  law.gain_above_dn_per_e_ = gain_dn_per_e;
  for (const std::vector<double>& pmf : channel.pmf) {
    Nodes nodes;
    double total = 0;
    for (std::size_t b = 0; b < pmf.size(); ++b) {
      if (!(pmf[b] > 0)) continue;
      const double low = channel.bin_edges_dn[b], high = channel.bin_edges_dn[b + 1];
      // Two nodes have the mean and variance of the uniform bin.
      const double middle = 0.5 * (low + high) - bias_dn,
                   apart = 0.5 * (high - low) / std::numbers::sqrt3;
      nodes.push_back({middle - apart, 0.5 * pmf[b]});
      nodes.push_back({middle + apart, 0.5 * pmf[b]});
      total += pmf[b];
    }
    for (Node& node : nodes) node.weight /= total;
    const double deviation = std::sqrt(level_moments(channel, law.nodes_.size()).variance_dn2);
    law.nodes_.push_back(merged(std::move(nodes), kNodesApart * deviation));
  }
  return law;
}

NoiseLaw NoiseLaw::clipped(const VarianceCurve& variance, double floor_dn, double step_dn) {
  NoiseLaw law = gaussian(variance);
  law.floor_dn_ = floor_dn;
  law.step_dn_ = step_dn;
  const double dark_dn2 = variance(0) - step_dn * step_dn / 12;
  MALUS_REQUIRE(dark_dn2 > 0);
  law.dark_deviation_dn_ = std::sqrt(dark_dn2);
  return law;
}

NoiseLaw NoiseLaw::mean_of(int frames, const VarianceCurve& variance) const {
  MALUS_REQUIRE(frames >= 1);
  NoiseLaw law = gaussian(variance);
  law.lambda_ = lambda_;
  law.sigma_tl_dn_ = sigma_tl_dn_;
  law.frames_ = frames_ * frames;
  return law;
}

// Over the codes that a normal deviate of this deviation about the signal is rounded to.
double NoiseLaw::mean_over_codes(const std::function<double(double)>& f, double signal_dn,
                                 double deviation_dn) const {
  const auto below = [&](double dn) { return normal_cdf((dn - signal_dn) / deviation_dn); };
  constexpr double kReach = 8.0;
  double sum = 0, before = 0;
  for (double code = floor_dn_; before < 1; code += step_dn_) {
    const bool last = code > signal_dn + kReach * deviation_dn;
    const double up_to = last ? 1.0 : below(code + 0.5 * step_dn_);
    sum += f(code) * (up_to - before);
    before = up_to;
  }
  return sum;
}

double NoiseLaw::mean_at(const std::function<double(double)>& f, double signal_dn) const {
  const auto over = [&](const Nodes& nodes, double scale) {
    double sum = 0;
    for (const Node& node : nodes)
      sum += node.weight * f(std::max(signal_dn + scale * node.x_dn, floor_dn_));
    return sum;
  };
  if (is_clipped()) {
    constexpr double kFar = 8.0, kFineStep = 0.1;  // deviations: not cut off; not seen
    const double rounding_dn2 = step_dn_ * step_dn_ / 12;
    const double deviation =
        deviation_ ? std::sqrt((*deviation_)(signal_dn)-rounding_dn2) : dark_deviation_dn_;
    if (step_dn_ > kFineStep * deviation && signal_dn - floor_dn_ < kFar * deviation)
      return mean_over_codes(f, signal_dn, deviation);
  }
  if (deviation_) return over(nodes_.front(), std::sqrt((*deviation_)(signal_dn)));
  if (!far_nodes_.empty() && signal_dn - std::max(floor_dn_, 0.0) > far_dn_)
    return over(far_nodes_, 1.0);
  if (level_dn_.empty() || signal_dn <= level_dn_.front()) return over(nodes_.front(), 1.0);
  if (signal_dn >= level_dn_.back())
    return over(nodes_.back(), spread_above_levels(brightest_variance_dn2_, gain_above_dn_per_e_,
                                                   signal_dn - level_dn_.back()));
  const auto above = static_cast<std::size_t>(
      std::upper_bound(level_dn_.begin(), level_dn_.end(), signal_dn) - level_dn_.begin());
  const double share =
      (signal_dn - level_dn_[above - 1]) / (level_dn_[above] - level_dn_[above - 1]);
  return (1.0 - share) * over(nodes_[above - 1], 1.0) + share * over(nodes_[above], 1.0);
}

// Far out, a mean of heavy-tailed values is one of them, divided by their number.
double NoiseLaw::read_tail(double distance_dn) const {
  MALUS_REQUIRE(distance_dn > 0);
  if (sigma_tl_dn_ > 0)
    return std::min(2 * frames_ * tukey_lambda_cdf(-frames_ * distance_dn / sigma_tl_dn_, lambda_),
                    1.0);
  if (level_dn_.empty()) return 0;
  double sum = 0;
  for (const Node& node : nodes_.front())
    if (std::abs(node.x_dn) > distance_dn) sum += node.weight;
  return sum;
}

std::vector<double> NoiseLaw::expectations(const std::function<double(double)>& f,
                                           const std::vector<double>& signals_dn) const {
  if (!(prnu_ > 0)) return temporal_expectations(f, signals_dn);
  std::vector<double> of_pixels;
  for (const double s : signals_dn)
    for (const NormalNode& node : kNormalNodes)
      of_pixels.push_back(s + node.at * prnu_ * std::max(s, 0.0));
  const std::vector<double> expected = temporal_expectations(f, of_pixels);
  std::vector<double> result(signals_dn.size(), 0.0);
  for (std::size_t i = 0; i < expected.size(); ++i)
    result[i / kNormalNodes.size()] += kNormalNodes[i % kNormalNodes.size()].weight * expected[i];
  return result;
}

std::vector<double> NoiseLaw::temporal_expectations(const std::function<double(double)>& f,
                                                    const std::vector<double>& signals_dn) const {
  std::vector<double> result, of_count;  // of_count[n]: E f(K n + read noise)
  const double K = shot_dn_per_e_;
  for (const double s : signals_dn) {
    if (!(K > 0 && s > 0)) {
      result.push_back(mean_at(f, s));
    } else if (s >= kPoissonMean * K) {
      const double apart = std::sqrt(3.0 * K * s);
      result.push_back((mean_at(f, s - apart) + 4.0 * mean_at(f, s) + mean_at(f, s + apart)) / 6.0);
    } else {
      const double electrons = s / K;
      double sum = 0, probability = std::exp(-electrons);
      for (std::size_t n = 0; n < 3 * kPoissonMean; ++n) {
        if (of_count.size() <= n) of_count.push_back(mean_at(f, K * static_cast<double>(n)));
        sum += probability * of_count[n];
        probability *= electrons / static_cast<double>(n + 1);
      }
      result.push_back(sum);
    }
  }
  return result;
}

}  // namespace malus
