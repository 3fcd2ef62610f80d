// The physics noise model at one gain: the parameters that a sampler draws with (000 Eq. 1-4).
#pragma once

#include "malus/image/layout.h"
#include "malus/noise/calibration.h"
#include "malus/noise/tukey_lambda.h"

#include <vector>

namespace malus {

/// One channel at one gain. Read noise excludes row noise and quantisation.
struct PhysicsChannel {
  double gain_dn_per_e = 1.0;     ///< K, overall system gain
  double lambda = kNormalLambda;  ///< Tukey-lambda shape
  double mu_dn = 0.0;             ///< mean of dark pixels above the black level
  double sigma_tl_dn = 0.0;       ///< Tukey-lambda scale
  double sigma_row_dn = 0.0;      ///< σ_b, sd of the row groups' offsets
};

/// λ that a sampler draws with: below, read noise has no variance; above, tukey_lambda.h states no
/// error (calibration finds none beyond 1.25, tukey_fit.h).
inline constexpr double kNoVarianceLambda = -0.5, kHighestLambda = 8.0;

/// Components that can be switched off: the rows of 000 Table 2.
struct PhysicsParts {
  bool shot = true, read = true, row = true, quantization = true;
  bool bias = true;  ///< channel means mu; off = zero-mean read noise
};

/// A realised set of parameters: enough to draw noise for a frame.
struct PhysicsNoise {
  SensorLayout layout;
  std::vector<PhysicsChannel> channels;  ///< one per channel of the layout
  int row_group = 1;                     ///< mosaic rows that share one draw of row noise
  RowDrift row_drift;                    ///< what the draws of neighbouring row groups share
  double quantization_dn = 1.0;          ///< q: step of the converter; 0 = none
  PhysicsParts parts;
};

/// Variance of Tukey-lambda read noise in DN².
double read_variance_dn2(const PhysicsChannel& channel);

/// Variance of one pixel about its channel's mean without the row part: K s + read + q²/12, in DN².
/// Negative signals have no shot noise.
double pixel_variance_dn2(const PhysicsChannel& channel, double signal_dn, double quantization_dn);

/// Temporal sd of a channel's dark pixels, rows and quantisation included, in DN; of all channels.
double dark_deviation_dn(const PhysicsChannel& channel, double quantization_dn);
std::vector<double> temporal_sd_dark_dn(const PhysicsNoise& noise);

/// Standard deviation of read noise per channel (rows and quantisation excluded) of a calibration,
/// in DN; and in electrons, empty where K is not known.
std::vector<double> read_noise_dn(const PhysicsCalibration& calibration);
std::vector<double> read_noise_e(const PhysicsCalibration& calibration);

/// Standard errors of read_noise_e: the scatter of the bias frames' own σ_TL and λ, which are
/// correlated, and that of K. NaN below 20 frames, whose scatter is uncertain itself, and where the
/// frames' own values are not kept.
std::vector<double> read_noise_stderr_e(const PhysicsCalibration& calibration);

}  // namespace malus
