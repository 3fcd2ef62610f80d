// What the noise of a Noise Flow is, measured on frames that it draws.
#include "malus/image/pack.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/noise/calibration.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace malus {
namespace {

Image uniform_light(const SensorLayout& cell, double signal_dn) {
  constexpr int kSide = 128;
  static_assert(kSide * kSide == NoiseFlowModel::kProfileSamples);
  Image light(kSide * cell.rows(), kSide * cell.cols());
  std::fill(light.values().begin(), light.values().end(), static_cast<float>(signal_dn));
  return light;
}

// Of what planes of uniform light show beyond it.
std::vector<LevelMoments> moments_of(const Planes& planes, double signal_dn) {
  std::vector<LevelMoments> moments;
  for (const Image& plane : planes) {
    double sum = 0, square = 0;
    for (const float value : plane.values()) {
      const double noise = static_cast<double>(value) - signal_dn;
      sum += noise;
      square += noise * noise;
    }
    const auto n = static_cast<double>(plane.size());
    moments.push_back({sum / n, (square - sum * sum / n) / (n - 1)});
  }
  return moments;
}

}  // namespace

NoiseProfile NoiseFlowModel::measured_profile(const GainSetting& gain) const {
  const SensorLayout cell = layout();
  const auto channels = static_cast<std::size_t>(cell.channels());
  std::vector<double> signals_dn;  // closer together in the dark
  for (int i = 0; i < kProfileLevels; ++i)
    signals_dn.push_back(scale_dn() * std::pow(i / (kProfileLevels - 1.0), 2));
  std::vector<std::vector<LevelMoments>> measured;  // [level][channel]
  for (const double signal_dn : signals_dn) {
    const DrawAddress address{.frame = static_cast<std::uint32_t>(measured.size())};
    measured.push_back(
        moments_of(pack(draw(uniform_light(cell, signal_dn), gain, address), cell), signal_dn));
  }
  NoiseProfile profile;
  profile.layout = cell;
  profile.step_dn = sensor().spread_dn;
  for (std::size_t c = 0; c < channels; ++c) {
    std::vector<double> variance;
    for (const auto& level : measured) variance.push_back(level[c].variance_dn2);
    profile.channels.push_back({.variance = VarianceCurve::table(signals_dn, variance),
                                .bias_dn = measured.front()[c].mean_dn});
  }
  return profile;
}

}  // namespace malus
