#include "malus/denoise/internal/censored_error.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

// Saturated pixels are counted among the 5x5 of a channel around each. With 3x3 the share is too
// uneven (docs/uncertainty.md has the measurement), with more it comes from further than light
// keeps its level.
constexpr int kReach = 2, kMost = (2 * kReach + 1) * (2 * kReach + 1);
// From there on the Gaussian's bias is below 0.0004 deviations: a darker pixel is beside an edge.
constexpr double kNoiseReach = 3;

// The bias of `saturated` of `all` pixels, for the whole counts that there are.
class BiasTable {
 public:
  BiasTable() {
    for (int all = 1; all <= kMost; ++all)
      for (int saturated = 1; saturated < all; ++saturated)
        of(saturated, all) = censoring_bias(static_cast<double>(saturated) / all);
  }
  double operator()(int saturated, int all) const { return bias_[index(saturated, all)]; }

 private:
  double& of(int saturated, int all) { return bias_[index(saturated, all)]; }
  static std::size_t index(int saturated, int all) {
    return static_cast<std::size_t>(all) * (kMost + 1) + static_cast<std::size_t>(saturated);
  }
  std::array<double, (kMost + 1) * (kMost + 1)> bias_{};
};

// Calls add(place) for the places within kReach periods of `at` on an axis of `size`.
template <class Function>
int for_neighbours(int at, int period, int size, const Function& add) {
  int count = 0;
  for (int i = -kReach; i <= kReach; ++i)
    if (const int place = at + i * period; place >= 0 && place < size) {
      add(place);
      ++count;
    }
  return count;
}

}  // namespace

// E (x - w)+ of a Gaussian of mean m and deviation s is s (phi(z) - z Q(z)), z = (w - m) / s, where
// Q(z) is the probability above w (Tobin, Econometrica 26, 1958; Johnson, Kotz, Balakrishnan,
// Continuous Univariate Distributions 1, 1994, 13.10).
double censoring_bias(double share_above_white) {
  const double z = -normal_quantile(share_above_white);
  return normal_density(z) - z * share_above_white;
}

void add_censoring_error(const PreparedFrame& frame, const NoiseProfile& profile,
                         View<const float> estimate_dn, Image& variance_dn2) {
  static const BiasTable bias;
  const int rows = frame.dn.rows(), cols = frame.dn.cols();
  std::vector<double> deviation_dn;
  for (std::size_t k = 0; k < profile.channels.size(); ++k)
    deviation_dn.push_back(std::sqrt(profile.channels[k].variance(double{frame.saturated_dn[k]})));
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    std::vector<int> in_column(static_cast<std::size_t>(cols));
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      std::ranges::fill(in_column, 0);
      bool any = false;
      const int high = for_neighbours(r, frame.layout.rows(), rows, [&](int row) {
        for (int c = 0; c < cols; ++c)
          if (frame.saturated(row, c)) {
            ++in_column[static_cast<std::size_t>(c)];
            any = true;
          }
      });
      for (int c = 0; any && c < cols; ++c) {
        const auto k = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        if (frame.saturated(r, c) ||
            estimate_dn(r, c) < frame.saturated_dn[k] - kNoiseReach * deviation_dn[k])
          continue;
        int saturated = 0;
        const int wide = for_neighbours(c, frame.layout.cols(), cols, [&](int col) {
          saturated += in_column[static_cast<std::size_t>(col)];
        });
        if (saturated == 0) continue;
        const double error_dn = deviation_dn[k] * bias(saturated, high * wide);
        variance_dn2(r, c) += static_cast<float>(error_dn * error_dn);
      }
    }
  });
}

}  // namespace malus
