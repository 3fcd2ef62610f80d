// Gain and exposure of a session's frames: the session's words against those of the files.
#include "malus/base/error.h"
#include "malus/io/session.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

FrameOptions options_of_sensor(const Session& session, const FrameGroup& group) {
  FrameOptions options = frame_options(session, group);
  options.gain = {};
  options.exposure_s.reset();
  return options;
}

std::string seconds(double exposure_s) { return fmt::format("{:.6g} s", exposure_s); }

[[noreturn]] void refuse_mixed(const RawFrame& frame, const std::string& own,
                               const FrameGroup& group, const std::string& first) {
  throw InputError(frame.source,
                   fmt::format("was taken at {}, but {} of the same set {}", own,
                               group.paths.front().string(), first),
                   "give frames of each setting their own [[frames]]");
}

[[noreturn]] void refuse_declared(const RawFrame& frame, const std::string& own,
                                  const std::string& declared, const char* key) {
  throw InputError(
      frame.source, fmt::format("was taken at {}, the session says {}", own, declared),
      fmt::format("correct {} in the session file, or leave it out: the files tell it", key));
}

void check_gain(const RawFrame& frame, const FrameGroup& group) {
  const GainSetting &own = frame.gain, &first = group.told.gain;
  if (!own.decibel()) return;
  if (own.contradicts(first)) refuse_mixed(frame, own.text(), group, "at " + first.text());
  if (!group.gain.decibel()) refuse_mixed(frame, own.text(), group, "tells no gain");
  if (own.contradicts(group.gain))
    refuse_declared(frame, own.text(), group.gain.text(), own.iso ? "iso" : "gain_db");
}

void check_exposure(const RawFrame& frame, const FrameGroup& group) {
  const auto &own = frame.exposure_s, &first = group.told.exposure_s;
  // A bias set may be declared to have no exposure at all.
  if (!own || (group.exposure_s && *group.exposure_s == 0)) return;
  if (first && exposures_differ(*own, *first, false))
    refuse_mixed(frame, seconds(*own), group, "at " + seconds(*first));
  if (!group.exposure_s) refuse_mixed(frame, seconds(*own), group, "tells no exposure");
  if (exposures_differ(*own, *group.exposure_s, true))
    refuse_declared(frame, seconds(*own), seconds(*group.exposure_s), "exposure_s");
}

}  // namespace

std::optional<SettingsFault> fault_of(const CameraSettings& settings, bool with_zero_exposure) {
  const auto &gain_db = settings.gain.gain_db, &iso = settings.gain.iso,
             &exposure_s = settings.exposure_s;
  // Cameras that count in tenths of a decibel, or an ISO under the wrong key.
  constexpr double kMostDecibel = 100.0;
  if (gain_db && !(std::abs(*gain_db) <= kMostDecibel))
    return SettingsFault{"gain_db", fmt::format("is {:g} dB, beyond any camera's", *gain_db),
                         "give decibels, a factor of 10 per 20 dB; ISO goes under iso"};
  if (gain_db && iso)
    return SettingsFault{"iso", "stands beside gain_db", "keep the one that the camera uses"};
  if (iso && !(std::isfinite(*iso) && *iso > 0))
    return SettingsFault{"iso", fmt::format("is {:g}", *iso), "ISO is positive"};
  if (exposure_s &&
      !(std::isfinite(*exposure_s) && *exposure_s >= 0 && (*exposure_s > 0 || with_zero_exposure)))
    return SettingsFault{"exposure_s", fmt::format("is {:g} s", *exposure_s),
                         "an exposure is positive"};
  return std::nullopt;
}

bool exposures_differ(double frame_s, double set_s, bool declared) {
  // 1/60 s for 1/64 s and 30 s for 32 s: who measured them may say so. A third of a stop is 26 %.
  constexpr double kOfDeclared = 0.1, kOfFrames = 0.02;
  const double tolerance = declared ? kOfDeclared : kOfFrames;
  return std::abs(frame_s - set_s) > tolerance * std::max(std::abs(frame_s), std::abs(set_s));
}

Session with_settings_of_files(Session session) {
  for (FrameGroup& group : session.groups) {
    if (group.paths.empty()) continue;
    const RawFrame first =
        probe_frame(group.paths.front(), options_of_sensor(session, group)).frame;
    group.told = {first.gain, first.exposure_s};
    if (!group.gain.decibel()) group.gain = first.gain;
    if (!group.exposure_s) group.exposure_s = first.exposure_s;
  }
  return session;
}

RawFrame load_session_frame(const Session& session, const FrameGroup& group, const fs::path& path) {
  RawFrame frame = load_frame(path, options_of_sensor(session, group));
  check_gain(frame, group);
  check_exposure(frame, group);
  if (group.gain.decibel()) frame.gain = group.gain;
  if (group.exposure_s) frame.exposure_s = group.exposure_s;
  return frame;
}

}  // namespace malus
