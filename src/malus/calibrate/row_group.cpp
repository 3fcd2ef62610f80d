#include "malus/calibrate/row_group.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>

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

// Mean covariance of rows r, r+1 with r % period == phase, relative to the row variance.
Shared shared(const RowLagAccumulator& rows, int period, int phase, double row_variance_dn2) {
  Moments covariance;
  for (int r = phase; r + 1 < rows.rows(); r += period) covariance.add(rows.covariance_dn2(r, 1));
  if (covariance.count() < 4 || !(row_variance_dn2 > 0)) return {0.5, 1.0};
  return {covariance.mean() / row_variance_dn2,
          std::sqrt(covariance.variance() / static_cast<double>(covariance.count())) /
              row_variance_dn2};
}

}  // namespace

Estimate<int> detect_row_group(const RowLagAccumulator& rows, double pixel_variance_dn2, int cols) {
  if (rows.frames() < 2) return Undecided{"one bias frame cannot tell row noise from fixed rows"};
  Moments variance;
  for (int r = 0; r < rows.rows(); ++r) variance.add(rows.covariance_dn2(r, 0));
  const double row_variance = variance.mean() - pixel_variance_dn2 / cols;
  const double row_variance_se =
      std::sqrt(variance.variance() / static_cast<double>(variance.count()));
  if (row_variance < kStandardErrors * row_variance_se)
    return Undecided{fmt::format(
        "row noise is too weak: {:.3g} DN² against a standard error of {:.3g} DN², and 3 of these "
        "are needed",
        row_variance, row_variance_se)};
  Shared even = shared(rows, 2, 0, row_variance), odd = shared(rows, 2, 1, row_variance),
         second = shared(rows, 4, 1, row_variance), fourth = shared(rows, 4, 3, row_variance);
  // Rows that drift slowly are alike across groups too: shared is what lies nearer to 1 than to the
  // least alike pairs.
  const double least = std::max(0.0, std::min({even.ratio, odd.ratio, second.ratio, fourth.ratio}));
  for (Shared* pairs : {&even, &odd, &second, &fourth}) pairs->above = 0.5 * (1.0 + least);
  if (even.no() && odd.no()) return 1;
  if (even.yes() && second.no() && fourth.no()) return 2;
  if (even.yes() && second.yes() && fourth.no()) return 4;
  if (odd.yes() && even.no())
    return Undecided{fmt::format(
        "rows 2k+1 and 2k+2 share their noise ({}), rows 2k and 2k+1 do not ({}): the groups start "
        "on an odd row; crop the frames by one row",
        odd.text(), even.text())};
  return Undecided{fmt::format(
      "share of row noise in common: rows 2k, 2k+1 {}; rows 2k+1, 2k+2 {}; neither pattern of 1, 2 "
      "or 4 rows is three standard errors away from {:.2f}",
      even.text(), odd.text(), even.above)};
}

}  // namespace malus
