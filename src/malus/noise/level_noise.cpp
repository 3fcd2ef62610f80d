#include "malus/noise/level_noise.h"

#include "malus/base/error.h"
#include "malus/noise/internal/table_at.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

using Values = std::vector<double>;

// The distribution that two levels mix to; t is the upper one's share.
Cumulative mixture(const NonparametricChannel& channel, std::size_t low, std::size_t high,
                   double t) {
  Cumulative out{channel.bin_edges_dn, {0.0}};
  for (std::size_t b = 0; b < channel.pmf[low].size(); ++b)
    out.p.push_back(out.p.back() + (1 - t) * channel.pmf[low][b] + t * channel.pmf[high][b]);
  for (double& p : out.p) p /= out.p.back();
  // Empty bins at the ends are no support.
  const auto first = static_cast<std::ptrdiff_t>(std::upper_bound(out.p.begin(), out.p.end(), 0.0) -
                                                 out.p.begin() - 1);
  const auto end = static_cast<std::ptrdiff_t>(
      std::lower_bound(out.p.begin(), out.p.end(), out.p.back()) - out.p.begin() + 1);
  return {Values(out.x.begin() + first, out.x.begin() + end),
          Values(out.p.begin() + first, out.p.begin() + end)};
}

// Integral of the cumulative function from its start.
class Integral {
 public:
  explicit Integral(const Cumulative& f) : f_(f), sum_{0.0} {
    for (std::size_t i = 1; i < f.x.size(); ++i)
      sum_.push_back(sum_.back() + 0.5 * (f.p[i] + f.p[i - 1]) * (f.x[i] - f.x[i - 1]));
  }
  double to(double x_dn) const {
    if (x_dn <= f_.x.front()) return 0.0;
    if (x_dn >= f_.x.back()) return sum_.back() + (x_dn - f_.x.back());
    const auto i =
        static_cast<std::size_t>(std::upper_bound(f_.x.begin(), f_.x.end(), x_dn) - f_.x.begin());
    return sum_[i - 1] + 0.5 * (f_.p[i - 1] + f_.below(x_dn)) * (x_dn - f_.x[i - 1]);
  }

 private:
  const Cumulative& f_;
  Values sum_;
};

}  // namespace

double Cumulative::below(double x_dn) const { return internal::table_at(x, p, x_dn); }

double Cumulative::mean() const {
  double sum = 0;
  for (std::size_t i = 0; i + 1 < x.size(); ++i) sum += (p[i + 1] - p[i]) * 0.5 * (x[i] + x[i + 1]);
  return sum;
}

double Cumulative::standard_deviation() const {
  const double middle = mean();
  double square = 0;
  for (std::size_t i = 0; i + 1 < x.size(); ++i) {
    const double a = x[i] - middle, b = x[i + 1] - middle;
    square += (p[i + 1] - p[i]) * (a * a + a * b + b * b) / 3.0;
  }
  return std::sqrt(square);
}

double gain_of_channel(const NonparametricCalibration& calibration, std::size_t channel) {
  if (calibration.K.empty()) return 0.0;
  const double K = calibration.K[channel];
  return K > 0 && std::isfinite(K) ? K : 0.0;
}

double spread_above_levels(double variance_dn2, double gain_dn_per_e, double above_dn) {
  if (!(gain_dn_per_e > 0 && variance_dn2 > 0 && above_dn > 0)) return 1.0;
  return std::sqrt(1.0 + gain_dn_per_e * above_dn / variance_dn2);
}

Cumulative noise_at(const NonparametricChannel& channel, double signal_dn, double gain_dn_per_e) {
  const auto above = std::upper_bound(channel.level_dn.begin(), channel.level_dn.end(), signal_dn);
  const auto last = channel.level_dn.size() - 1;
  const auto j = std::min(static_cast<std::size_t>(above - channel.level_dn.begin()), last);
  const auto i = above == channel.level_dn.begin() || above == channel.level_dn.end() ? j : j - 1;
  const double t =
      i == j ? 0.0
             : (signal_dn - channel.level_dn[i]) / (channel.level_dn[j] - channel.level_dn[i]);
  Cumulative out = mixture(channel, i, j, t);
  const LevelMoments brightest = level_moments(channel, last);
  const double spread = spread_above_levels(brightest.variance_dn2, gain_dn_per_e,
                                            signal_dn - channel.level_dn[last]);
  if (spread > 1)
    for (double& x : out.x) x = brightest.mean_dn + spread * (x - brightest.mean_dn);
  return out;
}

