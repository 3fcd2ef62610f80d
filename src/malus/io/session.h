// Session files (TOML): which frames were taken how. The input of calibrate and pairs, the output
// of capture.
#pragma once

#include "malus/io/config_section.h"
#include "malus/io/frame_file.h"

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// The largest numbers that a session takes; row groups begin at 1, levels at 0.
inline constexpr int kLargestRowGroup = 64, kLargestLevel = 1'000'000;

enum class FrameKind { kBias, kFlat, kBurst, kReference, kShort, kLong };

std::string_view frame_kind_name(FrameKind kind);  ///< "bias", "flat", ...
std::vector<std::string> frame_kind_names();

struct SensorDescription {
  std::string name;                    ///< free text; may be empty
  std::optional<SensorLayout> layout;  ///< a name or [sensor.cell]; unset: the files tell, or mono
  std::vector<double> black_dn;        ///< empty: the files tell; one number, or one per channel
  std::optional<double> white_dn;
  std::optional<int> row_group;         ///< rows that are read out together; unset: detected
  std::optional<RawFormat> raw_format;  ///< headerless frames
  int rows = 0, cols = 0;               ///< 0 = any; `size = "2448x2048"`, width first
};

/// How a camera was set, as far as it is known.
struct CameraSettings {
  GainSetting gain;
  std::optional<double> exposure_s;
};

/// What is wrong with settings that somebody tells, for an InputError; key as in a session file.
struct SettingsFault {
  std::string key, problem, remedy;
};
/// Of numbers that are not finite, a gain beyond 100 dB, gain_db beside iso, an ISO that is not
/// positive, a negative exposure or, but for with_zero_exposure, one of 0.
std::optional<SettingsFault> fault_of(const CameraSettings& settings, bool with_zero_exposure);

/// What of a frame's own settings is another than its set's.
struct SettingsConflict {
  std::string own, of_set;  ///< "24 dB", "0.01 s"; of_set is empty where the set tells none
  std::string key;          ///< as in a session file
  bool with_first = false;  ///< the set's first frame tells another; else what is declared does
  const char* what() const { return key == "exposure_s" ? "exposure" : "gain"; }
};
/// of_set: as declared, else what its first frame tells of itself, which is `first`. An exposure
/// that somebody declared may be round, as cameras write them; those of frames differ by rounding
/// alone. A bias set may be declared to have no exposure at all.
std::optional<SettingsConflict> conflict_with_set(const CameraSettings& own,
                                                  const CameraSettings& of_set,
                                                  const CameraSettings& first);

/// Frames of one setting. A `flat` group is one light level; a `bias` group with an exposure is the
/// dark set of the flats with the same exposure.
struct FrameGroup {
  FrameKind kind = FrameKind::kBias;
  GainSetting gain;
  std::optional<double> exposure_s;
  std::optional<int> level;
  /// Existing files, or frames of stacks by their names (frame_stack.h), absolute or relative to
  /// the process.
  std::vector<std::filesystem::path> paths;
  CameraSettings told;  ///< what the first frame says of itself: with_settings_of_files
};

struct Session {
  SensorDescription sensor;
  std::vector<FrameGroup> groups;
  std::filesystem::path source;  ///< the session file, for messages
};

/// Reads and checks everything that can be checked without reading pixels; globs (* ? [..] in any
/// part of a path) are sorted by number ("f2" before "f10"). A path may be one of a file, else of
/// a stack's frame, stack.tif[3], else a glob; a stack counts as its frames. Throws InputError that
/// names the key or pattern: unknown keys and names (with the nearest), wrong types, non-positive
/// or non-finite numbers, black >= white, a negative black of headerless frames, a gain beyond 100
/// dB, both gain_db and iso, no [[frames]], a pattern without a match, a frame that is named twice
/// (links followed) in sets that cannot share it; and as count_frames.
Session load_session(const std::filesystem::path& path);

/// Its [sensor] section alone: the file may have no [[frames]], and theirs need not exist.
SensorDescription load_sensor(const std::filesystem::path& path);

/// A session from text; folder is what relative paths start from. With check_files false patterns
/// are not expanded: paths stay as written.
Session parse_session(std::string_view toml, const std::filesystem::path& source,
                      const std::filesystem::path& folder, bool check_files = true);

/// The [sensor] section, which capture plans share with sessions.
SensorDescription parse_sensor(const ConfigSection& section);
/// The value of the key "kind"; throws InputError that lists the kinds.
FrameKind parse_frame_kind(const ConfigSection& section);

/// Writes paths relative to the session file where they lie below it. Throws InputError where a
/// path as written, or the sensor's name, is not UTF-8.
void save_session(const std::filesystem::path& path, const Session& session, bool force);

/// What load_frame needs for this group's frames.
FrameOptions frame_options(const Session& session, const FrameGroup& group);

/// The session with what files tell where it is silent: gain and exposure of each group from the
/// header of its first file. The others are checked when they are loaded.
Session with_settings_of_files(Session session);

/// A frame of a group of such a session. Throws InputError, with both numbers, where the frame's
/// file tells another gain or exposure than the session or the group's first file; files that tell
/// none are taken at the session's word.
RawFrame load_session_frame(const Session& session, const FrameGroup& group,
                            const std::filesystem::path& path);

}  // namespace malus
