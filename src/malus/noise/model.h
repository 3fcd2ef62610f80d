// The noise model of one sensor: everything that calibration measured, and how to get parameters at
// a gain. Sources: 000 section 3 (physics, joint model), 001 sections S1-S2 (non-parametric).
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/layout.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/calibration.h"
#include "malus/noise/joint_gain.h"
#include "malus/noise/model_kind.h"
#include "malus/noise/physics.h"
#include "malus/noise/profile.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// Whether parameters outside the calibrated range of gains may be extrapolated. Nothing is ever
/// interpolated across a break between conversion gains.
enum class GainRange { kCalibratedOnly, kAllowExtrapolation };

/// Of the switch that flags, settings and Python call extrapolate_gain.
constexpr GainRange gain_range(bool extrapolate) {
  return extrapolate ? GainRange::kAllowExtrapolation : GainRange::kCalibratedOnly;
}

/// What a profile makes of measured column noise (column_noise.h): part of the pixels' noise, as
/// synthesis draws it, or offsets of columns beside it, as the camera's own frames show it.
enum class ColumnNoise { kInPixels, kApart };

struct NoiseModel {
  std::string sensor;
  SensorLayout layout;
  std::vector<double> black_dn;               ///< nominal, per channel
  double white_dn = 0;                        ///< black included
  double quantization_dn = 1;                 ///< q: step of the converter; 0 = none
  int row_group = 1;                          ///< mosaic rows that share one draw of row noise
  std::string row_group_origin = "declared";  ///< or "detected", or "assumed"
  std::string origin;  ///< where the numbers come from: session file, publication, simulation
  double saturation_limit = 0;  ///< flats up to this share of black to white told K; 0: not known
  std::vector<std::string> warnings;  ///< of the whole calibration; each gain has its own, too
  std::vector<PhysicsCalibration> physics;  ///< rising gain
  std::optional<JointGainModel> joint;
  std::vector<GaussianCalibration> gaussian;            ///< rising gain
  std::vector<NonparametricCalibration> nonparametric;  ///< rising gain
  std::vector<DarkFrameBank> dark_frames;               ///< rising gain
  std::vector<DefectPixel> defects;

  /// The sensor's, for messages; "noise model" where it has none.
  std::string name() const;

  /// Those that it holds.
  std::vector<ModelKind> kinds() const;

  /// The number as a setting in the unit that the model was measured in: ISO, or dB.
  GainSetting setting_of(double gain) const;

  /// Parameters at a gain: calibrated values where the gain was measured with K, the joint model
  /// between.
  /// An unknown gain means the only one of a model with one gain. Throws InputError when the model
  /// has no physics part, when the gain is named in dB and the model is in ISO or the reverse,
  /// outside the calibrated range unless allowed, and between two conversion gains.
  GainParameters parameters_at(const GainSetting& gain,
                               GainRange range = GainRange::kCalibratedOnly) const;

  /// The calibrations nearest to a gain that parameters there come from: the one of this gain, or
  /// of those with K the next lower and the next higher, of which there may be one alone; none of
  /// an unknown gain where several were measured.
  std::vector<const PhysicsCalibration*> physics_around(const GainSetting& gain) const;

  /// Mean physics parameters at a gain; errors as parameters_at.
  PhysicsNoise physics_at(const GainSetting& gain,
                          GainRange range = GainRange::kCalibratedOnly) const;

  /// One frame's random parameters at a gain (000 Eq. 5-6): mu, sigma_row from their joint
  /// Gaussians, sigma_tl singly. A standard deviation drawn below zero is drawn again (for
  /// sigma_row all channels together, so that they stay correlated), up to 32 times, then set to
  /// zero: the Gaussians of Eq. 5-6 cut at zero. For single frames: who draws many keeps a
  /// ParameterSampler, which gives the same.
  PhysicsNoise sample_physics_at(const GainSetting& gain, std::uint64_t seed, std::uint32_t frame,
                                 GainRange range = GainRange::kCalibratedOnly) const;

  /// A gain whose log K̂ is uniform over the calibrated ranges (000, 5.1: "random log K"), never
  /// between conversion gains; one of the gains measured with K where no range was fitted. A model
  /// without a physics part draws uniformly in dB between the gains of its Gaussian, else its
  /// non-parametric part.
  GainSetting random_gain(std::uint64_t seed, std::uint32_t frame) const;

  /// The other kinds at a gain: measured, or interpolated between the two measured gains around it
  /// (interpolate_kinds.h), never across conversion gains; dark frames at measured gains only.
  /// InputError where the model holds none of the kind, or the gain lies outside.
  GaussianCalibration gaussian_at(const GainSetting& gain) const;
  NonparametricCalibration nonparametric_at(const GainSetting& gain) const;
  const DarkFrameBank& dark_frames_at(const GainSetting& gain) const;

  /// What a denoiser needs at a gain, from the physics part, else the Gaussian, else the
  /// non-parametric one (range concerns the first); and the defects, where the maps tell the
  /// sensor's size. Only the physics part tells column noise apart.
  NoiseProfile profile_at(const GainSetting& gain, GainRange range = GainRange::kCalibratedOnly,
                          ColumnNoise columns = ColumnNoise::kInPixels) const;

  bool operator==(const NoiseModel&) const = default;
};

/// The sensor without any of its calibrations: names, layout, levels, converter and row group.
NoiseModel sensor_alone(const NoiseModel& model);

/// The model at its measured gains, with Gaussian row noise of this many deviations of the read
/// noise in place of its own: without drift, and the same in every frame. Throws InputError where
/// it has no physics part.
NoiseModel with_row_noise(NoiseModel model, double read_deviations);

/// The profile of given physics parameters, parts switched off left out.
NoiseProfile profile_of(const PhysicsNoise& noise);

/// Physics noise with the mean parameters.
PhysicsNoise physics_of(const NoiseModel& model, const GainParameters& parameters);

/// What contradicts itself in the model (sizes against the layout, values out of range, gains not
/// rising); empty when nothing does. Loading and saving refuse a model with a contradiction.
std::string contradiction_in(const NoiseModel& model);

/// Reads a model file (docs/model-file.md), or a built-in model by name ("imx250myr-simulated" or
/// "builtin:imx250myr-simulated"; a file of that name goes first). Everything read is checked;
/// throws InputError.
NoiseModel load_model(const std::filesystem::path& path);

/// Writes the HDF5 model file beside its final name and renames it; the same model gives the same
/// bytes. Throws InputError, also when the file exists and force is false. Contract: no
/// contradiction_in(model).
void save_model(const NoiseModel& model, const std::filesystem::path& path, bool force = false);

}  // namespace malus
