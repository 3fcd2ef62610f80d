#include "malus/calibrate/level_histograms.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/random.h"
#include "malus/noise/code_density.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

namespace malus {
namespace {

constexpr double kBinsPerDeviation = 6.0, kReachedDeviations = 7.0;
constexpr int kBorrowedLevels = 2;

// Mean and variance of a histogram of codes without hot pixels, of which a few are most of it; in
// codes.
struct CoreMoments {
  double mean = 0, variance = std::numeric_limits<double>::infinity();
};
CoreMoments core_moments(const std::vector<double>& observed) {
  constexpr double kReach = 6.0;
  constexpr int kPasses = 3;
  CoreMoments core;
  for (int pass = 0; pass < kPasses && core.variance > 0; ++pass) {
    double total = 0, sum = 0, square = 0;
    for (std::size_t i = 0; i < observed.size(); ++i) {
      const double away = static_cast<double>(i) - core.mean;
      if (std::abs(away) > kReach * std::sqrt(core.variance)) continue;
      total += observed[i];
      sum += observed[i] * away;
      square += observed[i] * away * away;
    }
    core.variance = (square - sum * sum / total) / total;
    core.mean += sum / total;
  }
  return core;
}

// Where to begin to take row noise of s codes out: near the result, of a histogram that the rows
// widened more than all else, or the steps are too few to narrow it. Drawn together about its mean
// to the variance that is left without rows (nor that of sharing a value between two codes); but
// for a trace of the histogram itself, from which what lies far out comes back at once.
std::vector<double> start_without_rows(const std::vector<double>& observed, double s) {
  constexpr double kTrace = 1e-4, kRounding = 1.0 / 12.0, kShared = 1.0 / 6.0;
  const auto [mean, variance] = core_moments(observed);
  if (!(variance > 0) || s * s < variance - s * s - kRounding) return observed;
  const double left = std::max(variance - s * s - kShared, 0.0);
  std::vector<double> start(observed.size() + 1, 0.0);
  for (std::size_t i = 0; i < observed.size(); ++i) {
    const double at = mean + std::sqrt(left / variance) * (static_cast<double>(i) - mean);
    const auto below = static_cast<std::size_t>(std::max(at, 0.0));
    const double above_share = at - static_cast<double>(below);
    start[below] += (1.0 - kTrace) * observed[i] * (1.0 - above_share);
    start[below + 1] += (1.0 - kTrace) * observed[i] * above_share;
    start[i] += kTrace * observed[i];
  }
  start.pop_back();
  return start;
}

// Parts that make what is left of a code's own width, 1/12 of a part squared, a trifle of the
// noise.
int parts_of_code(double variance) {
  constexpr double kPartsPerDeviation = 8.0, kMost = 8.0;
  // Where all pixels have one code, only rounding errors are left of the variance: more parts than
  // an int counts.
  const double parts = variance > 0 ? std::ceil(kPartsPerDeviation / std::sqrt(variance)) : kMost;
  return static_cast<int>(std::clamp(parts, 1.0, kMost));
}

// Each code's probability among its parts.
std::vector<double> smooth_within_codes(const std::vector<double>& codes, int parts) {
  const WithinCodes within(codes);
  std::vector<double> out;
  for (std::size_t i = 0; i < codes.size(); ++i)
    for (int j = 0; j < parts; ++j)
      out.push_back(codes[i] * within.share(i, static_cast<double>(j) / parts, (j + 1.0) / parts));
  return out;
}

// The lowest code, which stands for all that is below it, shared out among it and `below` codes
// before it: as a normal law goes on that has the next code's width, the rest in the last.
std::vector<double> open_below(const std::vector<double>& observed, std::size_t below) {
  if (below == 0 || observed.size() < 2) return observed;
  static constexpr double kLeast = 1e-12;
  const auto quantile = [](double p) {
    return normal_quantile(std::clamp(p, kLeast, 1.0 - kLeast));
  };
  const double end = quantile(observed[0]), width = quantile(observed[0] + observed[1]) - end;
  std::vector<double> out(below, 0.0);
  out.insert(out.end(), observed.begin(), observed.end());
  double left = observed[0];
  for (std::size_t i = 0; i < below; ++i) {
    const double next = std::min(normal_cdf(end - static_cast<double>(i + 1) * width), left);
    out[below - i] = left - next;
    left = next;
  }
  out[0] = left;
  return out;
}

// What the parts of a code, plus normal row noise of s codes, give to each code when rounded. Of
// codes before `lowest`, all to this one. Only codes that hold something are visited: hot pixels
// and wild rows spread a few thousand values over all codes of a converter.
class RowBlur {
 public:
  RowBlur(double s, int parts, std::size_t lowest, const std::vector<double>& observed,
          const std::vector<double>& start)
      : parts_(parts),
        reach_(static_cast<std::ptrdiff_t>(std::ceil(6.0 * s)) + 1),
        lowest_(static_cast<std::ptrdiff_t>(lowest)),
        observed_(occupied(observed)),
        started_(occupied(start)) {
    // A uniform part from a to b: difference of the integral of the normal distribution.
    const auto integral = [s](double x) { return s * mean_above_zero(x / s); };
    for (std::ptrdiff_t away = -reach_; away <= reach_; ++away)
      for (int j = 0; j < parts; ++j) {
        const double low = static_cast<double>(away) - 0.5,
                     a = -0.5 + static_cast<double>(j) / parts, b = -0.5 + (j + 1.0) / parts;
        const auto below = [&](double bound) { return integral(bound - a) - integral(bound - b); };
        kernel_.push_back(std::max(parts * (below(low + 1.0) - below(low)), 0.0));
      }
  }
  // Of codes that were observed: 0 elsewhere.
  std::vector<double> codes_of(const std::vector<double>& parts) const {
    std::vector<double> codes(parts.size() / as_index(parts_), 0.0);
    visit([&](std::size_t code, std::size_t part, double share) {
      codes[code] += share * parts[part];
    });
    return codes;
  }
  // Of codes that the start holds: 0 elsewhere, where its probability stays 0.
  std::vector<double> parts_of(const std::vector<double>& codes) const {
    std::vector<double> parts(codes.size() * as_index(parts_), 0.0);
    visit([&](std::size_t code, std::size_t part, double share) {
      parts[part] += share * codes[code];
    });
    return parts;
  }

