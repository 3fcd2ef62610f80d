#include "malus/calibrate/level_histograms.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kBinsPerDeviation = 6.0, kReachedDeviations = 7.0;
constexpr int kBorrowedLevels = 2;

std::size_t at(std::ptrdiff_t i) { return static_cast<std::size_t>(i); }

}  // namespace

std::vector<double> noise_bin_edges(double smallest_sd_dn, double largest_sd_dn, int bins) {
  MALUS_REQUIRE(bins >= 2 && smallest_sd_dn > 0 && largest_sd_dn >= smallest_sd_dn);
  const double half = 0.5 * bins, reach = kReachedDeviations * largest_sd_dn;
  const double width = smallest_sd_dn / kBinsPerDeviation;
  std::vector<double> edges(at(bins) + 1);
  if (width * half >= reach) {
    for (int i = 0; i <= bins; ++i) edges[at(i)] = reach * (i - half) / half;
    return edges;
  }
  // sinh(a half) / a = reach / width, by bisection: the left side rises with a.
  double low = 1e-9, high = 1.0;
  while (std::sinh(high * half) / high < reach / width) high *= 2;
  for (int i = 0; i < 200; ++i) {
    const double middle = 0.5 * (low + high);
    (std::sinh(middle * half) / middle < reach / width ? low : high) = middle;
  }
  for (int i = 0; i <= bins; ++i) edges[at(i)] = width / low * std::sinh(low * (i - half));
  return edges;
}

LevelHistograms::LevelHistograms(std::vector<double> edges_dn, double step_dn, double range_dn)
    : edges_(std::move(edges_dn)),
      levels_(at(static_cast<std::ptrdiff_t>(range_dn / step_dn) + 2)),
      counts_(levels_.size() * (edges_.size() - 1), 0),
      step_dn_(step_dn) {}

void LevelHistograms::add(double signal_dn, double noise_dn) {
  const double position =
      std::clamp(signal_dn / step_dn_ + 0.5, 0.0, static_cast<double>(levels_.size()) - 0.5);
  const auto level = static_cast<std::size_t>(position);
  const auto above = std::upper_bound(edges_.begin(), edges_.end(), noise_dn);
  const auto bin = std::clamp<std::ptrdiff_t>(above - edges_.begin() - 1, 0,
                                              static_cast<std::ptrdiff_t>(edges_.size()) - 2);
  ++counts_[level * (edges_.size() - 1) + at(bin)];
  ++levels_[level].count;
  levels_[level].signal_sum += signal_dn;
  widest_ = std::max(widest_, std::abs(noise_dn));
}

LevelHistograms::Result LevelHistograms::result(std::int64_t wanted) const {
  Result out;
  const std::size_t bins = edges_.size() - 1;
  out.channel.bin_edges_dn = edges_;
  out.channel.bin_edges_dn.front() = std::min(edges_.front(), -widest_);
  out.channel.bin_edges_dn.back() = std::max(edges_.back(), widest_);
  const auto count = static_cast<std::ptrdiff_t>(levels_.size());
  for (std::ptrdiff_t l = 0; l < count; ++l) {
    if (levels_[at(l)].count == 0) continue;
    Level pooled;
    std::ptrdiff_t radius = 0;
    for (; radius <= kBorrowedLevels; ++radius) {
      for (const std::ptrdiff_t i : {l - radius, l + radius}) {
        if (i < 0 || i >= count || (i == l && pooled.count > 0)) continue;
        pooled.count += levels_[at(i)].count;
        pooled.signal_sum += levels_[at(i)].signal_sum;
      }
      if (pooled.count >= wanted) break;
    }
    radius = std::min<std::ptrdiff_t>(radius, kBorrowedLevels);
    if (pooled.count * 10 < wanted) {
      ++out.refused_levels;
      out.refused_samples += levels_[at(l)].count;
      continue;
    }
    const double centre = pooled.signal_sum / static_cast<double>(pooled.count);
    if (!out.channel.level_dn.empty() && centre <= out.channel.level_dn.back() + 1e-6 * step_dn_)
      continue;  // borrowed the same samples as the level before
    std::vector<double> pmf(bins, 0.0);
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(l - radius, 0);
         i <= std::min(l + radius, count - 1); ++i)
      for (std::size_t b = 0; b < bins; ++b) pmf[b] += counts_[at(i) * bins + b];
    for (double& p : pmf) p /= static_cast<double>(pooled.count);
    out.channel.level_dn.push_back(centre);
    out.channel.samples.push_back(pooled.count);
    out.channel.pmf.push_back(std::move(pmf));
  }
  return out;
}

}  // namespace malus