bool before_rounding(const NonparametricChannel& channel, std::size_t level, double step_dn) {
  return step_dn > 0 && channel.level_dn[level] == 0;
}

double recorded_variance_dn2(const NonparametricChannel& channel, std::size_t level,
                             double step_dn) {
  return level_moments(channel, level).variance_dn2 +
         (before_rounding(channel, level, step_dn) ? step_dn * step_dn / 12 : 0.0);
}

// In bins that are wide against the step a shift by less than a bin moves more than it should: as
// much of the shifted distribution is taken as brings the variance.
NonparametricChannel as_recorded(NonparametricChannel channel, double step_dn) {
  if (!before_rounding(channel, 0, step_dn)) return channel;
  const double half = 0.5 * step_dn, before = level_moments(channel, 0).variance_dn2;
  const Cumulative dark = mixture(channel, 0, 0, 0.0);
  const Integral integral(dark);
  const Values& edges = channel.bin_edges_dn;
  const Values own = channel.pmf.front();
  Values& pmf = channel.pmf.front();
  double below = 0;
  for (std::size_t b = 0; b < pmf.size(); ++b) {
    const double upto =
        b + 1 == pmf.size()
            ? 1.0
            : (integral.to(edges[b + 1] + half) - integral.to(edges[b + 1] - half)) / step_dn;
    pmf[b] = std::max(upto - below, 0.0);
    below = std::max(below, upto);
  }
  const double added = level_moments(channel, 0).variance_dn2 - before;
  const double share = std::min(added > 0 ? step_dn * step_dn / 12 / added : 1.0, 1.0);
  for (std::size_t b = 0; b < pmf.size(); ++b) pmf[b] = share * pmf[b] + (1 - share) * own[b];
  return channel;
}

std::vector<double> equal_bins(const Cumulative& noise, double width_dn, int bins, double blur_dn) {
  MALUS_REQUIRE(width_dn > 0 && bins > 0 && blur_dn >= 0);
  const Integral integral(noise);
  Values out;
  double below = 0;
  for (int b = 1; b <= bins; ++b) {
    const double edge = width_dn * (b - 0.5 * bins);
    const double upto =
        b == bins ? 1.0
        : blur_dn > 0
            ? (integral.to(edge + 0.5 * blur_dn) - integral.to(edge - 0.5 * blur_dn)) / blur_dn
            : noise.below(edge);
    out.push_back(std::max(upto - below, 0.0));
    below = std::max(below, upto);
  }
  return out;
}

std::vector<LevelRange> level_ranges(const NonparametricCalibration& calibration) {
  std::vector<LevelRange> ranges;
  for (std::size_t c = 0; c < calibration.channels.size(); ++c) {
    const Values& level = calibration.channels[c].level_dn;
    const std::size_t n = level.size();
    LevelRange range{level.front(), level.back(), gain_of_channel(calibration, c) > 0};
    if (n > 1) {
      range.darkest_dn -= 0.5 * (level[1] - level[0]);
      range.brightest_dn += 0.5 * (level[n - 1] - level[n - 2]);
    }
    ranges.push_back(range);
  }
  return ranges;
}

std::vector<LevelRange> common_ranges(const std::vector<LevelRange>& a,
                                      const std::vector<LevelRange>& b) {
  MALUS_REQUIRE(a.size() == b.size());
  std::vector<LevelRange> common;
  for (std::size_t c = 0; c < a.size(); ++c)
    common.push_back({std::max(a[c].darkest_dn, b[c].darkest_dn),
                      std::min(a[c].brightest_dn, b[c].brightest_dn),
                      a[c].continued && b[c].continued});
  return common;
}

}  // namespace malus
