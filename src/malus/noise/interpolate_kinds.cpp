#include "malus/noise/interpolate_kinds.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/noise/internal/table_at.h"
#include "malus/noise/joint_gain.h"
#include "malus/noise/level_noise.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

using Values = std::vector<double>;

double share(const GainSetting& low, const GainSetting& high, const GainSetting& gain) {
  const double t = (*gain.decibel() - *low.decibel()) / (*high.decibel() - *low.decibel());
  MALUS_REQUIRE(t >= 0 && t <= 1);
  return t;
}

double mixed(double low, double high, double t) {
  if (low > 0 && high > 0) return std::exp((1 - t) * std::log(low) + t * std::log(high));
  return (1 - t) * low + t * high;
}

Values mixed(const Values& low, const Values& high, double t) {
  Values out;
  if (low.size() != high.size()) return out;
  for (std::size_t c = 0; c < low.size(); ++c) out.push_back(mixed(low[c], high[c], t));
  return out;
}

// A bias is the converter's offset plus what the amplifier makes of the pixel's: linear in K
// (joint_gain.h does the same where its law is no power of K).
Values mixed_bias(const GaussianCalibration& low, const GaussianCalibration& high,
                  const Values& slope_dn) {
  Values out;
  for (std::size_t c = 0; c < std::min(low.bias_dn.size(), high.bias_dn.size()); ++c) {
    const double range_dn = high.slope_dn[c] - low.slope_dn[c];
    const double t = range_dn != 0 ? (slope_dn[c] - low.slope_dn[c]) / range_dn : 0.5;
    out.push_back((1 - t) * low.bias_dn[c] + t * high.bias_dn[c]);
  }
  return out;
}

// (1-t) Q_low + t Q_high on the probabilities where either bends.
Cumulative quantile_mean(const Cumulative& low, const Cumulative& high, double t) {
  Cumulative out;
  std::merge(low.p.begin(), low.p.end(), high.p.begin(), high.p.end(), std::back_inserter(out.p));
  out.p.erase(std::unique(out.p.begin(), out.p.end()), out.p.end());
  for (double p : out.p)
    out.x.push_back((1 - t) * internal::table_at(low.p, low.x, p) +
                    t * internal::table_at(high.p, high.x, p));
  return out;
}

Values common_levels(const NonparametricChannel& low, const NonparametricChannel& high) {
  const double from = std::max(low.level_dn.front(), high.level_dn.front());
  const double to = std::min(low.level_dn.back(), high.level_dn.back());
  Values all;
  std::merge(low.level_dn.begin(), low.level_dn.end(), high.level_dn.begin(), high.level_dn.end(),
             std::back_inserter(all));
  all.erase(std::unique(all.begin(), all.end()), all.end());
  std::erase_if(all, [&](double level) { return level < from || level > to; });
  if (all.empty()) all.push_back(from);  // no common range: the ends meet
  return all;
}

std::int64_t fewest_samples(const NonparametricChannel& channel) {
  return channel.samples.empty()
             ? 0
             : *std::min_element(channel.samples.begin(), channel.samples.end());
}

// The i-th of `bins` + 1 edges that divide a channel's bins as evenly as their number allows.
double edge_of(const NonparametricChannel& channel, std::size_t i, std::size_t bins) {
  const Values& edges = channel.bin_edges_dn;
  const double at =
      static_cast<double>(i) * static_cast<double>(edges.size() - 1) / static_cast<double>(bins);
  const std::size_t below = std::min(static_cast<std::size_t>(at), edges.size() - 2);
  return edges[below] + (at - static_cast<double>(below)) * (edges[below + 1] - edges[below]);
}

// Edge by edge as the quantiles of the darkest level are mixed: bins that are fine for the dark
// noise of both gains are fine for what lies between them. Ends at first and last.
Values mixed_edges(const NonparametricChannel& low, const NonparametricChannel& high, double t,
                   double first_dn, double last_dn) {
  const std::size_t bins = std::max(low.bin_edges_dn.size(), high.bin_edges_dn.size()) - 1;
  Values edges{first_dn};
  for (std::size_t i = 0; i <= bins; ++i) {
    const double edge = (1 - t) * edge_of(low, i, bins) + t * edge_of(high, i, bins);
    if (edge > edges.back() && edge < last_dn) edges.push_back(edge);
  }
  edges.push_back(last_dn);
  return edges;
}

