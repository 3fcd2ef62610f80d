#include "malus/calibrate/internal/cut_off_noise.h"

#include "malus/base/error.h"
#include "malus/base/normal_nodes.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace malus {
namespace {

// Of one residual above the level, over the cuts that its pixel's offset may have: by how far it
// lies beyond the mirror image of the cut.
struct BeyondCut {
  double share = 0;    ///< of the cuts that it lies beyond
  double cut_dn = 0;   ///< sum of their distances from the level
  double excess = 0;   ///< DN
  double squares = 0;  ///< of its distance from the level, less the cut's
};

// Means over all residuals of those above the level.
using Mirrored = BeyondCut;

struct Cut {
  double distance_dn = 0, spread_dn = 0;  ///< from the true level
};

BeyondCut beyond(double residual_dn, const Cut& cut) {
  BeyondCut sum;
  for (const NormalNode& node : kNormalNodes) {
    const double at = cut.distance_dn + cut.spread_dn * node.at;
    if (!(residual_dn > at)) continue;
    sum.share += node.weight;
    sum.cut_dn += node.weight * at;
    sum.excess += node.weight * (residual_dn - at);
    sum.squares += node.weight * (residual_dn * residual_dn - at * at);
  }
  return sum;
}

// Offsets show by `slope`. A residual lies beyond the cut by what it is less the pixel's offset;
// the error of the latter is in the residual already, and counts once.
Cut cut_at(const CutOffPlace& place, double shift_dn, double slope) {
  const double offsets_dn2 = std::pow(place.spread_dn / slope, 2) - place.blur_dn2;
  return {place.level_dn - shift_dn, std::sqrt(std::max(offsets_dn2, 0.0))};
}

Mirrored mirrored_at(const ResidualHistogram& above, double residuals, const Cut& cut,
                     double shift_dn, double blur_dn2) {
  Mirrored sum;
  for (const ResidualHistogram::Cell& cell : above.cells()) {
    const BeyondCut one = beyond(above.centre_dn(cell) + shift_dn, cut);
    const double share = cell.count / residuals;
    sum.share += share * one.share;
    sum.cut_dn += share * one.cut_dn;
    sum.excess += share * one.excess;
    sum.squares += share * one.squares;
  }
  sum.squares -= 2 * blur_dn2 * sum.share;  // of the residuals', and what the cut's lacks
  return sum;
}

// Sampling variance of the true variance less that of the variance that shows. A residual r weighs
// in the former by r² and its part of the mirrored squares, and by moving the level that all are
// counted from (the influence function of an M-estimator: Hampel, JASA 69, 1974). The level is
// where the residuals, less what lies beyond the mirror image of the cut, have the mean 0.
double added_error_dn4(const ResidualHistogram& all, const ResidualHistogram& above, const Cut& cut,
                       double shift_dn, double trusted, const Mirrored& mirrored) {
  const double variance_per_level = -4 * (shift_dn + trusted * mirrored.cut_dn),
               level_per_residual = 1 / (1 - 2 * trusted * mirrored.share);
  double true_sum = 0, true_squares = 0, shown_sum = 0, shown_squares = 0;
  const auto add = [&](double count, double r) {
    if (!(count > 0)) return;
    const BeyondCut one = r > shift_dn ? beyond(r, cut) : BeyondCut{};
    const double own = r * r + trusted * one.squares +
                       variance_per_level * level_per_residual * (r - trusted * one.excess),
                 shown = (r - shift_dn) * (r - shift_dn);
    true_sum += count * own;
    true_squares += count * own * own;
    shown_sum += count * shown;
    shown_squares += count * shown * shown;
  };
  auto upper = above.cells().begin();
  for (const ResidualHistogram::Cell& both : all.cells()) {
    const bool some_above = upper != above.cells().end() && upper->index == both.index;
    const double up = some_above ? (upper++)->count : 0.0, distance = all.centre_dn(both);
    add(up, shift_dn + distance);
    add(both.count - up, shift_dn - distance);
  }
  const double n = all.count();
  const auto variance = [n](double sum, double squares) {
    return squares / n - (sum / n) * (sum / n);
  };
  return std::max(variance(true_sum, true_squares) - variance(shown_sum, shown_squares), 0.0) / n;
}

// Counts moved by a distance, in part to either cell around it.
void add_moved(double cells, double count, std::vector<double>& counts) {
  const double at = std::max(cells, 0.0), below = std::floor(at);
  const auto cell = static_cast<std::size_t>(below);
  if (counts.size() < cell + 2) counts.resize(cell + 2, 0.0);
  counts[cell] += count * (1.0 - (at - below));
  counts[cell + 1] += count * (at - below);
}

}  // namespace

