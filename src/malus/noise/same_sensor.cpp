#include "malus/noise/same_sensor.h"

#include "malus/base/error.h"

#include <fmt/format.h>

namespace malus {

void require_layout_of_model(const RawFrame& frame, const SensorLayout& model_layout) {
  if (frame.layout == model_layout) return;
  throw InputError(
      frame.source,
      fmt::format("has the layout {}, the noise model {}", frame.layout.name(),
                  model_layout.name()),
      "use this sensor's model, or declare the right layout (--layout, or a session's [sensor])");
}

}  // namespace malus
