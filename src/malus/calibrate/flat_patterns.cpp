#include "malus/calibrate/internal/flat_patterns.h"

#include "malus/base/statistics.h"
#include "malus/calibrate/internal/channel_words.h"

#include <algorithm>
#include <cstddef>
#include <limits>

#include <fmt/format.h>

namespace malus {

void add_patterns(const FrameSet& flat, FlatLevel& level, const MatchingDark& dark,
                  const RawFrame& first, const std::vector<bool>& good, FlatPatterns& patterns) {
  if (std::find(good.begin(), good.end(), false) == good.end())
    patterns.neighbours.merge(level.neighbours);
  const std::vector<double> mean = level.temporal.mean_dn(level.filled, dark.shading_dn());
  std::vector<bool> bright;
  for (std::size_t c = 0; c < mean.size(); ++c)
    bright.push_back(good[c] && mean[c] > kResponseShare * (first.white_dn - first.black_dn[c]));
  if (std::find(bright.begin(), bright.end(), true) == bright.end()) return;
  LevelResponse response = patterns.response.add(
      level.temporal,
      {dark.shading_dn(), dark.shading_error_dn2, dark.shading_doubt_dn2, dark.shading_set()},
      level.filled, bright);
  // Of some channels it is no measure to compare with that of all.
  if (std::find(bright.begin(), bright.end(), false) != bright.end())
    response.variance = std::numeric_limits<double>::quiet_NaN();
  if (dark.frames == 0)
    patterns.darkless.push_back(
        {flat.exposure_s.value_or(0.0), mean_of(mean), response.variance, response.standard_error});
}

std::string response_missing(const FlatPatterns& patterns, const RawFrame& first) {
  std::vector<std::string> without;
  for (const int channel : patterns.response.channels_without())
    without.push_back(first.layout.channel_name(channel));
  const bool some = without.size() < first.black_dn.size();
  return fmt::format(
      "PRNU is not known: no flats that count for K lie above {:.0f} % of the range in {}; take "
      "brighter ones{}, or correct white = {:g}",
      100 * kResponseShare, some ? channels_text(without, first.layout) : "every channel",
      some ? ", or light that all channels see alike (white and unpolarized)" : "", first.white_dn);
}

}  // namespace malus
