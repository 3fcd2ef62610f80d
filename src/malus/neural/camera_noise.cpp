#include "malus/neural/internal/camera_noise.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/profile_parts.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

void multiply(std::vector<double>& values, double factor) {
  for (double& value : values) value *= factor;
}

void multiply(ChannelStatistics& statistics, double factor) {
  multiply(statistics.mean, factor);
  multiply(statistics.spread, factor);
  multiply(statistics.covariance.values, factor * factor);
}

// Pieces of light are whole cells of the package, so that a sensor's cells must begin with them.
void require_layout(const fs::path& path, const SensorLayout& layout, const NetworkPackage& package,
                    bool or_grey = false) {
  if (layout == package.layout()) return;
  if (!or_grey || package.settings.phase_of(layout) != CellPhase{})
    throw InputError(path.string(),
                     fmt::format("is of a sensor with the layout {}, the package of {}",
                                 layout.name(), package.settings.layout),
                     or_grey
                         ? "name a model of the package's layout, or of that without its colours"
                         : "name a model of the package's layout");
}

class CalibratedNoise final : public CameraNoise {
 public:
  CalibratedNoise(const fs::path& path, const NetworkPackage& package,
                  const CameraNoiseOptions& options)
      : path_(path), package_(package), settings_(options.settings), jitter_(options.jitter) {
    NoiseModel model = load_model(path);
    require_layout(path, model.layout, package, options.or_grey);
    drop_maps(model);  // large, and drawn noise has none of them
    model_ = std::make_shared<const NoiseModel>(std::move(model));
  }

  const NoiseModel& camera() const override { return *model_; }
  GainSetting setting_of(double gain) const override { return model_->setting_of(gain); }
  void require_drawable() const override {
    if (jitter_ > 0 &&
        (model_->physics.empty() || synthesis_kind(settings_.kind) != SynthesisKind::kPhysics))
      throw InputError(path_.string(), "cannot be varied: jitter is for kind \"physics\"",
                       "use jitter = 0");
    require_kind_here();
    const Synthesizer of_this_kind(model_, settings_);
    require_noise_level(parts(), model_->quantization_dn, package_, path_.string());
  }
  GainSetting random_gain(std::uint64_t seed, std::uint32_t number) const override {
    return malus::random_gain(*model_, settings_, seed, number);
  }
  void require_gain(const GainSetting& gain) const override {
    Synthesizer(model_, settings_).require_gain(gain);
    profile_at(gain, parts());
  }
  NoiseProfile profile_at(const GainSetting& gain, const PhysicsParts& given) const override {
    return profile_of_parts(*model_, gain, gain_range(settings_.extrapolate_gain), given);
  }

  Drawn draw(View<const float> clean_dn, const GainSetting& gain, double ratio, std::uint64_t seed,
             std::uint32_t number) const override {
    const std::shared_ptr<const NoiseModel> sensor =
        jitter_ > 0
            ? std::make_shared<const NoiseModel>(jittered_sensor(
                  *model_, gain, jitter_, seed, number, gain_range(settings_.extrapolate_gain)))
            : model_;
    SynthesisSettings settings = settings_;
    settings.ratio = ratio;
    const Synthesizer synthesizer(sensor, settings);
    return {
        synthesizer.draw_raw(clean_dn, gain,
                             synthesizer.somewhere(clean_dn.rows(), clean_dn.cols(), seed, number),
                             sensor->black_dn, sensor->white_dn),
        profile_of_parts(*sensor, gain, gain_range(settings_.extrapolate_gain), parts())};
  }

  std::string complaint(const std::vector<GainSetting>& gains) const override {
    const std::string line = untold_gain_complaint(*model_, gains);
    return line.empty() ? line : path_.string() + ": " + line;
  }

 private:
  // The Synthesizer names a flag, which a configuration has none of.
  void require_kind_here() const {
    const ModelKind needed = drawn_from(synthesis_kind(settings_.kind));
    if (!std::ranges::count(model_->kinds(), needed))
      throw InputError("kind in [noise]",
                       fmt::format("is \"{}\", and {} holds no {} model", settings_.kind,
                                   path_.string(), model_kind_name(needed)),
                       "set a kind that it holds, or name another model");
  }

  // As drawn: raw frames are rounded whatever the setting says.
  PhysicsParts parts() const {
    return {.shot = settings_.shot,
            .read = settings_.read,
            .row = settings_.row,
            .quantization = true,
            .bias = settings_.bias};
  }

  fs::path path_;
  NetworkPackage package_;
  SynthesisSettings settings_;
  double jitter_;
  std::shared_ptr<const NoiseModel> model_;
};

