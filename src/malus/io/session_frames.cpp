// Gain and exposure of a session's frames: the session's words against those of the files.
#include "malus/base/error.h"
#include "malus/image/frame_mean.h"
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

bool exposures_differ(double frame_s, double set_s, bool declared) {
  // 1/60 s for 1/64 s and 30 s for 32 s: who measured them may say so. A third of a stop is 26 %.
  constexpr double kOfDeclared = 0.1, kOfFrames = 0.02;
  const double tolerance = declared ? kOfDeclared : kOfFrames;
  return std::abs(frame_s - set_s) > tolerance * std::max(std::abs(frame_s), std::abs(set_s));
}

std::optional<SettingsConflict> gain_conflict(const GainSetting& own, const GainSetting& of_set,
                                              const GainSetting& first) {
  const char* key = own.iso ? "iso" : "gain_db";
  if (!own.decibel()) return std::nullopt;
  if (own.contradicts(first)) return SettingsConflict{own.text(), first.text(), key, true};
  if (!of_set.decibel()) return SettingsConflict{own.text(), "", key, true};
  if (own.contradicts(of_set)) return SettingsConflict{own.text(), of_set.text(), key, false};
  return std::nullopt;
}

std::optional<SettingsConflict> exposure_conflict(const std::optional<double>& own,
                                                  const std::optional<double>& of_set,
                                                  const std::optional<double>& first) {
  constexpr const char* kKey = "exposure_s";
  if (!own || (of_set && *of_set == 0)) return std::nullopt;
  if (first && exposures_differ(*own, *first, false))
    return SettingsConflict{seconds(*own), seconds(*first), kKey, true};
  if (!of_set) return SettingsConflict{seconds(*own), "", kKey, true};
  if (exposures_differ(*own, *of_set, true))
    return SettingsConflict{seconds(*own), seconds(*of_set), kKey, false};
  return std::nullopt;
}

[[noreturn]] void refuse(const RawFrame& frame, const FrameGroup& group,
                         const SettingsConflict& conflict) {
  const auto& [own, of_set, key, with_first] = conflict;
  if (with_first)
    throw InputError(
        frame.source,
        fmt::format("was taken at {}, but {} of the same set {}", own, group.paths.front().string(),
                    of_set.empty() ? fmt::format("tells no {}", conflict.what()) : "at " + of_set),
        "give frames of each setting their own [[frames]]");
  throw InputError(
      frame.source, fmt::format("was taken at {}, the session says {}", own, of_set),
      fmt::format("correct {} in the session file, or leave it out: the files tell it", key));
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

std::optional<SettingsConflict> conflict_with_set(const CameraSettings& own,
                                                  const CameraSettings& of_set,
                                                  const CameraSettings& first) {
  auto conflict = gain_conflict(own.gain, of_set.gain, first.gain);
  return conflict ? conflict
                  : exposure_conflict(own.exposure_s, of_set.exposure_s, first.exposure_s);
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
  if (const auto conflict = conflict_with_set({frame.gain, frame.exposure_s},
                                              {group.gain, group.exposure_s}, group.told))
    refuse(frame, group, *conflict);
  if (group.kind != FrameKind::kReference) require_single(frame);
  if (group.gain.decibel()) frame.gain = group.gain;
  if (group.exposure_s) frame.exposure_s = group.exposure_s;
  return frame;
}

}  // namespace malus
