// The noise of one camera as a training draws it and tells it to networks: that of a calibrated
// model, or of a trained Noise Flow.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/neural/package.h"
#include "malus/noise/model.h"
#include "malus/synthesize/synthesizer.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace malus {

class CameraNoise {
 public:
  struct Drawn {
    RawFrame noisy;  ///< as the camera writes it, black included
    NoiseProfile profile;
  };
  virtual ~CameraNoise() = default;

  /// Layout, levels, converter and row group. A flow's holds no calibration.
  virtual const NoiseModel& camera() const = 0;
  /// The number as a setting in the unit of the model, or of the flow's pairs.
  virtual GainSetting setting_of(double gain) const = 0;
  /// Throws InputError where nothing could be drawn with the options: of a model that lacks the
  /// kind, and where a setting means nothing to it.
  virtual void require_drawable() const = 0;
  /// A gain that it can be drawn at, by (seed, number); of a flow one that it was trained at.
  virtual GainSetting random_gain(std::uint64_t seed, std::uint32_t number) const = 0;
  /// Throws InputError on a gain that draws refuse, or that no profile is known at.
  virtual void require_gain(const GainSetting& gain) const = 0;
  /// What a denoiser is told at a gain of noise with these parts: of a flow, which knows no parts,
  /// measured on its draws (NoiseFlowModel). Throws InputError as require_gain.
  virtual NoiseProfile profile_at(const GainSetting& gain, const PhysicsParts& parts) const = 0;
  /// A frame of the clean mosaic (DN above black) at the ratio's light, with what it was drawn of;
  /// a function of (seed, number). Throws InputError as require_gain.
  virtual Drawn draw(View<const float> clean_dn, const GainSetting& gain, double ratio,
                     std::uint64_t seed, std::uint32_t number) const = 0;
  /// What speaks against its noise at these gains, with the file's name; else empty.
  virtual std::string complaint(const std::vector<GainSetting>& gains) const = 0;
};

/// What draws of it are made with. settings.ratio is not looked at.
struct CameraNoiseOptions {
  SynthesisSettings settings;
  double jitter = 0;        ///< sensors like it, another for every draw: jittered_sensor
  bool or_grey = false;     ///< its layout may be the package's without colours
  bool only_flows = false;  ///< no calibrated model is there whose kind the settings could mean
};

/// Throws InputError, about source, where no part makes noise of single pixels and the package
/// wants to be told its level. step_dn: of frames that are rounded, 0 of others.
void require_noise_level(const PhysicsParts& parts, double step_dn, const NetworkPackage& package,
                         const std::string& source);

/// Of a noise model's file or built-in name, or of a Noise Flow's file. Throws InputError as
/// load_model, and where its layout is not the package's (options.or_grey).
std::unique_ptr<const CameraNoise> open_camera(const std::filesystem::path& path,
                                               const NetworkPackage& package,
                                               const CameraNoiseOptions& options);

/// A camera's layout and levels alone, of either kind of file. Throws InputError.
NoiseModel camera_of(const std::filesystem::path& path);

/// A noise model for a package's training. Throws InputError as load_model, where it is of another
/// layout, and where the file is a Noise Flow, naming `use`: what wants a calibrated model.
NoiseModel load_camera(const std::filesystem::path& path, const NetworkPackage& package,
                       const std::string& use);

/// A sensor like `model` at a gain: K, Tukey-lambda scale, bias and row noise multiplied by factors
/// exp(jitter * normal), drawn from (seed, number). Of the physics part alone. Throws InputError as
/// NoiseModel::parameters_at.
NoiseModel jittered_sensor(const NoiseModel& model, const GainSetting& gain, double jitter,
                           std::uint64_t seed, std::uint32_t number,
                           GainRange range = GainRange::kCalibratedOnly);

}  // namespace malus
