#include "malus/synthesize/renoise.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/noise/distribution.h"
#include "malus/noise/level_noise.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kLevels = 40, kBins = 121;

// Levels whose target has less variance than the source by more than this share are refused; less
// is the noise of the calibration itself.
constexpr double kVarianceSlack = 0.02;

void require_noisier(const std::string& channel, double level_dn, double before, double after) {
  if (after < before * (1 - kVarianceSlack))
    throw InputError(
        "noise on noise",
        fmt::format("channel {} at {:.4g} DN has a variance of {:.4g} DN² and would need {:.4g}",
                    channel, level_dn, before, after),
        "choose a target gain with more noise than the source");
}

// The added noise of one level: p1 and p2 on `bins` equal bins of width_dn around their centres.
LevelDistribution difference(double level_dn, double width_dn, const std::vector<double>& p1,
                             const std::vector<double>& p2) {
  LevelDistribution added;
  added.level_dn = level_dn;
  added.pmf = deconvolve(p1, p2);
  // Bin i of d is a shift by i - middle bins; the uniform spread inside its bin stands for the
  // width that p1 and p2 share.
  const auto middle = static_cast<double>(p1.size()) - 1.0;
  for (std::size_t b = 0; b <= added.pmf.size(); ++b)
    added.bin_edges_dn.push_back(width_dn * (static_cast<double>(b) - middle - 0.5));
  return added;
}

using ChannelLevels = std::vector<std::vector<LevelDistribution>>;

std::vector<double> row_difference(const std::vector<double>& from, const std::vector<double>& to) {
  std::vector<double> added;
  for (std::size_t c = 0; c < to.size(); ++c) {
    const double before = from.empty() ? 0.0 : from[c];
    added.push_back(std::sqrt(std::max(to[c] * to[c] - before * before, 0.0)));
  }
  return added;
}

double sum_of_squares(const std::vector<double>& values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
}

// Drift of the rows to add: autocovariances add, and the added slow part has the target's length.
RowDrift drift_difference(const std::vector<double>& from_dn, const RowDrift& from,
                          const std::vector<double>& to_dn, const RowDrift& to) {
  const double before = sum_of_squares(from_dn), after = sum_of_squares(to_dn);
  if (to.white() || !(after > before)) return {};
  const double share = (after * to.share - before * from.share) / (after - before);
  return share > 0 ? RowDrift{std::min(share, 1.0), to.length_groups} : RowDrift{};
}

// Signal of level l of kLevels, closer together in the dark.
double level_at(double lowest_dn, double highest_dn, std::size_t l) {
  const double share = static_cast<double>(l) / (kLevels - 1);
  return lowest_dn + (highest_dn - lowest_dn) * share * share;
}

// Seven sd of the noisier one to either side, and room for the biases.
double bin_width(double noisier_sd_dn, double mean_before_dn, double mean_after_dn) {
  return 2.0 * (7.0 * noisier_sd_dn + std::abs(mean_before_dn) + std::abs(mean_after_dn)) / kBins;
}

// One channel's noise at both gains.
struct MeasuredPair {
  const NonparametricChannel &one, &two;
  double K_one, K_two;
};

// First and last signal that both gains tell the noise of.
std::pair<double, double> common_signals(const MeasuredPair& pair, const std::string& name,
                                         double white_dn) {
  const double lowest = std::max(pair.one.level_dn.front(), pair.two.level_dn.front());
  double highest = std::min(pair.one.level_dn.back(), pair.two.level_dn.back());
  if (pair.K_one > 0 && pair.K_two > 0) highest = std::max(highest, white_dn);
  if (lowest > highest)
    throw InputError("noise on noise",
                     fmt::format("channel {} has levels from {:.4g} DN on at one gain and up to "
                                 "{:.4g} DN at the other",
                                 name, lowest, highest),
                     "calibrate both gains over the same range of signals");
  return {lowest, highest};
}

LevelDistribution measured_difference(const MeasuredPair& pair, const std::string& name,
                                      double level_dn, double quantization_dn) {
  const Cumulative before = noise_at(pair.one, level_dn, pair.K_one);
  const Cumulative after = noise_at(pair.two, level_dn, pair.K_two);
  const double sd = after.standard_deviation();
  const double rounded_dn2 =
      std::pow(before.standard_deviation(), 2) + quantization_dn * quantization_dn / 12.0;
  require_noisier(name, level_dn, rounded_dn2, sd * sd);
  const double width = bin_width(sd, before.mean(), after.mean());
  // The rounding to come counts as the source's: p1 * rounding * d = p2.
  return difference(level_dn, width, equal_bins(before, width, kBins, quantization_dn),
                    equal_bins(after, width, kBins));
}

