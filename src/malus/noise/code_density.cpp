#include "malus/noise/code_density.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/random.h"
#include "malus/noise/level_noise.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kLeastTail = 1e-12;  // probability beyond which a tail is not told

// Normal quantile of a probability, from the nearer tail.
double quantile_of(double below, double above) {
  return below < above ? normal_quantile(std::max(below, kLeastTail))
                       : -normal_quantile(std::max(above, kLeastTail));
}

// Normal probability from a to b, in the tail that is not 1 minus next to nothing.
double normal_between(double a, double b) {
  return a > 0 ? normal_cdf(-a) - normal_cdf(-b) : normal_cdf(b) - normal_cdf(a);
}

}  // namespace

// Beyond the outermost codes that occur the quantile goes on as in the next ones: the distribution
// ends nowhere, and where the camera cuts noise off, the last code holds all that lies beyond.
WithinCodes::WithinCodes(const std::vector<double>& codes) {
  const std::size_t n = codes.size();
  std::vector<double> above(n + 1, 0.0);
  for (std::size_t i = n; i > 0; --i) above[i - 1] = above[i] + codes[i - 1];
  double below = 0;
  for (std::size_t i = 0; i <= n; ++i) {
    quantile_.push_back(quantile_of(below, above[i]));
    if (i < n) below += codes[i];
  }
  std::size_t first = 0, last = n - 1;
  while (first < last && !(codes[first] > 0)) ++first;
  while (last > first && !(codes[last] > 0)) --last;
  if (last - first < 2) return;
  quantile_[first] = 2 * quantile_[first + 1] - quantile_[first + 2];
  quantile_[last + 1] = 2 * quantile_[last] - quantile_[last - 1];
}

double WithinCodes::share(std::size_t code, double from, double to) const {
  const double begin = quantile_[code], width = quantile_[code + 1] - begin;
  const double all = normal_between(begin, begin + width);
  return all > 0 ? normal_between(begin + from * width, begin + to * width) / all : to - from;
}

NonparametricChannel smooth_inside_codes(NonparametricChannel channel, double black_dn,
                                         double step_dn) {
  constexpr double kMostCodes = 1 << 20;  // of a file's edges nothing is known but that they rise
  const std::vector<double>& edges = channel.bin_edges_dn;
  if (!before_rounding(channel, 0, step_dn) ||
      !(edges.back() - edges.front() < kMostCodes * step_dn))
    return channel;
  // In codes, 0 at the lower boundary of the first one that the bins hold.
  const double origin_dn =
      (std::floor((edges.front() + black_dn) / step_dn + 0.5) - 0.5) * step_dn - black_dn;
  const auto place = [&](std::size_t edge) { return (edges[edge] - origin_dn) / step_dn; };
  const Cumulative even = noise_at(channel, 0);
  std::vector<double> codes;
  for (double at = 0; at < place(edges.size() - 1); ++at)
    codes.push_back(even.below(origin_dn + (at + 1) * step_dn) -
                    even.below(origin_dn + at * step_dn));
  const WithinCodes within(codes);
  std::vector<double>& pmf = channel.pmf.front();
  double sum = 0;
  for (std::size_t b = 0; b < pmf.size(); ++b) {
    const double begin = place(b), end = place(b + 1);
    pmf[b] = 0;
    for (auto code = static_cast<std::size_t>(begin);
         code < codes.size() && static_cast<double>(code) < end; ++code) {
      const auto at = static_cast<double>(code);
      pmf[b] +=
          codes[code] * within.share(code, std::max(begin - at, 0.0), std::min(end - at, 1.0));
    }
    sum += pmf[b];
  }
  for (double& p : pmf) p /= sum;
  return channel;
}

}  // namespace malus
