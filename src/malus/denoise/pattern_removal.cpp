#include "malus/denoise/internal/pattern_removal.h"

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

// What a frame may hold, each with a share of its own.
enum Part : std::size_t { kDark, kResponse, kDarkColumns, kResponseColumns, kParts };
using PartValues = std::array<double, kParts>;

// Normal equations of the shares: sums of weight times products of parts, and of these and pixel.
struct Sums {
  std::array<PartValues, kParts> products{};  // i >= k
  PartValues with_pixel{};
  double pixels = 0, near = 0;
  void add(double weight, const PartValues& part, double x) {
    for (std::size_t i = 0; i < kParts; ++i) {
      for (std::size_t k = 0; k <= i; ++k) products[i][k] += weight * part[i] * part[k];
      with_pixel[i] += weight * part[i] * x;
    }
  }
  void add(const Sums& o, double sign = 1) {
    for (std::size_t i = 0; i < kParts; ++i) {
      for (std::size_t k = 0; k <= i; ++k) products[i][k] += sign * o.products[i][k];
      with_pixel[i] += sign * o.with_pixel[i];
    }
    pixels += sign * o.pixels;
    near += sign * o.near;
  }
  // By elimination; 0 of parts that are empty, flat, or the same as others before.
  PartValues solution() const {
    std::array<PartValues, kParts> left = products;
    PartValues right = with_pixel, shares{};
    for (std::size_t i = 0; i < kParts; ++i)
      for (std::size_t k = 0; k < i; ++k) left[k][i] = left[i][k];
    const auto is_told = [&](std::size_t k) { return left[k][k] > 1e-9 * products[k][k]; };
    for (std::size_t k = 0; k < kParts; ++k)
      for (std::size_t i = 0; i < kParts && is_told(k); ++i) {
        if (i == k) continue;
        const double factor = left[i][k] / left[k][k];
        for (std::size_t j = k; j < kParts; ++j) left[i][j] -= factor * left[k][j];
        right[i] -= factor * right[k];
      }
    for (std::size_t k = 0; k < kParts; ++k) shares[k] = is_told(k) ? right[k] / left[k][k] : 0;
    return shares;
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
  PartValues shares{};
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
    const auto row_of = [](const Image& map, int r) { return map.empty() ? nullptr : map.row(r); };
    const int phase = row % layout.rows();
    const std::array<const float*, kParts> part_rows{
        row_of(maps.dark_dn, row), row_of(maps.response, row), row_of(maps.dark_columns_dn, phase),
        row_of(maps.response_columns, phase)};
    const auto stands_out = [period](const float* map, int c) {
      return map ? map[c] - 0.5 * (double{map[c - period]} + map[c + period]) : 0.0;
    };
    for (int c = period; c + period < cols; ++c) {
      const auto channel = static_cast<std::size_t>(layout.channel_at(row, c));
      if (std::max({pixel[c - period], pixel[c], pixel[c + period]}) >= saturated_dn[channel])
        continue;
      if (!std::isfinite(pixel[c - period] + pixel[c] + pixel[c + period])) continue;
      const double signal = 0.5 * (double{pixel[c - period]} + pixel[c + period]);
      const double light = std::max(signal, 0.0);
      const PartValues part{stands_out(part_rows[kDark], c),
                            light * stands_out(part_rows[kResponse], c),
                            stands_out(part_rows[kDarkColumns], c),
                            light * stands_out(part_rows[kResponseColumns], c)};
      const double x = stands_out(pixel, c);
      // Of the difference: the pixel's variance and half of a neighbour's.
      const double variance = 1.5 * profile.channels[channel].variance(signal);
      if (!(variance > 0)) continue;
      double off = x;
      for (std::size_t k = 0; k < kParts; ++k) off -= round.shares[k] * part[k];
      const double weight = 1 / (round.spread * variance + off * off / (kCauchy * kCauchy));
      Sums& strip = sums[static_cast<std::size_t>(std::int64_t{c} * kStrips / cols)];
      strip.add(weight, part, x);
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
PartValues errors_without(const Sums& total, const std::array<Sums, kStrips>& strips) {
  std::array<PartValues, kStrips> shares{};
  PartValues mean{}, errors{};
  for (std::size_t i = 0; i < kStrips; ++i) {
    Sums rest = total;
    rest.add(strips[i], -1);
    shares[i] = rest.solution();
    for (std::size_t k = 0; k < kParts; ++k) mean[k] += shares[i][k] / kStrips;
  }
  constexpr double kOfSquares = (kStrips - 1.0) / kStrips;
  for (std::size_t k = 0; k < kParts; ++k) {
    double squares = 0;
    for (const PartValues& share : shares) squares += (share[k] - mean[k]) * (share[k] - mean[k]);
    errors[k] = std::sqrt(kOfSquares * squares);
  }
  return errors;
}

MeasuredPattern with_errors(const StripSums& strips, const FixedPattern& pattern) {
  const Sums total = total_of(strips);
  std::array<Sums, kStrips> down{}, across{};
  for (std::size_t i = 0; i < kStrips; ++i)
    for (std::size_t k = 0; k < kStrips; ++k) {
      down[i].add(strips[i][k]);
      across[k].add(strips[i][k]);
    }
  MeasuredPattern measured;
  if (total.near < kLeastNear * total.pixels) return measured;
  const PartValues share = total.solution(), rows = errors_without(total, down),
                   cols = errors_without(total, across);
  const auto fill = [&](PatternShare& to, Part k, double kept) {
    to.kept = kept;
    to.value = share[k];
    to.stderr_value = std::max(rows[k], cols[k]);
  };
  fill(measured.dark.pixels, kDark, pattern.dark_kept);
  fill(measured.dark.columns, kDarkColumns, pattern.dark_columns_kept);
  fill(measured.response.pixels, kResponse, pattern.response_kept);
  fill(measured.response.columns, kResponseColumns, pattern.response_columns_kept);
  return measured;
}

}  // namespace

MeasuredPattern measure_pattern(View<const float> dn, const SensorLayout& layout,
                                const NoiseProfile& profile,
                                const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(profile.pattern);
  for (const Image* map : {&profile.pattern->dark_columns_dn, &profile.pattern->response_columns})
    MALUS_REQUIRE(map->empty() || (map->rows() == layout.rows() && map->cols() == dn.cols()));
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
    double moved = 0;
    for (std::size_t k = 0; k < kParts; ++k)
      moved = std::max(moved, std::abs(next.shares[k] - round.shares[k]));
    round = next;
    if (i > 0 && moved < kStill) break;
  }
  return with_errors(strips, *profile.pattern);
}

void remove_pattern(Image& dn, const SensorLayout& layout, const FixedPattern& pattern,
                    const MeasuredPattern& shares, const SaturatedPixels& saturated) {
  const double dark = shares.dark.pixels_taken(), response = shares.response.pixels_taken(),
               dark_columns = pattern.dark_columns_dn.empty() ? 0 : shares.dark.columns_taken(),
               response_columns =
                   pattern.response_columns.empty() ? 0 : shares.response.columns_taken();
  if (dark == 0 && response == 0 && dark_columns == 0 && response_columns == 0) return;
  parallel_for(0, dn.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < end; ++row)
      for (int c = 0; c < dn.cols(); ++c) {
        if (saturated(row, c)) continue;
        const int phase = row % layout.rows();
        double off = 0, responds = 1;
        if (dark > 0) off += dark * pattern.dark_dn(row, c);
        if (dark_columns > 0) off += dark_columns * pattern.dark_columns_dn(phase, c);
        if (response > 0) responds += response * (pattern.response(row, c) - 1);
        if (response_columns > 0) responds += response_columns * pattern.response_columns(phase, c);
        // A pixel that hardly responds is a defect; what it tells is not worth a large factor.
        dn(row, c) = static_cast<float>((dn(row, c) - off) / std::max(responds, 0.5));
      }
  });
}

}  // namespace malus