 private:
  static std::vector<std::ptrdiff_t> occupied(const std::vector<double>& codes) {
    std::vector<std::ptrdiff_t> out;
    for (std::size_t i = 0; i < codes.size(); ++i)
      if (codes[i] > 0) out.push_back(static_cast<std::ptrdiff_t>(i));
    return out;
  }
  template <class Use>
  void visit(const Use& use) const {
    for (const std::ptrdiff_t from : started_) {
      const auto give = [&](std::ptrdiff_t to, std::ptrdiff_t code) {
        for (int j = 0; j < parts_; ++j)
          use(as_index(code), as_index(from * parts_ + j),
              kernel_[as_index((to - from + reach_) * parts_ + j)]);
      };
      if (lowest_ > 0)
        for (std::ptrdiff_t to = from - reach_; to <= std::min(from + reach_, lowest_); ++to)
          give(to, lowest_);
      const std::ptrdiff_t first = std::max(from - reach_, lowest_ > 0 ? lowest_ + 1 : 0);
      for (auto to = std::lower_bound(observed_.begin(), observed_.end(), first);
           to != observed_.end() && *to <= from + reach_; ++to)
        give(*to, *to);
    }
  }
  int parts_;
  std::ptrdiff_t reach_, lowest_;
  std::vector<std::ptrdiff_t> observed_, started_;  // codes that hold something, rising
  std::vector<double> kernel_;                      // [code - the part's own + reach][part]
};

}  // namespace

std::vector<double> noise_bin_edges(double smallest_sd_dn, double largest_sd_dn, int bins,
                                    double centre_dn, CodeGrid codes) {
  MALUS_REQUIRE(bins >= 8 && smallest_sd_dn > 0 && largest_sd_dn >= smallest_sd_dn);
  const double q = codes.step_dn, core = kReachedDeviations * smallest_sd_dn,
               reach = kReachedDeviations * largest_sd_dn;
  double width = smallest_sd_dn / kBinsPerDeviation;
  if (q > 0) width = width >= q ? q : q / std::ceil(q / width);
  if (const double most = bins / 3.0; core / width > most) {
    width = core / most;
    if (q > 0) width = q * std::ceil(width / q);
  }
  const int inner = static_cast<int>(std::ceil(core / width));
  std::vector<double> half;  // distances from the centre
  for (int i = 1; i <= inner; ++i) half.push_back(width * i);
  const int outer = std::max(bins / 2 - inner, 4);
  // width (g + g² + ...) = reach - core, by bisection for the growth g.
  const auto covered = [&](double g) {
    double sum = 0.0, w = width;
    for (int i = 0; i < outer; ++i) sum += w *= g;
    return sum;
  };
  double low = 1.0, high = 2.0;
  while (covered(high) < reach - half.back()) high *= 2.0;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (covered(middle) < reach - half.back() ? low : high) = middle;
  }
  for (double w = width * high; half.back() < reach; w *= high) half.push_back(half.back() + w);
  std::vector<double> edges{centre_dn};
  for (const double d : half) {
    edges.push_back(centre_dn + d);
    edges.insert(edges.begin(), centre_dn - d);
  }
  if (q > 0) {
    const double grid = std::min(width, q), boundary = codes.offset_dn + 0.5 * q;
    for (double& edge : edges) {
      const double spacing = std::abs(edge - centre_dn) <= width * inner * 1.0001 ? grid : q;
      edge = boundary + spacing * std::round((edge - boundary) / spacing);
    }
    edges.erase(std::unique(edges.begin(), edges.end(),
                            [q](double a, double b) { return b - a < 1e-6 * q; }),
                edges.end());
  }
  return edges;
}

