// The noise model of one sensor: everything that calibration measured, and how to get parameters at
// a gain. Sources: 000 section 3 (physics, joint model), 001 sections S1-S2 (non-parametric).
#pragma once

#include "malus/base/estimate.h"
#include "malus/base/random.h"
#include "malus/image/layout.h"
#include "malus/image/raw_frame.h"
#include "malus/image/view.h"
#include "malus/noise/physics.h"
#include "malus/noise/profile.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// n x n, row-major.
struct SquareMatrix {
  int n = 0;
  std::vector<double> values;
  SquareMatrix() = default;
  explicit SquareMatrix(int size)
      : n(size), values(static_cast<std::size_t>(size) * static_cast<std::size_t>(size)) {}
  double& operator()(int r, int c) {
    return values[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
                  static_cast<std::size_t>(c)];
  }
  double operator()(int r, int c) const {
    return values[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
                  static_cast<std::size_t>(c)];
  }
};

/// A parameter over the bias frames of one gain: one entry per channel in mosaic order. Fields not
/// measured are empty.
struct ChannelStatistics {
  std::vector<double> mean;
  std::vector<double> standard_error;  ///< of the mean
  std::vector<double>
      spread;  ///< sd of the parameter from frame to frame (sampling error of one frame removed)
  SquareMatrix
      covariance;  ///< over frames, between channels, sampling error removed; n = 0 if not measured
};

/// One point of the photon-transfer curve.
struct PhotonTransferPoint {
  int channel = 0;
  double exposure_s = 0;
  double mean_dn = 0;       ///< signal above dark
  double variance_dn2 = 0;  ///< temporal variance minus the dark pair's
  double variance_stderr_dn2 = 0;
  bool used = false;
  std::string why_not;  ///< reason when not used, with numbers
};

/// The physics calibration at one gain (000, 3.2).
struct PhysicsCalibration {
  GainSetting gain;
  int bias_frames = 0;
  int flat_levels = 0;
  ChannelStatistics K;  ///< DN/e-; standard_error from the photon-transfer fit
  std::vector<double> K_intercept_dn2, K_intercept_stderr_dn2;  ///< of the photon-transfer line
  ChannelStatistics mu;                                         ///< DN above black
  ChannelStatistics sigma_row;                                  ///< DN
  ChannelStatistics sigma_tl;                                   ///< DN
  ChannelStatistics lambda;                                     ///< 1
  ChannelStatistics sigma_column;                               ///< DN; reported, not synthesized
  std::vector<double> temporal_sd_dark_dn;                      ///< rows, quantisation and all
  std::vector<double> temporal_sd_dark_stderr_dn;
  std::vector<double> dsnu_dn,
      prnu;                      ///< sd of the fixed pattern (DN; relative), sampling error removed
  SquareMatrix row_correlation;  ///< between the channels' row-group offsets inside a frame
  std::vector<PhotonTransferPoint> transfer;
  Image dark_shading_dn;  ///< mosaic: per-pixel mean of the bias frames minus the channel's mean;
                          ///< may be empty
  Image prnu_map;         ///< mosaic: relative response, mean 1 per channel; may be empty
  std::vector<std::string> warnings;
};

/// Mosaic position of a defect pixel and what is wrong with it ("hot", "dead", "noisy", "stuck").
struct DefectPixel {
  int row = 0, col = 0;
  std::string kind;
  double value = 0;  ///< the statistic that condemned it, in robust sd
};

/// log x = slope log K̂ + intercept, K̂ the mean of the channels' K (000 Eq. 7).
struct LogLinear {
  double slope = 0, intercept = 0;
  double slope_stderr = 0, intercept_stderr = 0, residual_sd = 0;
  bool signed_linear =
      false;  ///< x itself changes sign over gain: x = slope log K̂ + intercept instead
};

/// The joint model over gain for one range of conversion gain (000, 3.3; physics.md "Joint model").
/// Vectors have one entry per channel.
struct JointSegment {
  double log_K_low = 0, log_K_high = 0;  ///< range of log K̂ of the gains fitted
  std::vector<LogLinear> minus_mu, mu_variance, sigma_row, sigma_row_variance, sigma_tl,
      sigma_tl_spread;
  SquareMatrix mu_correlation,
      sigma_row_correlation;                ///< nearest positive semi-definite, averaged over gains
  std::vector<double> K_ratio;              ///< K_c / K̂, mean over the gains
  LogLinear K_of_gain;                      ///< log K̂ against gain in dB
  std::vector<double> lambda_log_K;         ///< log K̂ of the knots of lambda
  std::vector<std::vector<double>> lambda;  ///< per knot, per channel
};

/// Segments are separated by breaks between conversion gains; most sensors have one.
struct JointGainModel {
  std::vector<JointSegment> segments;
  std::vector<std::string> notes;  ///< breaks found, signed regressions, projections of matrices
};

/// Whether parameters outside the calibrated range of gains may be extrapolated.
enum class GainRange { kCalibratedOnly, kAllowExtrapolation };

struct NoiseModel {
  std::string sensor;
  SensorLayout layout;
  std::vector<double> black_dn;  ///< nominal, per channel
  double white_dn = 0;           ///< black included
  double quantization_dn = 1;
  int row_group = 1;
  std::string row_group_origin = "declared";  ///< or "detected"
  std::string origin;  ///< where the numbers come from: session file, publication, simulation
  std::vector<PhysicsCalibration> physics;  ///< rising gain
  std::optional<JointGainModel> joint;
  std::vector<DefectPixel> defects;

  /// Contained kinds: "physics", later "gaussian", "nonparametric".
  std::vector<std::string> kinds() const;

  /// Mean parameters at a gain: calibrated values where the gain was measured, the joint model
  /// between. Throws InputError outside the calibrated range unless allowed, or when the model has
  /// no physics part.
  PhysicsNoise physics_at(const GainSetting& gain,
                          GainRange range = GainRange::kCalibratedOnly) const;

  /// One frame's random parameters at a gain (000 Eq. 5-6): mu, sigma_row from their joint
  /// Gaussians, sigma_tl singly.
  PhysicsNoise sample_physics_at(const GainSetting& gain, std::uint64_t seed, std::uint32_t frame,
                                 GainRange range = GainRange::kCalibratedOnly) const;

  /// The same at log K̂ uniform between the calibrated ends (000, 5.1: "random log K").
  PhysicsNoise sample_physics_at_random_gain(std::uint64_t seed, std::uint32_t frame) const;

  /// What a denoiser needs at a gain.
  NoiseProfile profile_at(const GainSetting& gain,
                          GainRange range = GainRange::kCalibratedOnly) const;
};

/// The profile of given physics parameters.
NoiseProfile profile_of(const PhysicsNoise& noise);

/// Reads and writes the HDF5 model file (docs/model-file.md). Throws InputError; everything read is
/// checked. Writing goes beside the final name and is renamed.
NoiseModel load_model(const std::filesystem::path& path);
void save_model(const NoiseModel& model, const std::filesystem::path& path);

/// Fits the joint model to model.physics; needs at least two gains.
Estimate<JointGainModel> fit_joint_model(const std::vector<PhysicsCalibration>& gains);

}  // namespace malus
