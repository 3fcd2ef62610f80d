// What every format's reader hands over, before the user's options are applied.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/raw_frame.h"
#include "malus/image/view.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace malus::internal {

/// Pixels (absent after a probe) and the file's own metadata.
struct Decoded {
  std::string format;  ///< "png", "tiff", "fits", ...
  std::string sample;  ///< "uint8", "float", ...
  std::string camera;
  int rows = 0, cols = 0, channels = 0;
  int bits = 0;  ///< of integer data, 0 for float
  std::vector<std::string> names;
  Planes planes;          ///< values as stored; empty after a probe
  bool sheets = false;    ///< the channels lie one after the other, as frames of a stack would
  bool negative = false;  ///< says that 0 is white; a camera's codes are not turned round by that

  std::optional<SensorLayout> layout;
  std::vector<double> black_dn;  ///< one, or one per channel of the layout; empty: not told
  std::optional<double> white_dn;
  GainSetting gain;
  std::optional<double> exposure_s;
  int mean_of = 1;          ///< frames, as RawFrame's
  std::string holds;        ///< what the values are, of malus' own tags; mostly empty
  std::string description;  ///< free text of the file; may hold malus' own tags (frame_tags.h)
};

/// Largest frame that is read: rows and columns are ints.
constexpr std::int64_t kMaxPixels = (std::int64_t{1} << 31) - 1;
/// Largest number of planes in one picture file.
constexpr int kMaxChannels = 1024;

}  // namespace malus::internal