// The parts of a calibrated model, which these settings change, are not told apart by a flow. The
// kind is that of the calibrated models beside it.
void refuse_settings_of_parts(const fs::path& path, const CameraNoiseOptions& options) {
  SynthesisSettings plain;
  if (!options.only_flows) plain.kind = options.settings.kind;
  SynthesisSettings given = options.settings;
  given.ratio = plain.ratio;
  std::string changed;
  SynthesisSettings::describe(plain, [&](const auto& usual, const ParameterInfo& info) {
    SynthesisSettings::describe(given, [&](const auto& value, const ParameterInfo& same) {
      if constexpr (std::is_same_v<decltype(usual), decltype(value)>)
        if (info.name == same.name && usual != value && changed.empty()) changed = info.name;
    });
  });
  if (options.jitter > 0) changed = "jitter";
  if (!changed.empty())
    throw InputError(
        path.string(),
        fmt::format("is a Noise Flow, to whose noise {} in [noise] means nothing", changed),
        fmt::format("leave {} out, or name a calibrated model", changed));
}

NoiseModel flow_camera(const NoiseFlowModel& flow) {
  const NoiseFlowSensor& sensor = flow.sensor();
  NoiseModel camera;
  camera.sensor = flow.camera_name();
  camera.layout = SensorLayout::named(sensor.layout);
  camera.black_dn = sensor.black_dn;
  camera.white_dn = sensor.white_dn;
  camera.quantization_dn = sensor.spread_dn;
  return camera;
}

class FlowNoise final : public CameraNoise {
 public:
  FlowNoise(const fs::path& path, const NetworkPackage& package, const CameraNoiseOptions& options)
      : path_(path),
        options_(options),
        flow_(path),
        camera_(flow_camera(flow_)),
        gains_(flow_.sensor().trained_gains()) {
    require_layout(path, camera_.layout, package, options.or_grey);
  }
  void require_drawable() const override { refuse_settings_of_parts(path_, options_); }

  const NoiseModel& camera() const override { return camera_; }
  GainSetting setting_of(double gain) const override { return flow_.sensor().setting_of(gain); }
  GainSetting random_gain(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kParameters, kStreamFlowGain);
    return gains_[pick(random, gains_.size())];
  }
  void require_gain(const GainSetting& gain) const override { flow_.sensor().require_gain(gain); }
  NoiseProfile profile_at(const GainSetting& gain, const PhysicsParts&) const override {
    return flow_.profile_at(gain);
  }

  Drawn draw(View<const float> clean_dn, const GainSetting& gain, double ratio, std::uint64_t seed,
             std::uint32_t number) const override {
    Image light(clean_dn.rows(), clean_dn.cols());
    for (int r = 0; r < light.rows(); ++r)
      for (int c = 0; c < light.cols(); ++c)
        light(r, c) = static_cast<float>(static_cast<double>(clean_dn(r, c)) / ratio);
    return {flow_.draw_as_recorded(light, gain, {.seed = seed, .frame = number}),
            flow_.profile_at(gain)};
  }

  std::string complaint(const std::vector<GainSetting>&) const override { return {}; }

 private:
  fs::path path_;
  CameraNoiseOptions options_;
  NoiseFlowModel flow_;
  NoiseModel camera_;
  std::vector<GainSetting> gains_;
};

}  // namespace

void require_noise_level(const PhysicsParts& parts, double step_dn, const NetworkPackage& package,
                         const std::string& source) {
  const PackageSettings& wants = package.settings;
  if (parts.shot || parts.read || (parts.quantization && step_dn > 0)) return;
  if (wants.domain != "stabilised" && wants.noise_input == "none" && wants.guide == "none" &&
      !(wants.row_noise && parts.row))
    return;
  throw InputError(source, "has shot and read noise switched off, and the package wants a level",
                   "leave one of them on, or set domain = \"linear\", noise_input = \"none\", "
                   "guide = \"none\" and row_noise = false in [package]");
}

std::unique_ptr<const CameraNoise> open_camera(const fs::path& path, const NetworkPackage& package,
                                               const CameraNoiseOptions& options) {
  if (names_noise_flow(path)) return std::make_unique<FlowNoise>(path, package, options);
  return std::make_unique<CalibratedNoise>(path, package, options);
}

NoiseModel camera_of(const fs::path& path) {
  return names_noise_flow(path) ? flow_camera(NoiseFlowModel(path)) : load_model(path);
}

NoiseModel load_camera(const fs::path& path, const NetworkPackage& package,
                       const std::string& use) {
  if (names_noise_flow(path))
    throw InputError(path.string(),
                     fmt::format("is a Noise Flow, and {} want a calibrated noise model", use),
                     "name the calibrated model of their camera");
  NoiseModel model = load_model(path);
  require_layout(path, model.layout, package);
  return model;
}

NoiseModel jittered_sensor(const NoiseModel& model, const GainSetting& gain, double jitter,
                           std::uint64_t seed, std::uint32_t number, GainRange range) {
  RandomSequence random(seed, number, Draw::kParameters, kStreamJitter);
  const auto factor = [&] { return std::exp(jitter * random.normal()); };
  PhysicsCalibration entry = calibration_of(model.parameters_at(gain, range));
  multiply(entry.K, factor());
  multiply(entry.sigma_tl, factor());
  multiply(entry.sigma_row, factor());
  multiply(entry.mu, factor());
  NoiseModel sensor = sensor_alone(model);
  sensor.origin += ", varied";
  sensor.physics = {std::move(entry)};
  return sensor;
}

}  // namespace malus
