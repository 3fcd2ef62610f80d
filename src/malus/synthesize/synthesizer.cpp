#include "malus/synthesize/synthesizer.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/synthesize/level_sampler.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

// Index of RandomSequence(kParameters) that chooses a dark frame; the noise module uses 0 to 3.
constexpr std::uint64_t kStreamDarkFrame = 16;
constexpr std::ptrdiff_t kRowsPerPiece = 16;

void scale(View<float> image, float factor) {
  parallel_for(0, image.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (float& v : image.row_span(r)) v *= factor;
  });
}

void shift(View<float> image, float offset) {
  parallel_for(0, image.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (float& v : image.row_span(r)) v += offset;
  });
}

double mean_bias(const PhysicsNoise& noise) {
  double sum = 0;
  for (const PhysicsChannel& channel : noise.channels) sum += channel.mu_dn;
  return sum / static_cast<double>(noise.channels.size());
}

// The frame's bias frame, laid over the picture so that pixels meet their own place on the sensor;
// banks smaller than the picture repeat.
void add_dark_frame(const DarkFrameBank& bank, const DrawAddress& address, View<float> dn) {
  RandomSequence random(address.seed, address.frame, Draw::kParameters, kStreamDarkFrame);
  const auto number =
      static_cast<std::size_t>(random.uniform() * static_cast<double>(bank.frames_dn.size()));
  const Image& dark = bank.frames_dn[number];
  for (int r = 0; r < dn.rows(); ++r) {
    const float* row = dark.row((address.row0 + r) % dark.rows());
    for (int c = 0; c < dn.cols(); ++c) dn(r, c) += row[(address.col0 + c) % dark.cols()];
  }
}

CompiledNoise compile_gaussian(const NoiseModel& model, const GaussianCalibration& calibration,
                               const SynthesisSettings& settings, double& global_bias_dn) {
  std::vector<GaussianChannel> channels;
  for (std::size_t c = 0; c < calibration.slope_dn.size(); ++c) {
    const double bias =
        settings.bias && !calibration.bias_dn.empty() ? calibration.bias_dn[c] : 0.0;
    channels.push_back({.slope_dn = settings.shot ? calibration.slope_dn[c] : 0.0,
                        .offset_dn2 = settings.read ? calibration.offset_dn2[c] : 0.0,
                        .mu_dn = bias});
    global_bias_dn += bias / static_cast<double>(calibration.slope_dn.size());
  }
  return CompiledNoise::gaussian(model.layout, channels, model.row_group);
}

}  // namespace

Synthesizer::Synthesizer(NoiseModel model, SynthesisSettings settings)
    : model_(std::move(model)), settings_(std::move(settings)) {
  const bool physics = settings_.kind == "physics" || settings_.kind == "poisson-gaussian";
  const std::string needed = physics ? "physics" : settings_.kind;
  const auto kinds = model_.kinds();
  if (std::find(kinds.begin(), kinds.end(), needed) == kinds.end())
    throw InputError(model_.sensor.empty() ? "noise model" : model_.sensor,
                     fmt::format("holds no {} model", needed),
                     fmt::format("calibrate with --kind {}, or give another --kind", needed));
  if (settings_.exact && settings_.kind != "physics")
    throw InputError("--exact", fmt::format("is not defined for --kind {}", settings_.kind),
                     "use it with --kind physics");
}

PhysicsNoise Synthesizer::physics(const GainSetting& gain, const DrawAddress& address) const {
  const GainRange range =
      settings_.extrapolate_gain ? GainRange::kAllowExtrapolation : GainRange::kCalibratedOnly;
  PhysicsNoise noise = settings_.parameters == "sampled"
                           ? model_.sample_physics_at(gain, address.seed, address.frame, range)
                           : model_.physics_at(gain, range);
  noise.parts = {.shot = settings_.shot,
                 .read = settings_.read,
                 .row = settings_.row,
                 .quantization = settings_.quantization,
                 .bias = settings_.bias};
  return noise;
}

