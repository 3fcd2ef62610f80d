#include "malus/calibrate/internal/row_group.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kStandardErrors = 3.0;

struct Shared {
  double ratio = 0, standard_error = 0;
  double above = 0.5;  ///< shared above it
  bool yes() const { return ratio - kStandardErrors * standard_error > above; }
  bool no() const { return ratio + kStandardErrors * standard_error < above; }
  bool open() const { return !yes() && !no(); }
  std::string text() const { return fmt::format("{:.2f} ± {:.2f}", ratio, standard_error); }
};

// Covariances of rows r, r+1, relative to the row variance.
Shared share_of_rows(const Moments& covariance, double row_variance_dn2) {
  if (covariance.count() < 4 || !(row_variance_dn2 > 0)) return {0.5, 1.0};
  return {covariance.mean() / row_variance_dn2,
          std::sqrt(covariance.variance() / static_cast<double>(covariance.count())) /
              row_variance_dn2};
}

// Their mean where r % period == phase.
Shared shared(const RowLagAccumulator& rows, int period, int phase, double row_variance_dn2) {
  Moments covariance;
  for (int r = phase; r + 1 < rows.rows(); r += period) covariance.add(rows.covariance_dn2(r, 1));
  return share_of_rows(covariance, row_variance_dn2);
}

// Groups of `period` rows, of which the first ends after row `end`.
struct PlacedGroup {
  int period = 1, end = 0;
  bool is_at_start() const { return end == period - 1; }
  std::string text() const {
    return fmt::format(
        "{} rows share their noise, and the first group ends after row {}: crop the frames by {} "
        "row{}",
        period, end, end + 1, end == 0 ? "" : "s");
  }
};

// Groups of a number of rows that is no power of two, or that do not start at row 0: then all pairs
// of that period but one are shared. A search among powers of two from row 0 on sees pairs that are
// shared in part wherever it looks, as if the rows drifted slowly.
std::optional<PlacedGroup> other_group(const RowLagAccumulator& rows, double row_variance_dn2) {
  for (int period = 2; period <= 15; ++period) {
    std::vector<Shared> pairs;
    for (int phase = 0; phase < period; ++phase)
      pairs.push_back(shared(rows, period, phase, row_variance_dn2));
    const auto end = std::min_element(
        pairs.begin(), pairs.end(), [](const auto& a, const auto& b) { return a.ratio < b.ratio; });
    if (!end->no()) continue;  // the ends of groups twice as large are shared by one half
    const double above = 0.5 * (1.0 + std::max(0.0, end->ratio));
    for (Shared& p : pairs) p.above = above;
    if (std::count_if(pairs.begin(), pairs.end(), [](const Shared& p) { return p.yes(); }) !=
        period - 1)
      continue;
    const PlacedGroup group{period, static_cast<int>(end - pairs.begin())};
    const bool is_power_of_two = (period & (period - 1)) == 0;
    if (!(is_power_of_two && group.is_at_start())) return group;
  }
  return std::nullopt;
}

// Whether no group of rows explains pairs that share a part of their noise, which drift does: in
// groups of N rows all pairs but each N-th share all of it, a mean of 1 - 1/N at least. So the mean
// speaks against large groups, and against each small one all pairs but the least alike phase, if
// that phase does not stand apart from them.
bool rows_stand_alone(const RowLagAccumulator& rows, double row_variance_dn2) {
  constexpr int kLargest = 16;
  Moments all;
  for (int r = 0; r + 1 < rows.rows(); ++r) all.add(rows.covariance_dn2(r, 1));
  const Shared mean = share_of_rows(all, row_variance_dn2);
  if (!(mean.ratio + kStandardErrors * mean.standard_error < 1.0 - 1.0 / (kLargest + 1)))
    return false;
  for (int period = 2; period <= kLargest; ++period) {
    int end = 0;
    for (int phase = 1; phase < period; ++phase)
      if (shared(rows, period, phase, row_variance_dn2).ratio <
          shared(rows, period, end, row_variance_dn2).ratio)
        end = phase;
    Moments inside;
    for (int r = 0; r + 1 < rows.rows(); ++r)
      if (r % period != end) inside.add(rows.covariance_dn2(r, 1));
    const Shared across = shared(rows, period, end, row_variance_dn2),
                 within = share_of_rows(inside, row_variance_dn2);
    const double apart = within.ratio - across.ratio;
    if (!(within.ratio + kStandardErrors * within.standard_error < 1.0 &&
          apart < kStandardErrors * std::hypot(within.standard_error, across.standard_error)))
      return false;
  }
  return true;
}

}  // namespace