NonparametricChannel interpolated_channel(const NonparametricChannel& low,
                                          const NonparametricChannel& high, double t) {
  NonparametricChannel out;
  out.level_dn = common_levels(low, high);
  std::vector<Cumulative> levels;
  double first = 0, last = 0, darkest_t = t;
  for (double level : out.level_dn) {
    const Cumulative a = noise_at(low, level), b = noise_at(high, level);
    const double sd_a = a.standard_deviation(), sd_b = b.standard_deviation();
    const double sd = mixed(sd_a, sd_b, t);
    const double level_t = sd_a == sd_b ? t : (sd - sd_a) / (sd_b - sd_a);
    if (levels.empty()) darkest_t = level_t;
    levels.push_back(quantile_mean(a, b, level_t));
    first = std::min(first, levels.back().x.front());
    last = std::max(last, levels.back().x.back());
  }
  out.bin_edges_dn = mixed_edges(low, high, darkest_t, first, last);
  const std::size_t bins = out.bin_edges_dn.size() - 1;
  for (const Cumulative& level : levels) {
    Values pmf;
    double below = 0;
    for (std::size_t b = 0; b < bins; ++b) {
      const double upto = b + 1 == bins ? 1.0 : level.below(out.bin_edges_dn[b + 1]);
      pmf.push_back(std::max(upto - below, 0.0));
      below = std::max(below, upto);
    }
    out.pmf.push_back(pmf);
    out.samples.push_back(std::min(fewest_samples(low), fewest_samples(high)));
  }
  return out;
}

}  // namespace

GaussianCalibration interpolated(const GaussianCalibration& low, const GaussianCalibration& high,
                                 const GainSetting& gain) {
  const double t = share(low.gain, high.gain, gain);
  GaussianCalibration out;
  out.gain = gain;
  out.slope_dn = mixed(low.slope_dn, high.slope_dn, t);
  out.offset_dn2 = mixed(low.offset_dn2, high.offset_dn2, t);
  out.bias_dn = mixed_bias(low, high, out.slope_dn);
  out.warnings = {"not measured at this gain: interpolated between " + low.gain.text() + " and " +
                  high.gain.text()};
  return out;
}

NonparametricCalibration interpolated(const NonparametricCalibration& low,
                                      const NonparametricCalibration& high,
                                      const GainSetting& gain) {
  const double t = share(low.gain, high.gain, gain);
  NonparametricCalibration out;
  out.gain = gain;
  for (std::size_t c = 0; c < low.channels.size(); ++c)
    out.channels.push_back(interpolated_channel(low.channels[c], high.channels[c], t));
  out.sigma_row_dn = mixed(low.sigma_row_dn, high.sigma_row_dn, t);
  out.row_drift.drift = interpolated(low.row_drift.drift, high.row_drift.drift, t);
  out.K = mixed(low.K, high.K, t);
  out.warnings = {"not measured at this gain: interpolated between " + low.gain.text() + " and " +
                  high.gain.text()};
  return out;
}

std::vector<int> conversion_gain_breaks(const std::vector<GaussianCalibration>& calibrations) {
  Values db, log_K, log_noise;
  for (const GaussianCalibration& g : calibrations) {
    const double K = mean_of(g.slope_dn), offset = mean_of(g.offset_dn2);
    if (!(K > 0 && offset > 0)) return {};  // clamped fits say nothing about the read noise
    db.push_back(*g.gain.decibel());
    log_K.push_back(std::log(K));
    log_noise.push_back(0.5 * std::log(offset));
  }
  return conversion_gain_breaks(db, log_K, log_noise);
}

std::vector<int> conversion_gain_breaks(const std::vector<NonparametricCalibration>& calibrations) {
  Values db, log_K, log_noise;
  // Logarithms of K and of the gain setting differ by that of K at 0 dB: the two do not mix.
  const bool K_known = std::all_of(
      calibrations.begin(), calibrations.end(),
      [](const NonparametricCalibration& n) { return !n.K.empty() && mean_of(n.K) > 0; });
  for (const NonparametricCalibration& n : calibrations) {
    db.push_back(*n.gain.decibel());
    log_K.push_back(K_known ? std::log(mean_of(n.K)) : kLogPerDb * db.back());
    double sum = 0;
    for (const NonparametricChannel& channel : n.channels)
      sum += 0.5 * std::log(level_moments(channel, 0).variance_dn2);
    log_noise.push_back(sum / static_cast<double>(n.channels.size()));
  }
  return conversion_gain_breaks(db, log_K, log_noise);
}

}  // namespace malus