DarkDensity without_row_noise(const std::vector<double>& counts, double step_dn,
                              double sigma_row_dn, bool is_cut_off) {
  constexpr int kIterations = 200;
  constexpr double kReachedRows = 5.0;
  std::vector<double> observed = counts;
  double total = 0.0;
  for (const double c : counts) total += c;
  for (double& p : observed) p /= total;
  const double s = sigma_row_dn / step_dn;
  const int parts = parts_of_code(core_moments(observed).variance);
  if (s < 1e-3) return {smooth_within_codes(observed, parts), parts};
  // Where rows lift pixels above the cut, too.
  const auto below = is_cut_off ? static_cast<std::size_t>(std::ceil(kReachedRows * s)) : 0;
  const std::vector<double> opened = open_below(observed, below);
  observed.insert(observed.begin(), opened.size() - observed.size(), 0.0);
  const std::vector<double> start = start_without_rows(opened, s);
  const std::size_t codes_below = opened.size() - counts.size();
  const RowBlur blur(s, parts, codes_below, observed, start);
  DarkDensity out{smooth_within_codes(start, parts), parts, codes_below};
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    std::vector<double> ratio = blur.codes_of(out.probability);
    for (std::size_t i = 0; i < ratio.size(); ++i)
      ratio[i] = ratio[i] > 0 ? observed[i] / ratio[i] : 0.0;
    const std::vector<double> factor = blur.parts_of(ratio);
    double sum = 0.0;
    for (std::size_t i = 0; i < factor.size(); ++i) sum += out.probability[i] *= factor[i];
    for (double& value : out.probability) value /= sum;
  }
  return out;
}

LevelHistograms::LevelHistograms(std::vector<double> edges_dn, double step_dn, double range_dn)
    : edges_(std::move(edges_dn)),
      levels_(as_index(static_cast<std::ptrdiff_t>(range_dn / step_dn) + 2)),
      squares_(levels_.size()),
      counts_(levels_.size() * (edges_.size() - 1), 0),
      step_dn_(step_dn) {}

std::size_t LevelHistograms::level_of(double signal_dn) const {
  return static_cast<std::size_t>(
      std::clamp(signal_dn / step_dn_ + 0.5, 0.0, static_cast<double>(levels_.size()) - 0.5));
}

// Residuals of narrow noise lie on a lattice, of half codes over sqrt(1/2) from two frames, and in
// bins of another width each of its values would be moved to a bin's middle: the variance was off
// by up to 9 %. By the distances to two middles the mean is kept, and the variance grows by a sixth
// of the width squared or less.
std::ptrdiff_t LevelHistograms::bin_of(double noise_dn, double share) const {
  const auto last = static_cast<std::ptrdiff_t>(edges_.size()) - 2;
  const auto above = std::upper_bound(edges_.begin(), edges_.end(), noise_dn);
  const auto bin = std::clamp<std::ptrdiff_t>(above - edges_.begin() - 1, 0, last);
  const auto middle = [&](std::ptrdiff_t i) {
    return 0.5 * (edges_[as_index(i)] + edges_[as_index(i + 1)]);
  };
  const auto next = noise_dn < middle(bin) ? bin - 1 : bin + 1;
  if (next < 0 || next > last) return bin;
  return share < (noise_dn - middle(bin)) / (middle(next) - middle(bin)) ? next : bin;
}