RowVariance row_variance_of(const RowLagAccumulator& rows, double temporal_variance_dn2, int cols) {
  Moments variance;
  for (int r = 0; r < rows.rows(); ++r) variance.add(rows.covariance_dn2(r, 0));
  // A mean of n pixels has the variance row + pixel / n, a pixel row + pixel.
  const double kept = 1.0 - 1.0 / std::max(cols, 2);
  return {(variance.mean() - temporal_variance_dn2 / cols) / kept,
          std::sqrt(variance.variance() / static_cast<double>(variance.count())) / kept};
}

bool row_noise_matters(const RowVariance& row, double temporal_variance_dn2) {
  constexpr double kOfPixels = 0.05;  // a deviation over a pixel's
  return row.value_dn2 + kStandardErrors * row.standard_error_dn2 >
         kOfPixels * kOfPixels * temporal_variance_dn2;
}

Estimate<int> detect_row_group(const RowLagAccumulator& rows, const RowVariance& row) {
  const auto [row_variance, row_variance_se] = row;
  if (row_variance < kStandardErrors * row_variance_se)
    return Undecided{fmt::format(
        "row noise is too weak: {:.3g} DN² against a standard error of {:.3g} DN², and 3 of these "
        "are needed",
        row_variance, row_variance_se)};
  if (const auto other = other_group(rows, row_variance)) {
    if (other->is_at_start()) return other->period;
    return Undecided{other->text()};
  }
  // [i]: pairs across the middle and across the end of 2^(i+1) rows.
  std::array<Shared, 4> middle, end;
  for (std::size_t i = 0; i < middle.size(); ++i) {
    const int half = 1 << i;
    middle[i] = shared(rows, 2 * half, half - 1, row_variance);
    end[i] = shared(rows, 2 * half, 2 * half - 1, row_variance);
  }
  // Rows that drift slowly are alike across groups too: shared is what lies nearer to 1 than to the
  // least alike pairs. Those of 16 rows are too few to tell.
  double least = 1.0;
  for (std::size_t i = 0; i + 1 < middle.size(); ++i)
    least = std::min({least, middle[i].ratio, end[i].ratio});
  for (auto* pairs : {&middle, &end})
    for (Shared& p : *pairs) p.above = 0.5 * (1.0 + std::max(0.0, least));
  for (std::size_t i = 0; i < middle.size() && !middle[i].open(); ++i) {
    if (middle[i].yes()) continue;
    if (end[i].no()) return 1 << i;
    break;
  }
  if (rows_stand_alone(rows, row_variance)) return 1;
  const Shared &even = middle[0], &odd = end[0];
  if (odd.yes() && even.no())
    return Undecided{fmt::format(
        "rows 2k+1 and 2k+2 share their noise ({}), rows 2k and 2k+1 do not ({}): the groups start "
        "on an odd row; crop the frames by 1 row",
        odd.text(), even.text())};
  return Undecided{fmt::format(
      "share of row noise in common: rows 2k, 2k+1 {}; rows 2k+1, 2k+2 {}; no pattern of 1 to "
      "15 rows is three standard errors away from {:.2f}; where the camera is known to read "
      "another number of rows together, from row 0 on, give row_group = N in [sensor]",
      even.text(), odd.text(), even.above)};
}

std::string contradiction_of_group(const RowLagAccumulator& rows, const RowVariance& row,
                                   int declared) {
  if (rows.frames() < 2 || row.value_dn2 < kStandardErrors * row.standard_error_dn2) return {};
  if (const auto other = other_group(rows, row.value_dn2)) {
    const bool is_declared = other->is_at_start() && other->period == declared;
    return is_declared ? std::string() : other->text();
  }
  std::vector<Shared> pairs;
  double least = 1.0;
  for (int phase = 0; phase < declared; ++phase) {
    pairs.push_back(shared(rows, declared, phase, row.value_dn2));
    // Of few groups the scatter tells too little of the error: at least that of pairs that share
    // all, whose covariance over F frames has the relative variance 2/(F - 1).
    const double groups = std::max((rows.rows() - 1 - phase) / declared, 1);
    pairs.back().standard_error =
        std::max(pairs.back().standard_error, std::sqrt(2.0 / ((rows.frames() - 1) * groups)));
    least = std::min(least, pairs.back().ratio);
  }
  for (int phase = 0; phase + 1 < declared; ++phase) {
    Shared& pair = pairs[static_cast<std::size_t>(phase)];
    pair.above = 0.5 * (1.0 + std::max(0.0, least));
    if (pair.no())
      return fmt::format(
          "rows {} and {} of each {} do not share their noise ({}): if its groups end after row "
          "{}, crop the frames by {} row{}",
          phase, phase + 1, declared, pair.text(), phase, phase + 1, phase == 0 ? "" : "s");
  }
  return {};
}

}  // namespace malus
