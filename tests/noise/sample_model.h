// A noise model with every field filled, two channels wide, for the tests of files and look-ups.
#pragma once

#include "malus/noise/model.h"

#include <cmath>

namespace malus::testing {

inline GainSetting db(double gain_db) { return {gain_db, {}}; }
inline GainSetting iso(double value) { return {{}, value}; }

inline SquareMatrix matrix2(double a, double b, double d) {
  SquareMatrix m(2);
  m.values = {a, b, b, d};
  return m;
}

inline ChannelStatistics statistics2(double first, double second) {
  const double s1 = 0.1 * std::abs(first), s2 = 0.1 * std::abs(second);
  return {{first, second},
          {0.01 * first, 0.02 * second},
          {s1, s2},
          matrix2(s1 * s1, 0.5 * s1 * s2, s2 * s2),
          {{first, second}, {1.1 * first, 0.9 * second}, {0.9 * first, 1.1 * second}}};
}

inline PhysicsCalibration physics2(double gain_db) {
  const double K = 0.4 * std::pow(10.0, gain_db / 20.0);
  PhysicsCalibration p;
  p.gain.gain_db = gain_db;
  p.bias_frames = 100;
  p.flat_levels = 12;
  p.K = statistics2(K * 0.98, K * 1.02);
  p.K_intercept_dn2 = {0.1, 0.2};
  p.K_intercept_stderr_dn2 = {0.01, 0.02};
  p.line_intercept_dn2 = {0.1, 0.0};
  p.mu = statistics2(-0.5 * K, -0.6 * K);
  p.sigma_row = statistics2(0.2 * K, 0.25 * K);
  p.row_drift = {{0.2 + 0.01 * gain_db, 3.0}, 0.02, 0.4};
  p.sigma_tl = statistics2(1.3 * K, 1.4 * K);
  p.lambda = statistics2(0.1, 0.12);
  p.sigma_column = statistics2(0.02, 0.03);
  p.temporal_sd_dark_dn = {2.5 * K, 2.6 * K};
  p.temporal_sd_dark_stderr_dn = {0.01, 0.02};
  p.dark_point_dn2 = {4.2, 4.3};
  p.dark_point_stderr_dn2 = {0.1, 0.2};
  p.dsnu_dn = {0.3, 0.4};
  p.dsnu_stderr_dn = {0.01, 0.02};
  p.prnu = {0.01, 0.02};
  p.prnu_stderr = {0.0001, 0.0002};
  p.row_correlation = matrix2(1.0, 0.9, 1.0);
  p.transfer = {{0, 0.01, 100.0, 40.0, 1.0, true, ""},
                {1, 0.02, 3900.0, 40.0, 2.0, false, "above 70 % of saturation", true, true, 4.5}};
  p.dark_shading_dn = Image(130, 62, 0.25F);
  p.dark_shading_dn(3, 7) = -1.5F;
  p.prnu_map = Image(130, 62, 1.0F);
  p.residual_cell_dn = {0.1, 0.2};
  p.residual_counts = {{500, 300, 20}, {400, 350, 1}};
  p.warnings = {"lamp flickers by 1.2 DN", "µ drifts"};
  return p;
}

inline NoiseModel full_model() {
  NoiseModel m;
  m.sensor = "Prüfsensor";
  m.layout = SensorLayout::from_sites({{"0", "90"}});
  m.black_dn = {82.0, 81.5};
  m.white_dn = 4095;
  m.quantization_dn = 2;
  m.row_group = 2;
  m.row_group_origin = "detected";
  m.origin = "tests";
  m.saturation_limit = 0.65;
  m.warnings = {"the black level is not given", "nor is white"};
  for (double gain_db : {0.0, 6.0, 12.0}) m.physics.push_back(physics2(gain_db));
  m.joint = fit_joint_model(m.physics).value();
  m.joint->notes = {"a note"};
  m.gaussian = {
      {{6.0, {}}, 9, {0.8, 0.9}, {0.01, 0.02}, {2.0, 3.0}, {0.1, 0.2}, {-0.4, -0.5}, {"w"}}};
  NonparametricChannel channel;
  channel.level_dn = {0.0, 100.0};
  channel.samples = {200000, 250000};
  channel.bin_edges_dn = {-2.0, 0.0, 1.0, 3.0};
  channel.pmf = {{0.25, 0.5, 0.25}, {0.5, 0.25, 0.25}};
  m.nonparametric = {{{6.0, {}},
                      40,
                      {channel, channel},
                      {0.3, 0.4},
                      {0.01, 0.02},
                      {{0.3, 5.0}, 0.02, 0.5},
                      {0.8, 0.81},
                      {"few samples"}}};
  m.dark_frames = {{{6.0, {}}, {Image(4, 6, 1.0F), Image(4, 6, -2.0F)}}};
  m.defects = {{5, 6, "hot", 12.5}, {7, 8, "dead", -9.0}};
  return m;
}

}  // namespace malus::testing
