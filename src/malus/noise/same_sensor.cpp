#include "malus/noise/same_sensor.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"
#include "malus/image/black_levels.h"

#include <fmt/format.h>

namespace malus {

void require_layout_of_model(const RawFrame& frame, const SensorLayout& model_layout) {
  if (frame.layout == model_layout) return;
  throw InputError(frame.source,
                   fmt::format("has the layout {}, the noise model {}", frame.layout.name(),
                               model_layout.name()),
                   "use this sensor's model, or declare the right layout with " +
                       setting("layout") + " or in a session's [sensor]");
}

std::string declaration_note(const RawFrame& frame) {
  if (frame.file_layout.empty()) return {};
  return fmt::format("its layout is {} as the file says, taken as {} as declared",
                     frame.file_layout, frame.layout.name());
}

void take_layout_of_model(RawFrame& frame, const SensorLayout& model_layout) {
  if (frame.layout_known) return require_layout_of_model(frame, model_layout);
  if (!frame.black_dn.empty()) frame.black_dn = blacks_for_layout(frame, model_layout);
  frame.layout = model_layout;
  frame.layout_known = true;
}

}  // namespace malus
