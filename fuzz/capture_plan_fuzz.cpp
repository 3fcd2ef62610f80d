// links: malus_capture
#include "malus/capture/plan.h"

#include "memory_file.h"
#include "target.h"

void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  for (const malus::CaptureStep& step : malus::load_capture_plan(file.path()).steps)
    (void)step.folder();
}
