#include "malus/neural/internal/correction_limit.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/image/sum_around.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr int kCellSide = 4;
// Corrections that help are smaller than this share of what is stated of the guide: measured
// (docs/networks.md).
constexpr double kMostOfStated = 0.3;

// Of the pixels that lie in a cell.
template <class Action>
void for_each_pixel(View<const float> mosaic, int i, int k, const Action& action) {
  for (int r = i * kCellSide; r < std::min((i + 1) * kCellSide, mosaic.rows()); ++r)
    for (int c = k * kCellSide; c < std::min((k + 1) * kCellSide, mosaic.cols()); ++c) action(r, c);
}

}  // namespace

void limit_correction(View<const float> guide_dn, View<const float> variance_dn2,
                      View<float> result_dn) {
  const auto same_size = [&](const auto& view) {
    return view.rows() == guide_dn.rows() && view.cols() == guide_dn.cols();
  };
  MALUS_REQUIRE(same_size(result_dn) && same_size(variance_dn2));
  const int rows = (guide_dn.rows() + kCellSide - 1) / kCellSide,
            cols = (guide_dn.cols() + kCellSide - 1) / kCellSide;
  Image corrections(rows, cols), variances(rows, cols);  // sums over the cells' pixels [DN^2]
  const auto for_each_cell = [&](const auto& action) {
    parallel_for(0, rows, 4, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
        for (int k = 0; k < cols; ++k) action(i, k);
    });
  };
  for_each_cell([&](int i, int k) {
    for_each_pixel(guide_dn, i, k, [&](int r, int c) {
      if (!std::isfinite(variance_dn2(r, c))) return;
      const float correction = result_dn(r, c) - guide_dn(r, c);
      corrections(i, k) += correction * correction;
      variances(i, k) += variance_dn2(r, c);
    });
  });
  for_each_cell([&](int i, int k) {
    const double correction = sum_around(corrections.view(), i, k),
                 most = kMostOfStated * sum_around(variances.view(), i, k);
    if (correction <= most) return;
    const auto share = static_cast<float>(std::sqrt(most / correction));
    for_each_pixel(guide_dn, i, k, [&](int r, int c) {
      if (!std::isfinite(variance_dn2(r, c))) return;
      result_dn(r, c) = guide_dn(r, c) + share * (result_dn(r, c) - guide_dn(r, c));
    });
  });
}

}  // namespace malus
