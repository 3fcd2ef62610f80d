#include "frame_input.h"

#include "malus/base/statistics.h"
#include "malus/image/frame_statistics.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/layout_check.h"

#include "program.h"
#include <fmt/format.h>

namespace malus::app {

RawFrame load_above_black(const std::filesystem::path& path, const FrameOptions& options,
                          FloatBlack float_black) {
  FrameOptions above = options;
  above.black_dn.clear();
  const bool is_float = !options.raw_format && probe_frame(path, above).frame.bits == 0;
  const bool tells = is_float && probe_frame(path, above).frame.black_known;
  const bool holds = float_black == FloatBlack::kHolds && !options.black_dn.empty();
  if (!is_float || (holds && !tells)) {
    RawFrame frame = load_frame(path, options);
    subtract_black(frame);
    return frame;
  }
  if (holds)
    warn(fmt::format("{}: says that it is above black; --black is not subtracted", path.string()));
  if (above.white_dn && !options.black_dn.empty()) *above.white_dn -= mean_of(options.black_dn);
  RawFrame frame = load_frame(path, above);
  frame.black_known = true;
  subtract_black(frame);
  return frame;
}

FrameOptions options_for_model(const FrameOptions& options, const NoiseModel& model,
                               const std::filesystem::path& input) {
  FrameOptions fallback;
  fallback.layout = model.layout;
  const RawFrame known = probe_frame(input, merged(options, fallback)).frame;
  require_layout_of_model(known, model.layout);
  const bool is_float = !options.raw_format && known.bits == 0;
  if (!known.white_known && model.white_dn > 0) fallback.white_dn = model.white_dn;
  if (known.black_known) return merged(options, fallback);
  fallback.black_dn = model.black_dn;
  const double black = mean_of(model.black_dn);
  if (is_float && black != 0) {
    fallback.black_dn = {0.0};
    if (fallback.white_dn) *fallback.white_dn -= black;
    warn(
        fmt::format("{}: black level not known; float pixels are taken as DN above black, give "
                    "--black {:g} if they hold the camera's",
                    input.string(), black));
  }
  return merged(options, fallback);
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
