// A camera whose truth is known, drawn by the sampler's plain definition.
#pragma once

#include "malus/base/random.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/frame_set.h"
#include "malus/noise/tukey_lambda.h"
#include "malus/synthesize/exact.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <vector>

namespace malus::testing {

/// Truth at one gain; the layout, row group and channels' parameters are in `noise`.
struct SimulatedGain {
  GainSetting gain;
  PhysicsNoise noise;
  std::vector<double> mu_spread_dn, sigma_row_spread_dn, sigma_tl_spread_dn;  ///< frame to frame
};

struct SimulatedCamera {
  int rows = 64, cols = 64;
  double black_dn = 80, white_dn = 4095;
  double dsnu_dn = 0.4, prnu = 0.01;
  double flicker = 0.003;  ///< relative sd of the lamp from frame to frame
  double shading = 0.2;    ///< relative fall of light towards the corners
  int bias_frames = 100, flat_levels = 12, flat_frames = 2;
  bool rounded = true;
  bool levels_known = true;  ///< black and white are given, not guessed
  std::uint64_t seed = 0;
  std::vector<SimulatedGain> gains;
};

/// A colour-polarization sensor as in 000: row group 2, channels that differ by some per cent,
/// bias that falls with gain, noise in DN that rises with it.
inline SimulatedGain polar_gain(double gain_db, const char* layout = "polar-bayer-rggb",
                                int row_group = 2) {
  SimulatedGain out;
  out.gain.gain_db = gain_db;
  out.noise.layout = SensorLayout::named(layout);
  out.noise.row_group = row_group;
  out.noise.quantization_dn = 0;  // rounding to integers is the quantisation
  const double amplification = std::pow(10.0, gain_db / 20.0);
  for (int c = 0; c < out.noise.layout.channels(); ++c) {
    PhysicsChannel channel;
    const double vary = std::sin(1.7 * c);
    channel.gain_dn_per_e = 0.36 * amplification * (1 + 0.03 * vary);
    channel.lambda = 0.05 + 0.05 * std::cos(2.3 * c);
    channel.sigma_tl_dn = (0.15 + 0.42 * amplification) * (1 + 0.05 * vary);
    channel.sigma_row_dn = (0.03 + 0.14 * amplification) * (1 + 0.1 * vary);
    channel.mu_dn = -(0.4 + 0.25 * amplification) * (1 + 0.1 * vary);
    out.noise.channels.push_back(channel);
  }
  return out;
}

/// A ramp whose every row holds dark and bright pixels, from 0 to brightest_dn above a black level
/// of 100, one channel.
inline RawFrame ramp_frame(const PhysicsNoise& noise, double brightest_dn, int size,
                           const DrawAddress& address, bool rounded) {
  RawFrame out;
  out.black_dn = {100};
  out.white_dn = 4095;
  out.dn = Image(size, size);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c)
      out.dn(r, c) = static_cast<float>(brightest_dn * (0.3 * r + 0.7 * c) / size);
  add_noise_exact(noise, out.dn, out.dn, address);
  for (float& v : out.dn.values()) v = rounded ? std::round(v + 100) : v + 100;
  return out;
}

namespace internal {

inline double normal_at(std::uint64_t seed, std::uint64_t index, std::uint32_t stream) {
  const PhiloxBlock block = random_block(seed, stream, index, Draw::kScene);
  return normal_quantile(uniform_open(block.word[0], block.word[1]));
}

// level < 0: dark. frame numbers are unique over the session.
inline RawFrame simulated_frame(const SimulatedCamera& camera, const SimulatedGain& gain,
                                double level_dn, std::uint32_t frame) {
  RawFrame out;
  out.layout = gain.noise.layout;
  out.black_dn.assign(gain.noise.channels.size(), camera.black_dn);
  out.white_dn = camera.white_dn;
  out.black_known = out.white_known = camera.levels_known;
  out.gain = gain.gain;
  out.dn = Image(camera.rows, camera.cols);
  PhysicsNoise noise = gain.noise;
  RandomSequence random(camera.seed, frame, Draw::kParameters);
  const auto vary = [&](double& value, const std::vector<double>& spread, std::size_t c) {
    if (!spread.empty()) value += spread[c] * random.normal();
  };
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    vary(noise.channels[c].mu_dn, gain.mu_spread_dn, c);
    vary(noise.channels[c].sigma_row_dn, gain.sigma_row_spread_dn, c);
    vary(noise.channels[c].sigma_tl_dn, gain.sigma_tl_spread_dn, c);
  }
  const double lamp = level_dn * (1 + camera.flicker * random.normal());
  for (int r = 0; r < camera.rows; ++r)
    for (int c = 0; c < camera.cols; ++c) {
      const auto index = static_cast<std::uint64_t>(r) << 32 | static_cast<std::uint64_t>(c);
      const double y = 2.0 * r / camera.rows - 1, x = 2.0 * c / camera.cols - 1;
      const double light = lamp * (1 - camera.shading * 0.5 * (x * x + y * y)) *
                           (1 + camera.prnu * normal_at(camera.seed, index, 1)) *
                           (1 - 0.02 * out.layout.channel_at(r, c));
      out.dn(r, c) = static_cast<float>(std::max(light, 0.0));
    }
  add_noise_exact(noise, out.dn, out.dn, DrawAddress{camera.seed, frame, 0, 0});
  for (int r = 0; r < camera.rows; ++r)
    for (int c = 0; c < camera.cols; ++c) {
      const auto index = static_cast<std::uint64_t>(r) << 32 | static_cast<std::uint64_t>(c);
      double value =
          out.dn(r, c) + camera.black_dn + camera.dsnu_dn * normal_at(camera.seed, index, 2);
      if (camera.rounded) value = std::clamp(std::round(value), 0.0, camera.white_dn);
      out.dn(r, c) = static_cast<float>(value);
    }
  out.source = "simulated";
  return out;
}

}  // namespace internal

