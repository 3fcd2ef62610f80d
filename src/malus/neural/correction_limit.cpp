#include "malus/neural/correction_limit.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr int kSide = 4;  // of a cell
// Corrections that help are smaller than this share of what is stated of the guide: measured
// (docs/networks.md).
constexpr double kMostOfStated = 0.3;

struct CellSums {
  Image correction, stated;  // sums over a cell's pixels, DN^2
};

CellSums sums_over_cells(View<const float> guide_dn, View<const float> result_dn,
                         View<const float> variance_dn2) {
  const int rows = (guide_dn.rows() + kSide - 1) / kSide,
            cols = (guide_dn.cols() + kSide - 1) / kSide;
  CellSums sums{Image(rows, cols), Image(rows, cols)};
  parallel_for(0, rows, 4, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    const int last = std::min(static_cast<int>(end) * kSide, guide_dn.rows());
    for (int r = static_cast<int>(begin) * kSide; r < last; ++r)
      for (int c = 0; c < guide_dn.cols(); ++c) {
        if (!std::isfinite(variance_dn2(r, c))) continue;
        const float correction = result_dn(r, c) - guide_dn(r, c);
        sums.correction(r / kSide, c / kSide) += correction * correction;
        sums.stated(r / kSide, c / kSide) += variance_dn2(r, c);
      }
  });
  return sums;
}

// Over the 3x3 cells around with the weights 1 2 1.
double smoothed(const Image& sums, int i, int k) {
  double sum = 0;
  for (int a = -1; a <= 1; ++a)
    for (int b = -1; b <= 1; ++b)
      sum += static_cast<double>((2 - std::abs(a)) * (2 - std::abs(b))) *
             static_cast<double>(sums(std::clamp(i + a, 0, sums.rows() - 1),
                                      std::clamp(k + b, 0, sums.cols() - 1)));
  return sum;
}

}  // namespace

void limit_correction(View<const float> guide_dn, View<const float> variance_dn2,
                      View<float> result_dn) {
  const auto same_size = [&](const auto& view) {
    return view.rows() == guide_dn.rows() && view.cols() == guide_dn.cols();
  };
  MALUS_REQUIRE(same_size(result_dn) && same_size(variance_dn2));
  const CellSums sums = sums_over_cells(guide_dn, result_dn, variance_dn2);
  parallel_for(0, guide_dn.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < guide_dn.cols(); ++c) {
        if (!std::isfinite(variance_dn2(r, c))) continue;
        const double correction = smoothed(sums.correction, r / kSide, c / kSide),
                     stated = smoothed(sums.stated, r / kSide, c / kSide);
        if (correction <= kMostOfStated * stated) continue;
        const float share = static_cast<float>(std::sqrt(kMostOfStated * stated / correction));
        result_dn(r, c) = guide_dn(r, c) + share * (result_dn(r, c) - guide_dn(r, c));
      }
  });
}

}  // namespace malus