ChannelLevels measured_differences(const SensorLayout& layout, const NonparametricCalibration& from,
                                   const NonparametricCalibration& to, double white_dn,
                                   double quantization_dn) {
  MALUS_REQUIRE(static_cast<int>(from.channels.size()) == layout.channels() &&
                static_cast<int>(to.channels.size()) == layout.channels());
  ChannelLevels levels(from.channels.size());
  for (std::size_t c = 0; c < levels.size(); ++c) {
    const MeasuredPair pair{from.channels[c], to.channels[c], gain_of_channel(from, c),
                            gain_of_channel(to, c)};
    const std::string name = layout.channel_name(static_cast<int>(c));
    const auto [lowest, highest] = common_signals(pair, name, white_dn);
    levels[c].resize(highest > lowest ? kLevels : 1);
    parallel_for(
        0, std::ssize(levels[c]), 1,
        [&, low = lowest, high = highest](std::ptrdiff_t begin, std::ptrdiff_t end) {
          for (auto l = static_cast<std::size_t>(begin); l < static_cast<std::size_t>(end); ++l)
            levels[c][l] = measured_difference(pair, name, level_at(low, high, l), quantization_dn);
        });
  }
  return levels;
}

double sd_at(const PhysicsNoise& noise, const PhysicsChannel& channel, double signal_dn) {
  const PixelDistribution pixel(channel, noise.parts, noise.quantization_dn, signal_dn);
  return std::sqrt(pixel.variance_dn2());
}

ChannelLevels physics_differences(const PhysicsNoise& from, const PhysicsNoise& to,
                                  double white_dn) {
  ChannelLevels levels(from.channels.size());
  for (int c = 0; c < from.layout.channels(); ++c) {
    auto& mine = levels[static_cast<std::size_t>(c)];
    mine.resize(kLevels);
    const PhysicsChannel& one = from.channels[static_cast<std::size_t>(c)];
    const PhysicsChannel& two = to.channels[static_cast<std::size_t>(c)];
    const PixelBins before_bins(from, c), after_bins(to, c);
    parallel_for(0, kLevels, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (auto l = static_cast<std::size_t>(begin); l < static_cast<std::size_t>(end); ++l) {
        const double level = level_at(0.0, white_dn, l);
        const double before = sd_at(from, one, level), after = sd_at(to, two, level);
        require_noisier(from.layout.channel_name(c), level, before * before, after * after);
        const double width = bin_width(after, one.mu_dn, two.mu_dn);
        mine[l] = difference(level, width, before_bins.probabilities(level, width, kBins),
                             after_bins.probabilities(level, width, kBins));
      }
    });
  }
  return levels;
}

std::vector<double> row_sigmas(const PhysicsNoise& noise) {
  std::vector<double> sigmas;
  for (const PhysicsChannel& channel : noise.channels)
    sigmas.push_back(noise.parts.row ? channel.sigma_row_dn : 0.0);
  return sigmas;
}

}  // namespace

std::vector<double> deconvolve(const std::vector<double>& p1, const std::vector<double>& p2,
                               int iterations) {
  MALUS_REQUIRE(p1.size() == p2.size() && !p1.empty());
  const std::size_t n = p1.size(), m = 2 * n - 1;
  // Source bins that hold next to nothing move nothing.
  constexpr double kNothing = 1e-12;
  std::size_t first = 0, last = n;
  while (first < n && p1[first] <= kNothing) ++first;
  while (last > first && p1[last - 1] <= kNothing) --last;
  std::vector<double> d(m, 1.0 / static_cast<double>(m)), model(n), ratio(n), gain(m);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    // model[k] = sum over j of p1[j] d[k - j + n - 1]
    std::fill(model.begin(), model.end(), 0.0);
    for (std::size_t j = first; j < last; ++j) {
      const double weight = p1[j];
      const double* shifted = d.data() + (n - 1 - j);
      for (std::size_t k = 0; k < n; ++k) model[k] += weight * shifted[k];
    }
    for (std::size_t k = 0; k < n; ++k) ratio[k] = model[k] > 0 ? p2[k] / model[k] : 0.0;
    // Probability that a shift would push off the bins counts against it: p2 has none there.
    std::fill(gain.begin(), gain.end(), 0.0);
    for (std::size_t j = first; j < last; ++j) {
      const double weight = p1[j];
      double* shifted = gain.data() + (n - 1 - j);
      for (std::size_t k = 0; k < n; ++k) shifted[k] += weight * ratio[k];
    }
    for (std::size_t i = 0; i < m; ++i) d[i] *= gain[i];
  }
  const double total = std::accumulate(d.begin(), d.end(), 0.0);
  for (double& v : d) v /= total;
  return d;
}

