// Where calibration gets its frames: sets of frames taken at one setting, loaded one at a time. A
// session file fills them; tests and simulations give functions instead of files.
#pragma once

#include "malus/base/progress.h"
#include "malus/calibrate/geometry.h"
#include "malus/image/raw_frame.h"
#include "malus/io/session.h"

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// Frames of one kind, gain, exposure and light level.
struct FrameSet {
  FrameKind kind = FrameKind::kBias;
  GainSetting gain;
  std::optional<double> exposure_s;
  std::optional<int> level;
  int count = 0;
  /// Frame i, 0 <= i < count. Called from several threads at once, each i at most once per pass.
  std::function<RawFrame(int)> load;
  std::string name;  ///< for messages: "flat, 12 dB, 0.01 s"
};

struct CalibrationInput {
  std::string sensor;
  std::string origin;            ///< what the model will say of where its numbers come from
  std::optional<int> row_group;  ///< declared; otherwise detected
  std::vector<FrameSet> sets;
};

/// What the frames of a sensor have in common.
struct FrameFormat {
  SensorLayout layout;
  int rows = 0, cols = 0;
  std::vector<double> black_dn;  ///< one per channel
  double white_dn = 0;           ///< black included
  bool black_known = false;      ///< from file or session, not guessed
  std::string source;            ///< file of the frame that told it, for messages

  double black_at(int row, int col) const {
    return black_dn[static_cast<std::size_t>(layout.channel_at(row, col))];
  }
  /// White above a channel's black, and above the mean of all channels'.
  double range_dn(std::size_t channel) const { return white_dn - black_dn[channel]; }
  double mean_range_dn() const;
  MosaicGeometry geometry(int row_group) const { return {layout, rows, cols, row_group}; }
};
FrameFormat format_of(const RawFrame& frame);

/// "flat, 12 dB, 0.01 s, level 3".
std::string frame_set_name(const FrameSet& set);

/// The frames of a session. Groups of one kind, gain, exposure and level become one set; gain and
/// exposure that the session does not tell are the files' (with_settings_of_files).
CalibrationInput calibration_input(const Session& session);

/// The largest set of dark frames at a gain, of equal ones that of the shortest exposure (none
/// stated: no flat's): its bias frames. Others have the exposures of flats and their dark signal.
/// Null where there is none.
const FrameSet* bias_set_at(const GainSetting& gain, const CalibrationInput& input);

/// Throws InputError where some sets name their gain in dB and others in ISO: what one is of the
/// other depends on the camera, and no model over gain is made of both.
void require_one_gain_unit(const CalibrationInput& input);

/// The set's first frame, which tells size, layout, black and white. Throws InputError when it is
/// smaller than four cells of its layout in either direction: there is nothing to average.
RawFrame load_first(const FrameSet& set);

/// Per channel, what for_each_frame makes of DN 0 in a frame like this one: 0 where it moves
/// nothing.
std::vector<double> moved_zero_dn(const FrameFormat& like, const RawFrame& frame);

/// Calls use(frame, i) for every frame of the set in order, decoding the next ones in other threads
/// meanwhile: memory holds a few frames, however many there are. Every frame must have the size and
/// layout of `like` (when it is given), only finite pixels, and not the pixels of an earlier one
/// (unless nearly all have one value, or the set is a reference), else InputError names it. Where
/// frame and `like` both know their black level, pixels are moved by its difference: DN above the
/// black of `like` are then those above the file's own. Throws Cancelled when a stop is requested;
/// advances progress by one per frame.
void for_each_frame(const FrameSet& set, const FrameFormat* like, Progress& progress,
                    const std::function<void(const RawFrame&, int)>& use);

}  // namespace malus
