#include "malus/calibrate/internal/flat_patterns.h"

#include "malus/calibrate/internal/channel_words.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include <fmt/format.h>

namespace malus {

void FlatPatterns::add(const FrameFormat& format, const FrameSet& flat, FlatLevel& level,
                       const MatchingDark& dark, const std::vector<bool>& good) {
  if (std::find(good.begin(), good.end(), false) == good.end()) neighbours.merge(level.neighbours);
  const std::vector<double> mean = level.temporal.mean_dn(level.left_out, dark.shading_dn());
  std::vector<bool> bright;
  for (std::size_t c = 0; c < mean.size(); ++c)
    bright.push_back(good[c] && mean[c] > kResponseShare * format.range_dn(c));
  if (std::find(bright.begin(), bright.end(), true) == bright.end()) return;
  LevelResponse of_level =
      response.add(level.temporal,
                   {dark.shading_dn(), dark.shading_error_dn2, dark.shading_doubt_dn2,
                    dark.shading_set(), dark.shading_frames, dark.darkless_s},
                   level.left_out, bright);
  // Of some channels it is no measure to compare with that of all.
  if (std::find(bright.begin(), bright.end(), false) != bright.end())
    of_level.variance = std::numeric_limits<double>::quiet_NaN();
  double s2_per_dn2 = 0;
  for (const double signal_dn : mean)
    s2_per_dn2 += std::pow(dark.darkless_s / signal_dn, 2) / static_cast<double>(mean.size());
  of_response.push_back({flat.exposure_s.value_or(0.0), dark.darkless_s, s2_per_dn2,
                         of_level.variance, of_level.standard_error});
}

std::string FlatPatterns::response_missing(const FrameFormat& format,
                                           const std::string& refused) const {
  std::vector<std::string> without;
  for (const int channel : response.channels_without())
    without.push_back(format.layout.channel_name(channel));
  const bool some = without.size() < format.black_dn.size();
  const std::string channels = some ? channels_text(without, format.layout) : "every channel";
  if (!refused.empty())
    return fmt::format(
        "PRNU is not known: no flats above {:.0f} % of the range in {} count for K; of those there "
        "{}",
        100 * kResponseShare, channels, refused);
  return fmt::format(
      "PRNU is not known: no flats that count for K lie above {:.0f} % of the range in {}; take "
      "brighter ones{}, or correct white = {:g}",
      100 * kResponseShare, channels,
      some ? ", or light that all channels see alike (white and unpolarized)" : "",
      format.white_dn);
}

}  // namespace malus
