#include "malus/denoise/frame_complaints.h"

#include "malus/base/text.h"

#include <fmt/format.h>

namespace malus {

std::vector<std::string> frame_complaints(const Denoised& result, std::int64_t of_picture) {
  constexpr double kManySaturated = 0.01;  // lamps and their reflections are fewer
  constexpr double kMuchCutOff = 0.01;
  std::vector<std::string> lines;
  if (const std::int64_t odd = result.nonfinite_pixels; odd > 0)
    lines.push_back(counted_are(odd, "pixel") + " NaN or infinite; " +
                    (of_picture > 0 ? odd == 1 ? "it is filled from its neighbours"
                                               : "they are filled from their neighbours"
                     : odd == 1     ? "it stays as it is"
                                    : "they stay as they are"));
  const double saturated =
      static_cast<double>(result.saturated_pixels) /
      static_cast<double>(of_picture > 0 ? of_picture : std::ssize(result.dn_above_black.values()));
  if (saturated > kManySaturated)
    lines.push_back(
        fmt::format("{} pixels, {} % of the frame, are saturated: they are brighter than they say, "
                    "by how much is not known; expose less",
                    result.saturated_pixels, percent_text(saturated)));
  if (result.cut_off_share > kMuchCutOff)
    lines.push_back(fmt::format(
        "{} % of its pixels are 0, where the camera cut the noise of dark places off: {}; raise "
        "the camera's black level by a few deviations of the noise",
        percent_text(result.cut_off_share),
        result.cut_off_undone ? "their light is worked out as far as the noise is known"
                              : "the light there and its DoLP come out wrong"));
  return lines;
}

}  // namespace malus