/// The session of a camera: one bias set and flat_levels flat sets per gain, the brightest flat at
/// 80 % of the range. Frames are drawn when they are asked for.
inline CalibrationInput simulated_session(const SimulatedCamera& camera_) {
  const auto camera = std::make_shared<const SimulatedCamera>(camera_);
  CalibrationInput input;
  input.sensor = "simulated";
  input.origin = "simulation";
  std::uint32_t frame = 0;
  for (std::size_t g = 0; g < camera->gains.size(); ++g) {
    const auto add = [&](FrameKind kind, double level_dn, int count, int level) {
      FrameSet set;
      set.kind = kind;
      set.gain = camera->gains[g].gain;
      if (kind == FrameKind::kFlat) set.level = level;
      set.count = count;
      set.name = "simulated";
      set.load = [camera, g, level_dn, base = frame](int i) {
        return internal::simulated_frame(*camera, camera->gains[g], level_dn,
                                         base + static_cast<std::uint32_t>(i));
      };
      frame += static_cast<std::uint32_t>(count);
      input.sets.push_back(std::move(set));
    };
    add(FrameKind::kBias, 0.0, camera->bias_frames, 0);
    const double range = camera->white_dn - camera->black_dn;
    for (int level = 0; level < camera->flat_levels; ++level)
      add(FrameKind::kFlat, 0.8 * range * (level + 1) / camera->flat_levels, camera->flat_frames,
          level);
  }
  return input;
}

/// What a test does to a loaded frame of a number.
using FrameChange = std::function<void(RawFrame&, int)>;

inline void change_frames(FrameSet& set, const FrameChange& change) {
  set.load = [load = set.load, change](int i) {
    RawFrame frame = load(i);
    change(frame, i);
    return frame;
  };
}

inline void change_frames(CalibrationInput& input, const FrameChange& change) {
  for (FrameSet& set : input.sets) change_frames(set, change);
}

/// A camera of one gain, 12 dB.
inline SimulatedCamera small_camera(std::uint64_t seed = 0) {
  SimulatedCamera camera;
  camera.seed = seed;
  camera.gains.push_back(polar_gain(12));
  return camera;
}

/// A mono polarization camera of one gain, 40 bias frames and 8 flats a level.
inline SimulatedCamera polar_mono_camera() {
  SimulatedCamera camera;
  camera.rows = camera.cols = 128;
  camera.bias_frames = 40;
  camera.flat_frames = 8;
  camera.gains.push_back(polar_gain(12, "polar-mono", 1));
  return camera;
}

/// A mono camera of one gain and 20 bias frames, without bias; read_dn: deviation of its read
/// noise.
inline SimulatedCamera mono_camera(double gain_dn_per_e, double lambda, double read_dn,
                                   double row_dn, std::uint64_t seed) {
  SimulatedCamera camera;
  camera.gains = {polar_gain(0, "mono", 1)};
  PhysicsChannel& channel = camera.gains[0].noise.channels[0];
  channel.gain_dn_per_e = gain_dn_per_e;
  channel.lambda = lambda;
  channel.sigma_tl_dn = read_dn / std::sqrt(tukey_lambda_variance(lambda));
  channel.sigma_row_dn = row_dn;
  channel.mu_dn = 0;
  camera.bias_frames = 20;
  camera.seed = seed;
  return camera;
}

/// Normal values of mean 0.
inline Image white_noise(int rows, int cols, std::uint64_t seed, std::uint32_t frame, double sd) {
  Image out(rows, cols);
  RandomSequence random(seed, frame, Draw::kScene);
  for (float& v : out.values()) v = static_cast<float>(sd * random.normal());
  return out;
}

inline NoiseModel calibrated(const SimulatedCamera& camera,
                             const CalibrationSettings& settings = {}) {
  return calibrate_physics(simulated_session(camera), settings, silent_progress());
}

}  // namespace malus::testing
