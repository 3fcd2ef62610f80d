#include "frame_input.h"

#include "malus/base/statistics.h"
#include "malus/image/frame_statistics.h"
#include "malus/polar/layout_check.h"

#include "program.h"
#include <fmt/format.h>

namespace malus::app {

RawFrame load_above_black(const std::filesystem::path& path, const FrameOptions& options) {
  const bool is_float = !options.raw_format && probe_frame(path, options).frame.bits == 0;
  if (!is_float) {
    RawFrame frame = load_frame(path, options);
    subtract_black(frame);
    return frame;
  }
  FrameOptions above = options;
  above.black_dn.clear();
  if (above.white_dn && !options.black_dn.empty()) *above.white_dn -= mean_of(options.black_dn);
  RawFrame frame = load_frame(path, above);
  frame.black_known = true;
  subtract_black(frame);
  return frame;
}

Image above_black(const RawFrame& frame) {
  RawFrame copy = frame;
  subtract_black(copy);
  return std::move(copy.dn);
}

void warn_of_guesses(const RawFrame& frame) {
  if (!frame.layout_known)
    warn(
        fmt::format("{}: layout not known, taken as {}; a colour or polarization mosaic needs its "
                    "own (--layout)",
                    frame.source, frame.layout.name()));
  const std::string complaint = layout_complaint(frame.layout, check_layout(frame.dn));
  if (!complaint.empty()) warn(fmt::format("{}: {}", frame.source, complaint));
  if (const std::string wrong = level_complaint(frame); !wrong.empty())
    warn(fmt::format("{}: {}", frame.source, wrong));
  if (!frame.black_known)
    warn(fmt::format("{}: black level not known, taken as 0{} (--black)", frame.source,
                     frame.layout.polarized() ? "; DoLP is too low if it is not" : ""));
}

}  // namespace malus::app
