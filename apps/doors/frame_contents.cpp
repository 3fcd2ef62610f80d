#include "frame_contents.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/io/picture_file.h"

#include <fmt/format.h>

namespace malus::app {

StatedLevels levels_for_frame(const RawFrame& told, const FrameOptions& options,
                              FloatBlack float_black) {
  const bool tells_above = told.black_known && mean_of(told.black_dn) == 0;
  if (options.black_dn.empty() || told.bits > 0 || (told.black_known && !tells_above) ||
      (float_black == FloatBlack::kHolds && !tells_above))
    return {options, {}};
  StatedLevels levels{options, {}};
  const double stated_dn = mean_of(options.black_dn);
  if (float_black == FloatBlack::kHolds && stated_dn != 0)
    levels.warning =
        fmt::format("says that it is above black; {} is not subtracted", setting("black"));
  if (float_black == FloatBlack::kNotSaid && !tells_above && stated_dn != 0)
    levels.warning =
        fmt::format("float pixels are taken as DN above black, give {} if they hold the camera's",
                    setting("black", stated_dn));
  FrameOptions& above = levels.options;
  above.black_dn.clear();
  if (above.white_dn) above.white_dn = white_above_black(*above.white_dn, options.black_dn);
  if (!tells_above) above.black_dn = {0.0};
  return levels;
}

StatedLevels levels_for_file(const std::filesystem::path& path, const FrameOptions& options,
                             FloatBlack float_black) {
  if (options.black_dn.empty()) return {options, {}};
  FrameOptions without_black = options;
  without_black.black_dn.clear();
  return levels_for_frame(probe_frame(path, without_black).frame, options, float_black);
}

void require_raw(const std::string& source, const std::string& holds, const std::string& remedy) {
  if (holds == kHoldsDenoised)
    throw InputError(
        source, fmt::format("is denoised: {} states the noise of raw frames", setting("model")),
        remedy);
}

}  // namespace malus::app
