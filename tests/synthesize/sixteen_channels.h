// The noise that the tests of every twin of the compiled sampler draw: sixteen channels, no two
// alike; and noise of one channel.
#pragma once

#include "malus/noise/physics.h"

namespace malus::testing {

inline PhysicsNoise sixteen_channels() {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("polar-bayer-rggb");
  for (int c = 0; c < 16; ++c)
    noise.channels.push_back({.gain_dn_per_e = 0.4 + 0.05 * c,
                              .lambda = -0.2 + 0.03 * c,
                              .mu_dn = -2.0 + 0.1 * c,
                              .sigma_tl_dn = 0.8 + 0.05 * c,
                              .sigma_row_dn = 0.2 + 0.02 * c});
  noise.row_group = 2;
  noise.row_drift = {0.4, 3.0};
  return noise;
}

inline PhysicsNoise mono_noise(const PhysicsChannel& channel) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("mono");
  noise.channels = {channel};
  return noise;
}

}  // namespace malus::testing
