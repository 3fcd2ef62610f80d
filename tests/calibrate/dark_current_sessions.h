// Sessions with dark current that differs from pixel to pixel.
#pragma once

#include "malus/calibrate/calibrate.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>

#include "simulated_session.h"

namespace malus::testing {

inline constexpr double kGainOfResponse = 0.5;  // DN/e-

// A camera with dark current, electrons per second and pixel; 128 x 128 pixels.
struct DarkCurrent {
  double mean = 40, deviation = 12;
  int hot = 0;  ///< pixels of hot_rate and more
  double hot_rate = 0;
  double gain_dn_per_e = kGainOfResponse;
  double at(std::uint64_t pixel) const {
    const double rate = std::max(mean + deviation * internal::normal_at(9, pixel, 3), 0.0);
    return pixel % 163 == 0 && pixel / 163 < static_cast<std::uint64_t>(hot)
               ? rate + hot_rate * (1.0 + 0.01 * static_cast<double>(pixel % 97))
               : rate;
  }
};

inline SimulatedCamera dark_current_camera(double prnu) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 30;
  camera.flat_levels = 8;
  camera.prnu = prnu;
  camera.gains.push_back(polar_gain(0, "mono", 1));
  camera.gains[0].noise.channels[0] = {
      .gain_dn_per_e = kGainOfResponse, .lambda = 0.14, .sigma_tl_dn = 1.36, .sigma_row_dn = 0.2};
  return camera;
}

// Dark current of this exposure, with its shot noise. address: no other frame's.
inline void add_dark_current(const DarkCurrent& current, double exposure_s, std::uint32_t address,
                             RawFrame& frame) {
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const auto pixel = static_cast<std::uint64_t>(r * frame.dn.cols() + c);
      const double electrons = current.at(pixel) * exposure_s;
      const double drawn =
          electrons + std::sqrt(electrons) * internal::normal_at(address, pixel, 4);
      frame.dn(r, c) = static_cast<float>(std::clamp(
          std::round(frame.dn(r, c) + current.gain_dn_per_e * drawn), 0.0, double{frame.white_dn}));
    }
}

// Flats of 0.8 s and more, a second for every tenth of the range; dark sets of the same exposures
// where they have frames.
inline CalibrationInput dark_current_session(const SimulatedCamera& camera,
                                             const DarkCurrent& current, int dark_frames) {
  CalibrationInput input = simulated_session(camera);
  std::vector<FrameSet> darks;
  std::uint32_t address = 1;
  for (FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kFlat) continue;
    const double exposure_s = 0.8 * (*set.level + 1);
    set.exposure_s = exposure_s;
    change_frames(set, [=](RawFrame& frame, int i) {
      add_dark_current(current, exposure_s, 1000 * address + static_cast<std::uint32_t>(i), frame);
    });
    FrameSet dark = set;
    dark.kind = FrameKind::kBias;
    dark.level.reset();
    dark.count = dark_frames;
    const auto shared = std::make_shared<const SimulatedCamera>(camera);
    dark.load = [=](int i) {
      const std::uint32_t own = 1000 * address + 500 + static_cast<std::uint32_t>(i);
      RawFrame frame = internal::simulated_frame(*shared, shared->gains[0], 0, own);
      add_dark_current(current, exposure_s, own, frame);
      return frame;
    };
    if (dark_frames > 0) darks.push_back(std::move(dark));
    ++address;
  }
  input.sets.insert(input.sets.end(), darks.begin(), darks.end());
  return input;
}

inline PhysicsCalibration measured(const CalibrationInput& input) {
  return calibrate_physics(input, {}, silent_progress()).physics.at(0);
}

}  // namespace malus::testing
