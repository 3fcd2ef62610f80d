// A raw frame as a camera of the generative law writes it (synthesize/exact.h), without rounding.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/physics.h"
#include "malus/synthesize/exact.h"

#include <cstdint>

namespace malus {

/// The levels of all channels.
struct TestLevels {
  float black_dn = 0;
  double white_dn = 4095;
};

/// Noise of equal channels, without rounding.
inline PhysicsNoise equal_channels(const char* layout, const PhysicsChannel& channel) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named(layout);
  noise.quantization_dn = 0;
  noise.channels.assign(static_cast<std::size_t>(noise.layout.channels()), channel);
  return noise;
}

inline RawFrame drawn_frame(const Image& clean, const PhysicsNoise& noise, TestLevels levels,
                            std::uint64_t seed) {
  RawFrame frame;
  frame.layout = noise.layout;
  frame.black_dn.assign(noise.channels.size(), levels.black_dn);
  frame.white_dn = levels.white_dn;
  frame.white_known = true;
  frame.source = "test";
  frame.dn = clean;
  add_noise_exact(noise, clean, frame.dn, DrawAddress{.seed = seed});
  for (float& v : frame.dn.values()) v += levels.black_dn;
  return frame;
}

}  // namespace malus
