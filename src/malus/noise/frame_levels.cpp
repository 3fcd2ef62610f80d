#include "malus/noise/frame_levels.h"

#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/image/black_levels.h"
#include "malus/noise/same_sensor.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {
namespace {

// Such a model holds one gain: several without a name could not be told apart.
bool tells_no_gain(const NoiseModel& model) {
  const auto untold = [](const auto& calibrations) {
    return !calibrations.empty() && !calibrations.front().gain.decibel();
  };
  return untold(model.physics) || untold(model.gaussian) || untold(model.nonparametric) ||
         untold(model.dark_frames);
}

}  // namespace

std::string take_levels_of_model(const NoiseModel& model, RawFrame& frame, bool white_stated) {
  take_layout_of_model(frame, model.layout);
  std::string warning;
  double white_dn = model.white_dn;
  if (!frame.black_known) {
    const double black = mean_of(model.black_dn);
    const bool above_already = !frame.holds_codes() && black != 0;
    if (above_already) {
      frame.black_dn.assign(model.black_dn.size(), 0.0);
      white_dn = white_above_black(white_dn, model.black_dn);
      if (white_stated) frame.white_dn = white_above_black(frame.white_dn, model.black_dn);
      warning = fmt::format(
          "black level not known; float pixels are taken as DN above black, give {} if they hold "
          "the camera's",
          setting("black", black));
    } else {
      frame.black_dn = model.black_dn;
    }
    frame.black_known = true;
  }
  if (!frame.white_known && model.white_dn > 0) {
    frame.white_dn = white_dn;
    frame.white_known = true;
  }
  require_levels(frame);
  return warning;
}

void require_gain(const RawFrame& frame, const GainSetting& told, const std::string& asked) {
  if (!frame.gain.contradicts(told)) return;
  throw InputError(
      frame.source,
      fmt::format("was taken at {}, {} says {}", frame.gain.text(), asked, told.text()),
      "give the frame's own gain");
}

std::string untold_gain_complaint(const NoiseModel& model, const std::vector<GainSetting>& asked) {
  if (!tells_no_gain(model)) return {};
  std::vector<std::string> names;
  for (const GainSetting& gain : asked)
    if (gain.decibel() && std::ranges::find(names, gain.text()) == names.end())
      names.push_back(gain.text());
  if (names.empty()) return {};
  return "does not say its gain; it is taken for " + joined(names, " and ");
}

}  // namespace malus