SyntheticFrame Synthesizer::noisy(View<const float> clean_dn,
                                  const std::optional<GainSetting>& gain,
                                  const DrawAddress& address, bool rounded_later) const {
  SyntheticFrame frame;
  frame.gain = gain ? *gain : model_.random_gain(address.seed, address.frame);
  frame.dn = Image(clean_dn.rows(), clean_dn.cols());
  for (int r = 0; r < clean_dn.rows(); ++r)
    std::copy_n(clean_dn.row(r), clean_dn.cols(), frame.dn.row(r));
  if (settings_.ratio != 1) scale(frame.dn, static_cast<float>(1.0 / settings_.ratio));

  if (settings_.kind == "gaussian") {
    double bias = 0;
    compile_gaussian(model_, model_.gaussian_at(frame.gain), settings_, bias)
        .apply(frame.dn.view(), frame.dn.view(), address);
    frame.global_bias_dn = bias;
    return frame;
  }
  if (settings_.kind == "nonparametric") {
    const LevelSampler sampler(model_.layout, model_.nonparametric_at(frame.gain),
                               settings_.row ? model_.row_group : 0);
    sampler.apply(frame.dn.view(), frame.dn.view(), address);
    return frame;
  }
  frame.physics = physics(frame.gain, address);
  if (settings_.kind == "dark-frames") {
    frame.physics.parts = {
        .shot = settings_.shot, .read = false, .row = false, .quantization = false, .bias = false};
    CompiledNoise(frame.physics).apply(frame.dn.view(), frame.dn.view(), address);
    add_dark_frame(model_.dark_frames_at(frame.gain), address, frame.dn);
  } else {
    if (rounded_later) frame.physics.parts.quantization = false;
    if (settings_.kind == "poisson-gaussian")
      CompiledNoise::poisson_gaussian(frame.physics)
          .apply(frame.dn.view(), frame.dn.view(), address);
    else if (settings_.exact)
      add_noise_exact(frame.physics, frame.dn.view(), frame.dn.view(), address);
    else
      CompiledNoise(frame.physics).apply(frame.dn.view(), frame.dn.view(), address);
  }
  // The mean frame's bias, not this frame's: what is left varies as it does on real frames.
  if (settings_.bias)
    frame.global_bias_dn = mean_bias(
        model_.physics_at(frame.gain, settings_.extrapolate_gain ? GainRange::kAllowExtrapolation
                                                                 : GainRange::kCalibratedOnly));
  return frame;
}

SyntheticFrame Synthesizer::draw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                                 const DrawAddress& address) const {
  SyntheticFrame frame = noisy(clean_dn, gain, address, false);
  if (settings_.debias) shift(frame.dn, static_cast<float>(-frame.global_bias_dn));
  if (!settings_.debias) frame.global_bias_dn = 0;
  if (settings_.amplify) scale(frame.dn, static_cast<float>(settings_.ratio));
  return frame;
}

RawFrame Synthesizer::draw_raw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                               const DrawAddress& address, const std::vector<double>& black_dn,
                               double white_dn) const {
  MALUS_REQUIRE(static_cast<int>(black_dn.size()) == model_.layout.channels());
  SyntheticFrame noise = noisy(clean_dn, gain, address, true);
  CameraOutput camera{black_dn, white_dn,
                      model_.quantization_dn > 0 ? model_.quantization_dn : 1.0};
  round_as_camera(noise.dn, model_.layout, camera, address.row0, address.col0);
  RawFrame raw;
  raw.layout = model_.layout;
  raw.black_dn = black_dn;
  raw.white_dn = white_dn;
  raw.gain = noise.gain;
  raw.black_known = raw.white_known = raw.layout_known = true;
  if (settings_.debias || settings_.amplify) {
    const auto factor = settings_.amplify ? settings_.ratio : 1.0;
    const double bias = settings_.debias ? noise.global_bias_dn : 0.0;
    const double black_mean = std::accumulate(black_dn.begin(), black_dn.end(), 0.0) /
                              static_cast<double>(black_dn.size());
    raw.white_dn = std::min(65535.0, std::ceil(black_mean + factor * (white_dn - black_mean)));
    camera.white_dn = 65535.0;
    camera.step_dn = 1.0;
    for (int r = 0; r < noise.dn.rows(); ++r)
      for (int c = 0; c < noise.dn.cols(); ++c) {
        const double black = black_dn[static_cast<std::size_t>(
            model_.layout.channel_at(address.row0 + r, address.col0 + c))];
        noise.dn(r, c) =
            static_cast<float>(factor * (static_cast<double>(noise.dn(r, c)) - black - bias));
      }
    round_as_camera(noise.dn, model_.layout, camera, address.row0, address.col0);
  }
  raw.dn = std::move(noise.dn);
  raw.bits = 16;
  return raw;
}

void round_as_camera(View<float> dn, const SensorLayout& layout, const CameraOutput& camera,
                     int row0, int col0) {
  const auto step = static_cast<float>(camera.step_dn), white = static_cast<float>(camera.white_dn);
  parallel_for(0, dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (int c = 0; c < dn.cols(); ++c) {
        const auto channel = static_cast<std::size_t>(layout.channel_at(row0 + r, col0 + c));
        const float raw = dn(r, c) + static_cast<float>(camera.black_dn[channel]);
        const float rounded = std::nearbyint(raw / step) * step;
        dn(r, c) = rounded > 0.0f ? std::min(rounded, white) : 0.0f;  // NaN fails the comparison
      }
  });
}

}  // namespace malus
