#include "malus/denoise/pattern_removal.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

namespace malus {
namespace {

constexpr int kStrips = 8;                       // across and down
constexpr std::int64_t kEnoughPixels = 1 << 20;  // rows of larger frames are passed over
constexpr int kMostRounds = 20;                  // of weights and least squares
constexpr double kStill = 1e-3;                  // no share moves further in the last round
constexpr double kCauchy = 2.385;                // 95 % efficient where all noise is Gaussian

// Steps of a scene that leaves no pixel out agree with large shares wherever these happen to undo
// one: then few pixels lie within kNear of their noise.
constexpr double kNear = 3, kLeastNear = 0.1;

// Normal equations of the two shares: sums of weight times products of (dark, response, pixel).
struct Sums {
  double dd = 0, dr = 0, rr = 0, dx = 0, rx = 0;
  double pixels = 0, near = 0;
  void add(double weight, double d, double r, double x) {
    dd += weight * d * d;
    dr += weight * d * r;
    rr += weight * r * r;
    dx += weight * d * x;
    rx += weight * r * x;
  }
  void add(const Sums& o, double sign = 1) {
    dd += sign * o.dd;
    dr += sign * o.dr;
    rr += sign * o.rr;
    dx += sign * o.dx;
    rx += sign * o.rx;
    pixels += sign * o.pixels;
    near += sign * o.near;
  }
  // Shares of dark and response; 0 of a map that is empty or flat.
  std::array<double, 2> solution() const {
    const double determinant = dd * rr - dr * dr;
    if (determinant > 1e-9 * dd * rr)
      return {(rr * dx - dr * rx) / determinant, (dd * rx - dr * dx) / determinant};
    return {dd > 0 ? dx / dd : 0, dd > 0 || rr <= 0 ? 0 : rx / rr};
  }
};

// How far off pixels are: squares in units of their noise's variance, in quarters of octaves.
class Spread {
 public:
  void add(double square) {
    const auto bits = std::bit_cast<std::uint32_t>(static_cast<float>(square));
    const int bin = static_cast<int>(bits >> 21) - kFirst;
    ++counts_[static_cast<std::size_t>(std::clamp(bin, 0, kBins - 1))];
  }
  void add(const Spread& o) {
    for (std::size_t i = 0; i < counts_.size(); ++i) counts_[i] += o.counts_[i];
  }
  /// The variance, from the median square; 1 where that is smaller or there are no pixels.
  double variance() const {
    const std::int64_t all = std::accumulate(counts_.begin(), counts_.end(), std::int64_t{0});
    std::int64_t below = 0;
    int bin = 0;
    while (bin < kBins && 2 * (below + counts_[static_cast<std::size_t>(bin)]) < all)
      below += counts_[static_cast<std::size_t>(bin++)];
    const auto middle =  // of the bin
        std::bit_cast<float>((static_cast<std::uint32_t>(bin + kFirst) << 21) + (1u << 20));
    return std::max(middle / (kMedianOfNormal * kMedianOfNormal), 1.0);
  }

 private:
  static constexpr int kFirst = (127 - 4) * 4, kBins = 44 * 4;  // from 1/16 on
  std::array<std::int64_t, kBins> counts_{};
};

using StripSums = std::array<std::array<Sums, kStrips>, kStrips>;  // [down][across]

// What a round knows from the one before.
struct Round {
  std::array<double, 2> shares{};
  double spread = 1;  ///< variance of what the shares leave, in units of that of the noise
};

struct Comparison {
  View<const float> dn;
  const SensorLayout& layout;
  const NoiseProfile& profile;
  const std::vector<float>& saturated_dn;
  int row_step;  ///< without a divisor of the cell's rows: all of them take part

  // Adds one row, its pixels weighted about the shares found so far. Weights are as narrow as what
  // the scene leaves of most differences, not as the noise: where texture is wider, narrow ones
  // hardly let the shares move.
  void add_row(int row, const Round& round, std::array<Sums, kStrips>& sums, Spread& spread) const {
    const int period = layout.cols(), cols = dn.cols();
    const float* pixel = dn.row(row);
    const FixedPattern& maps = *profile.pattern;
    const float* dark = maps.dark_dn.empty() ? nullptr : maps.dark_dn.row(row);
    const float* response = maps.response.empty() ? nullptr : maps.response.row(row);
    const auto stands_out = [period](const float* map, int c) {
      return map[c] - 0.5 * (double{map[c - period]} + map[c + period]);
    };
    for (int c = period; c + period < cols; ++c) {
      const auto channel = static_cast<std::size_t>(layout.channel_at(row, c));
      if (std::max({pixel[c - period], pixel[c], pixel[c + period]}) >= saturated_dn[channel])
        continue;
      if (!std::isfinite(pixel[c - period] + pixel[c] + pixel[c + period])) continue;
      const double signal = 0.5 * (double{pixel[c - period]} + pixel[c + period]);
      const double d = dark ? stands_out(dark, c) : 0;
      const double r = response ? std::max(signal, 0.0) * stands_out(response, c) : 0;
      const double x = stands_out(pixel, c);
      // Of the difference: the pixel's variance and half of a neighbour's.
      const double variance = 1.5 * profile.channels[channel].variance(signal);
      if (!(variance > 0)) continue;
      const double off = x - round.shares[0] * d - round.shares[1] * r;
      const double weight = 1 / (round.spread * variance + off * off / (kCauchy * kCauchy));
      Sums& strip = sums[static_cast<std::size_t>(std::int64_t{c} * kStrips / cols)];
      strip.add(weight, d, r, x);
      ++strip.pixels;
      strip.near += off * off < kNear * kNear * variance;
      spread.add(off * off / variance);
    }
  }