CutOffNoise find_cut_off_noise(const ResidualHistogram& all, const ResidualHistogram& above,
                               const CutOffPlace& place) {
  CutOffNoise cut;
  const auto residuals = static_cast<double>(all.count());
  if (!(place.zero_share > 0) || place.zero_share > kMostMirroredZeros || !(residuals > 0))
    return cut;
  constexpr int kRounds = 30;  // each takes off at least 1 - 2 kMostMirroredZeros of the error
  Mirrored mirrored;
  Cut at;
  double trusted = 1;
  for (int round = 0; round < kRounds; ++round) {
    at = cut_at(place, cut.shift_dn, cut.slope);
    mirrored = mirrored_at(above, residuals, at, cut.shift_dn, place.blur_dn2);
    if (!(mirrored.share > 0)) return {};
    trusted = std::min(1.0, place.zero_share / mirrored.share);
    cut.shift_dn = trusted * mirrored.excess;
    cut.slope = 1.0 - trusted * mirrored.share;
  }
  cut.variance_dn2 = cut.shift_dn * cut.shift_dn + trusted * mirrored.squares;
  cut.variance_stderr_dn2 =
      std::sqrt(added_error_dn4(all, above, at, cut.shift_dn, trusted, mirrored));
  cut.known = true;
  return cut;
}

ResidualHistogram residuals_before_cut_off(const ResidualHistogram& all,
                                           const ResidualHistogram& above, const CutOffPlace& place,
                                           const CutOffNoise& cut) {
  MALUS_REQUIRE(cut.known && all.cell_dn() == above.cell_dn());
  constexpr double kSpreads = 3.0;
  const double cell = all.cell_dn(), shift = cut.shift_dn / cell;
  const double reach =  // of what is as it was, in cells; those cut off may fill the next one
      std::max(
          (place.level_dn - cut.shift_dn - kSpreads * place.spread_dn - place.step_dn) / cell - 1.0,
          0.0);
  // Of a cell that begins at `at`. Whole cells on either side would leave a gap between the two
  // halves, or count it twice: up to a hundredth of all residuals, other ones in each session.
  const auto beyond_reach = [reach](double at) { return std::clamp(at + 1 - reach, 0.0, 1.0); };
  std::vector<double> counts;
  const auto add_above = [&](double at, double count) {
    if (count > 0) add_moved(at, count * (1 + beyond_reach(at)), counts);
  };
  auto upper = above.cells().begin();
  for (const ResidualHistogram::Cell& both : all.cells()) {
    double up = 0;
    if (upper != above.cells().end() && upper->index == both.index) up = (upper++)->count;
    add_above(both.index + shift, up);
    // Between the mean that shows and the true level they lie above the latter, too.
    const double at = both.index - shift, down = both.count - up,
                 above_level = down * std::clamp(-at, 0.0, 1.0);
    add_above(std::max(-at - 1, 0.0), above_level);
    const double below = down - above_level, below_at = std::max(at, 0.0);
    if (below > 0) add_moved(below_at, below * (1 - beyond_reach(below_at)), counts);
  }
  ResidualHistogram out(cell);
  out.assign(counts);
  return out;
}

}  // namespace malus
