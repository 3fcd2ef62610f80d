#include "malus/calibrate/cut_off_noise.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

namespace malus {
namespace {

// Nodes and weights for a standard normal variable (Gauss-Hermite).
constexpr double kNode[] = {-2.8569700138728056, -1.3556261799742659, 0.0, 1.3556261799742659,
                            2.8569700138728056};
constexpr double kWeight[] = {0.011257411327720691, 0.22207592200561266, 0.53333333333333333,
                              0.22207592200561266, 0.011257411327720691};

// Per residual, of those whose mirror image lies below the cut.
struct Mirrored {
  double share = 0, excess = 0;  ///< excess: distance below the cut, DN
  double squares = 0;            ///< of the distances from the level, less the cut's
  double error = 0;              ///< variance of the mean of squares
};

// The cut lies place.level_dn - shift_dn below the true level.
Mirrored mirrored_at(const ResidualHistogram& above, double residuals, const CutOffPlace& place,
                     double shift_dn) {
  Mirrored sum;
  for (const ResidualHistogram::Cell& cell : above.cells()) {
    const double r = above.centre_dn(cell) + shift_dn, share = cell.count / residuals;
    double squares = 0;
    for (int i = 0; i < 5; ++i) {
      const double cut = place.level_dn - shift_dn + place.spread_dn * kNode[i];
      if (!(r > cut)) continue;
      sum.share += share * kWeight[i];
      sum.excess += share * kWeight[i] * (r - cut);
      squares += kWeight[i] * (r * r - cut * cut);
    }
    sum.squares += share * squares;
    sum.error += share * squares * squares / residuals;
  }
  return sum;
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
  double trusted = 1;
  for (int round = 0; round < kRounds; ++round) {
    mirrored = mirrored_at(above, residuals, place, cut.shift_dn);
    if (!(mirrored.share > 0)) return {};
    trusted = std::min(1.0, place.zero_share / mirrored.share);
    cut.shift_dn = trusted * mirrored.excess;
  }
  cut.variance_dn2 = cut.shift_dn * cut.shift_dn + trusted * mirrored.squares;
  cut.variance_stderr_dn2 = trusted * std::sqrt(mirrored.error);
  cut.slope = 1.0 - trusted * mirrored.share;
  cut.known = true;
  return cut;
}

ResidualHistogram residuals_before_cut_off(const ResidualHistogram& all,
                                           const ResidualHistogram& above, const CutOffPlace& place,
                                           const CutOffNoise& cut) {
  MALUS_REQUIRE(cut.known && all.cell_dn() == above.cell_dn());
  constexpr double kSpreads = 3.0;
  const double cell = all.cell_dn(), shift = cut.shift_dn / cell;
  const double reach =  // of what is as it was, in cells
      std::max(
          (place.level_dn - cut.shift_dn - kSpreads * place.spread_dn - place.step_dn) / cell - 1.0,
          0.0);
  std::vector<double> counts;
  auto upper = above.cells().begin();
  for (const ResidualHistogram::Cell& both : all.cells()) {
    double up = 0;
    if (upper != above.cells().end() && upper->index == both.index) up = (upper++)->count;
    if (up > 0) {
      const double at = both.index + shift;
      add_moved(at, at < reach ? up : 2 * up, counts);
    }
    const double at = both.index - shift, down = both.count - up;
    if (down > 0 && at < reach) add_moved(at, down, counts);
  }
  ResidualHistogram out(cell);
  out.assign(counts);
  return out;
}

}  // namespace malus
