// links: malus_neural
#include "malus/neural/noise_flow_file.h"

#include "memory_file.h"
#include "target.h"

// Replayed by the tests; libFuzzer wants a clang that compiles libtorch's headers, which 14 does
// not. What a file that is accepted says of its sensor is good enough to draw a cell at its gains.
void parse_bytes(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  const malus::NoiseFlowModel model(file.path());
  const malus::SensorLayout cell = model.layout();
  const malus::Image dark(cell.rows(), cell.cols());
  for (const malus::GainSetting& gain : model.sensor().trained_gains())
    (void)model.draw_as_recorded(dark.view(), gain, {});
}