  StripSums add_all(const Round& round, Spread& spread) const {
    StripSums sums{};
    std::array<Spread, kStrips> spreads{};
    const int rows = dn.rows();
    parallel_for(0, kStrips, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (std::ptrdiff_t strip = begin; strip < end; ++strip) {
        const auto from = static_cast<int>(std::int64_t{rows} * strip / kStrips),
                   to = static_cast<int>(std::int64_t{rows} * (strip + 1) / kStrips);
        for (int row = from; row < to; row += row_step)
          add_row(row, round, sums[static_cast<std::size_t>(strip)],
                  spreads[static_cast<std::size_t>(strip)]);
      }
    });
    for (const Spread& s : spreads) spread.add(s);
    return sums;
  }
};

Sums total_of(const StripSums& strips) {
  Sums total;
  for (const auto& row : strips)
    for (const Sums& s : row) total.add(s);
  return total;
}

// Standard errors by leaving out one strip after the other (jackknife).
std::array<double, 2> errors_without(const Sums& total, const std::array<Sums, kStrips>& strips) {
  std::array<std::array<double, 2>, kStrips> shares{};
  std::array<double, 2> mean{}, squares{};
  for (std::size_t i = 0; i < kStrips; ++i) {
    Sums rest = total;
    rest.add(strips[i], -1);
    shares[i] = rest.solution();
    for (std::size_t k = 0; k < 2; ++k) mean[k] += shares[i][k] / kStrips;
  }
  for (const auto& share : shares)
    for (std::size_t k = 0; k < 2; ++k) squares[k] += (share[k] - mean[k]) * (share[k] - mean[k]);
  constexpr double kOfSquares = (kStrips - 1.0) / kStrips;
  return {std::sqrt(kOfSquares * squares[0]), std::sqrt(kOfSquares * squares[1])};
}

PatternShares with_errors(const StripSums& strips) {
  const Sums total = total_of(strips);
  std::array<Sums, kStrips> down{}, across{};
  for (std::size_t i = 0; i < kStrips; ++i)
    for (std::size_t k = 0; k < kStrips; ++k) {
      down[i].add(strips[i][k]);
      across[k].add(strips[i][k]);
    }
  const auto share = total.solution(), rows = errors_without(total, down),
             cols = errors_without(total, across);
  PatternShares shares;
  if (total.near < kLeastNear * total.pixels) return shares;
  shares.dark.value = share[0];
  shares.dark.stderr_value = std::max(rows[0], cols[0]);
  shares.response.value = share[1];
  shares.response.stderr_value = std::max(rows[1], cols[1]);
  return shares;
}

}  // namespace

PatternShares measure_pattern(View<const float> dn, const SensorLayout& layout,
                              const NoiseProfile& profile, const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(profile.pattern);
  for (const Image* map : {&profile.pattern->dark_dn, &profile.pattern->response})
    MALUS_REQUIRE(map->empty() || (map->rows() == dn.rows() && map->cols() == dn.cols()));
  // A step that shares no divisor with the cell's rows meets all channels.
  auto step = static_cast<int>(std::int64_t{dn.rows()} * dn.cols() / kEnoughPixels) + 1;
  while (std::gcd(step, layout.rows()) != 1) ++step;
  const Comparison comparison{dn, layout, profile, saturated_dn, step};
  StripSums strips{};
  Round round;
  for (int i = 0; i < kMostRounds; ++i) {
    Spread spread;
    strips = comparison.add_all(round, spread);
    const Round next{total_of(strips).solution(), spread.variance()};
    const double moved = std::max(std::abs(next.shares[0] - round.shares[0]),
                                  std::abs(next.shares[1] - round.shares[1]));
    round = next;
    if (i > 0 && moved < kStill) break;
  }
  return with_errors(strips);
}

void remove_pattern(Image& dn, const FixedPattern& pattern, const PatternShares& shares,
                    const SaturatedPixels& saturated) {
  const bool dark = shares.dark.present(), response = shares.response.present();
  if (!dark && !response) return;
  const auto d = static_cast<float>(shares.dark.value),
             r = static_cast<float>(shares.response.value);
  parallel_for(0, dn.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < end; ++row)
      for (int c = 0; c < dn.cols(); ++c) {
        if (saturated(row, c)) continue;
        float& pixel = dn(row, c);
        if (dark) pixel -= d * pattern.dark_dn(row, c);
        // A pixel that hardly responds is a defect; what it tells is not worth a large factor.
        if (response) pixel /= std::max(1 + r * (pattern.response(row, c) - 1), 0.5f);
      }
  });
}

}  // namespace malus
