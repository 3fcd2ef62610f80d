#include "frame_input.h"

#include "malus/base/statistics.h"

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

}  // namespace malus::app