void LevelHistograms::add(double signal_dn, double noise_dn) {
  const std::size_t level = level_of(signal_dn);
  constexpr double kGolden = 0.6180339887498949;  // multiples of it fill 0 to 1 evenly
  const double turns = kGolden * static_cast<double>(levels_[level].count + 1);
  const std::ptrdiff_t bin = bin_of(noise_dn, turns - std::floor(turns));
  ++counts_[level * (edges_.size() - 1) + as_index(bin)];
  ++levels_[level].count;
  levels_[level].signal_sum += signal_dn;
  lowest_ = std::min(lowest_, noise_dn);
  highest_ = std::max(highest_, noise_dn);
}

void LevelHistograms::add_square(double signal_dn, double residual_dn, double square_dn2,
                                 double freedom) {
  Squares& level = squares_[level_of(signal_dn)];
  level.signal_sum += signal_dn;
  level.residual_sum += residual_dn;
  level.square_sum += square_dn2;
  level.freedom += freedom;
  ++level.count;
}

std::vector<LevelNoise> LevelHistograms::noise() const {
  std::vector<LevelNoise> out;
  for (const Squares& level : squares_) {
    if (level.count < 2) continue;
    const auto n = static_cast<double>(level.count);
    // A reference that is not quite the scene leaves an error in the level's mean: no noise.
    const double mean = level.residual_sum / n;
    out.push_back({level.signal_sum / n, level.square_sum / n - mean * mean, level.freedom});
  }
  return out;
}

void LevelHistograms::set_dark(const std::vector<double>& probability, CodeGrid codes,
                               std::int64_t samples) {
  const std::size_t bins = edges_.size() - 1;
  dark_samples_ = samples;
  dark_pmf_.assign(bins, 0.0);
  for (std::size_t i = 0; i < probability.size(); ++i) {
    if (!(probability[i] > 0)) continue;
    const double begin = codes.offset_dn + codes.step_dn * (static_cast<double>(i) - 0.5),
                 end = begin + codes.step_dn;
    lowest_ = std::min(lowest_, begin);
    highest_ = std::max(highest_, end);
    for (std::size_t b = 0; b < bins; ++b) {
      const double from = b == 0 ? begin : std::max(begin, edges_[b]);
      const double to = b + 1 == bins ? end : std::min(end, edges_[b + 1]);
      if (to > from) dark_pmf_[b] += probability[i] * (to - from) / codes.step_dn;
    }
  }
}

LevelHistograms::Result LevelHistograms::result(std::int64_t wanted) const {
  Result out;
  const std::size_t bins = edges_.size() - 1;
  out.channel.bin_edges_dn = edges_;
  out.channel.bin_edges_dn.front() = std::min(edges_.front(), lowest_);
  out.channel.bin_edges_dn.back() = std::max(edges_.back(), highest_);
  if (!dark_pmf_.empty() && dark_samples_ * 10 >= wanted) {
    out.channel.level_dn.push_back(0.0);
    out.channel.samples.push_back(dark_samples_);
    out.channel.pmf.push_back(dark_pmf_);
  }
  const auto count = static_cast<std::ptrdiff_t>(levels_.size());
  for (std::ptrdiff_t l = 0; l < count; ++l) {
    if (levels_[as_index(l)].count == 0) continue;
    Level pooled;
    std::ptrdiff_t radius = 0;
    for (; radius <= kBorrowedLevels; ++radius) {
      for (const std::ptrdiff_t i : {l - radius, l + radius}) {
        if (i < 0 || i >= count || (i == l && pooled.count > 0)) continue;
        pooled.count += levels_[as_index(i)].count;
        pooled.signal_sum += levels_[as_index(i)].signal_sum;
      }
      if (pooled.count >= wanted) break;
    }
    radius = std::min<std::ptrdiff_t>(radius, kBorrowedLevels);
    if (pooled.count * 10 < wanted) {
      const Level& own = levels_[as_index(l)];
      out.refused.emplace_back(own.signal_sum / static_cast<double>(own.count), pooled.count);
      continue;
    }
    const double centre = pooled.signal_sum / static_cast<double>(pooled.count);
    if (!out.channel.level_dn.empty() && centre <= out.channel.level_dn.back() + 0.25 * step_dn_)
      continue;  // borrowed much the same samples as the level before
    std::vector<double> pmf(bins, 0.0);
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(l - radius, 0);
         i <= std::min(l + radius, count - 1); ++i)
      for (std::size_t b = 0; b < bins; ++b) pmf[b] += counts_[as_index(i) * bins + b];
    for (double& p : pmf) p /= static_cast<double>(pooled.count);
    out.channel.level_dn.push_back(centre);
    out.channel.samples.push_back(pooled.count);
    out.channel.pmf.push_back(std::move(pmf));
  }
  return out;
}

}  // namespace malus
