// A camera for tests of the synthesizer: four channels that differ.
#pragma once

#include "malus/noise/model.h"

namespace malus::testing {

// Four channels at one gain, no spread unless asked.
inline NoiseModel bayer_model(double mu_spread = 0) {
  NoiseModel model;
  model.sensor = "test";
  model.layout = SensorLayout::named("bayer-rggb");
  model.black_dn = {64, 64, 64, 64};
  model.white_dn = 4095;
  model.row_group = 2;
  PhysicsCalibration p;
  p.gain.gain_db = 12;
  p.bias_frames = 10;
  p.K.mean = {0.9, 1.0, 1.1, 1.2};
  p.mu.mean = {-4, -5, -6, -7};
  p.mu.spread = std::vector<double>(4, mu_spread);
  p.sigma_row.mean = {0.5, 0.6, 0.7, 0.8};
  p.sigma_tl.mean = {1.0, 1.1, 1.2, 1.3};
  p.sigma_tl.spread = {0, 0, 0, 0};
  p.lambda.mean = {0.1, 0.1, 0.05, 0.0};
  model.physics = {p};
  return model;
}

inline const GainSetting kGain{.gain_db = 12.0, .iso = {}};

}  // namespace malus::testing