PixelBins::PixelBins(const PhysicsNoise& noise, int channel)
    : channel_(noise.channels[static_cast<std::size_t>(channel)]),
      parts_(noise.parts),
      quantization_dn_(noise.quantization_dn) {
  constexpr int kSteps = 2000;
  const ReadDistribution read(channel_.lambda, parts_.read ? channel_.sigma_tl_dn : 0.0,
                              parts_.quantization ? quantization_dn_ : 0.0);
  reach_dn_ = std::max(-read.quantile(1e-9), 1e-9);
  for (int i = 0; i <= kSteps; ++i)
    read_cdf_.push_back(read.cdf(reach_dn_ * (2.0 * i / kSteps - 1.0)));
}

double PixelBins::read_cdf(double x_dn) const {
  const auto steps = static_cast<double>(read_cdf_.size() - 1);
  const double at = (x_dn / reach_dn_ + 1.0) * 0.5 * steps;
  if (at <= 0) return 0.0;
  if (at >= steps) return 1.0;
  const auto i = static_cast<std::size_t>(at);
  return read_cdf_[i] + (at - static_cast<double>(i)) * (read_cdf_[i + 1] - read_cdf_[i]);
}

std::vector<double> PixelBins::probabilities(double signal_dn, double width_dn, int bins) const {
  const PixelDistribution pixel(channel_, parts_, quantization_dn_, signal_dn);
  const auto &level_dn = pixel.levels_dn(), &probability = pixel.probabilities();
  std::vector<double> p;
  double below = 0, passed = 0;  // passed: probability of the levels that lie wholly below the edge
  std::size_t first = 0;
  for (int b = 1; b <= bins; ++b) {
    double cdf = 1;
    if (b < bins) {
      const double edge = signal_dn + width_dn * (b - 0.5 * bins);
      while (first < level_dn.size() && level_dn[first] <= edge - reach_dn_)
        passed += probability[first++];
      cdf = passed;
      for (std::size_t i = first; i < level_dn.size() && level_dn[i] < edge + reach_dn_; ++i)
        cdf += probability[i] * read_cdf(edge - level_dn[i]);
    }
    p.push_back(std::max(cdf - below, 0.0));
    below = cdf;
  }
  return p;
}

DrawAddress second_noise(const DrawAddress& address) {
  // Both noises take all purposes of the counter, so the second one needs another key. Any constant
  // gives one; this one reads "second noise", and no two small seeds differ by it.
  constexpr std::uint64_t kSecondNoise = 0x5EC0'0D00'0015'E000u;
  DrawAddress second = address;
  second.seed ^= kSecondNoise;
  return second;
}

Renoiser::Renoiser(const SensorLayout& layout, const NonparametricCalibration& from,
                   const NonparametricCalibration& to, int row_group, double white_dn,
                   double quantization_dn)
    : sampler_(layout, measured_differences(layout, from, to, white_dn, quantization_dn),
               row_difference(from.sigma_row_dn, to.sigma_row_dn), row_group,
               drift_difference(from.sigma_row_dn, from.row_drift.drift, to.sigma_row_dn,
                                to.row_drift.drift)) {}

Renoiser::Renoiser(const PhysicsNoise& from, const PhysicsNoise& to, double white_dn)
    : sampler_(from.layout, physics_differences(from, to, white_dn),
               row_difference(row_sigmas(from), row_sigmas(to)), to.row_group,
               drift_difference(row_sigmas(from), from.row_drift, row_sigmas(to), to.row_drift)) {}

void Renoiser::apply(View<const float> noisy_dn, View<const float> guide_dn,
                     View<float> renoised_dn, const DrawAddress& address) const {
  sampler_.apply(guide_dn, noisy_dn, renoised_dn, second_noise(address));
}

}  // namespace malus
