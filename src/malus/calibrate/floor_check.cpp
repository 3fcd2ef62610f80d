#include "malus/calibrate/internal/floor_check.h"

#include "malus/base/index.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/random.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numeric>

namespace malus {
namespace {

// Normal deviates of the shares at or below codes that are counted from 0 on, at the codes' upper
// edges: between edges they are taken for a line, as they are one of normal noise.
class EdgeDeviates {
 public:
  explicit EdgeDeviates(const std::vector<double>& counts)
      : all_(std::accumulate(counts.begin(), counts.end(), 0.0)) {
    std::partial_sum(counts.begin(), counts.end(), std::back_inserter(below_));
  }
  std::size_t median_code() const {
    return as_index(std::lower_bound(below_.begin(), below_.end(), all_ / 2) - below_.begin());
  }
  double at(std::size_t code) const {
    const double least = 0.5 / all_;
    return normal_quantile(std::clamp(below_[code] / all_, least, 1.0 - least));
  }
  /// Contract: the median's code is not 0.
  double median() const {
    const std::size_t code = median_code();
    const double before = at(code - 1);
    return static_cast<double>(code) - 0.5 - before / (at(code) - before);
  }
  /// 0 beyond the last code.
  double share_above(double place) const {
    const double edge = std::floor(place - 0.5);
    const auto code = static_cast<std::size_t>(edge);
    if (code + 1 >= below_.size()) return 0.0;
    const double part = place - 0.5 - edge;
    return normal_cdf(-(at(code) + part * (at(code + 1) - at(code))));
  }
  double share_of_lowest() const { return below_[0] / all_; }

 private:
  double all_;
  std::vector<double> below_;
};

}  // namespace

bool reach_beyond_mirror(const std::vector<double>& counts) {
  constexpr double kOfLowest = 0.02;
  const EdgeDeviates edges(counts);
  if (edges.median_code() == 0) return true;
  return edges.share_above(2.0 * edges.median() + 0.5) > kOfLowest * edges.share_of_lowest();
}

FloorCheck::FloorCheck(const GainRun& run, DarkPass& dark) : run_(run), dark_(dark) {
  for (std::size_t c = 0; c < dark.floor_dn.size() && !codes_; ++c)
    if (is_raised(c)) codes_.emplace(run.geometry(), run.first_dn(), dark.step_dn);
}

void FloorCheck::settle() {
  if (!codes_) return;
  std::vector<double> true_codes_dn;  // the lowest code is one for all channels
  for (std::size_t c = 0; c < dark_.floor_dn.size(); ++c) {
    std::int64_t first = 0;
    if (is_raised(c) && reach_beyond_mirror(codes_->occurred(static_cast<int>(c), first)))
      true_codes_dn.push_back(dark_.floor_code_dn[c]);
  }
  for (std::size_t c = 0; c < dark_.floor_dn.size(); ++c) {
    if (!is_raised(c) || std::find(true_codes_dn.begin(), true_codes_dn.end(),
                                   dark_.floor_code_dn[c]) != true_codes_dn.end())
      continue;
    dark_.floor_dn[c] = run_.zero_dn()[c];
    dark_.floor_code_dn[c] = dark_.zero_share[c] = 0;
  }
}

}  // namespace malus
