// A scene that is filtered as a whole and in tiles.
#pragma once

#include "malus/base/parallel.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cmath>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "denoise/drawn_frame.h"

namespace malus {

inline PhysicsNoise camera_noise(const SensorLayout& layout) {
  PhysicsNoise noise;
  noise.layout = layout;
  noise.row_group = 2;
  noise.quantization_dn = 0;
  noise.channels.assign(static_cast<std::size_t>(layout.channels()),
                        PhysicsChannel{1.5, 0.1, -0.4, 1.8, 0.6});
  return noise;
}

/// Polarized blobs and an edge, 20 to 300 DN. The edge bends: a straight one repeats along itself,
/// and tiles of what repeats need more of their surroundings.
inline Image polarized_blobs(int rows, int cols) {
  Image dn(rows, cols);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const double smooth = 120 + 80 * std::sin(r * 0.03) * std::cos(c * 0.04);
      const double edge = 4.0 * r * c > rows * cols ? 60 : 0;
      const double polarization = 1 + 0.2 * ((r + c) % 2 ? 1 : -1) * std::cos(0.02 * c);
      dn(r, c) = static_cast<float>((smooth + edge) * polarization);
    }
  return dn;
}

/// The least memory, which the caller holds all but this much of.
inline void leave_memory(double mib, DenoiseSettings& settings) {
  settings.memory_mib = 128;
  settings.held_values = 0.92 * (settings.memory_mib - mib) * 0x1p20 / 4;
}

/// What was said, and how many tiles were done by then.
class WarningsAndTiles final : public Progress {
 public:
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t steps) override { tiles += steps; }
  void warn(std::string_view message) override {
    warnings.emplace_back(message);
    tiles_before_warning = tiles;
  }
  bool stop_requested() const override { return false; }

  std::vector<std::string> warnings;
  std::int64_t tiles = 0, tiles_before_warning = -1;
};

}  // namespace malus
