// The joint model over gain (000 section 3.3, Eq. 5-7): how every parameter moves with the overall
// system gain, so that noise can be drawn at gains that were not measured.
//
// The paper's law is log x = slope log K̂ + intercept. Real sensors bend away from it (noise before
// and after the amplifier add in squares; intermediate ISOs are digital), so the residuals at the
// measured gains are kept, and the part of them that measurement error does not explain is
// interpolated over gain and added to the law.
#pragma once

#include "malus/base/estimate.h"
#include "malus/noise/calibration.h"

#include <span>
#include <string>
#include <vector>

namespace malus {

/// log x = slope log K̂ + intercept, K̂ the mean of the channels' K (000 Eq. 7).
struct LogLinear {
  double slope = 0, intercept = 0;
  double slope_stderr = 0, intercept_stderr = 0;  ///< 0 with fewer than three gains
  double residual_sd = 0;  ///< about the law, with n - 2 in the divisor; weighted as the fit
  /// x is not positive at every gain, or no power of K̂ (-mu): x = slope log K̂ + intercept instead,
  /// fitted with weights 1/error², and linear in K̂ between the gains (joint_parameters).
  bool signed_linear = false;
  std::vector<double> residual;  ///< per knot, in log x (or x); 0 where x had no logarithm
  double residual_weight = 0;  ///< share of the residuals that is real: 1 - error²/residual², >= 0;
                               ///< of signed_linear laws 1 - (n - 2)/χ²

  /// The bare law of Eq. 7, in units of x.
  double law(double log_K) const;
  /// The law plus the real share of the residuals, interpolated in dB between the knots (constant
  /// outside).
  double at(double log_K, std::span<const double> knots_db, double gain_db) const;
  bool operator==(const LogLinear&) const = default;
};

/// One range of conversion gain. Vectors have one entry per channel unless stated otherwise; knots
/// are the gains that were fitted.
struct JointSegment {
  std::vector<double> knots_db;     ///< gain of each knot (ISO as 20 log10(iso/100)), rising
  std::vector<double> knots_log_K;  ///< log K̂ of each knot
  LogLinear K_of_gain;              ///< log K̂ = slope dB + intercept; knots are knots_db
  std::vector<double> K_ratio;      ///< K_c / K̂, mean over the gains
  /// Laws of -mu, sigma_row and sigma_tl in DN, of their variances from frame to frame in DN², and
  /// of the sd of sigma_tl in DN (000 Eq. 5-7).
  std::vector<LogLinear> minus_mu, mu_variance, sigma_row, sigma_row_variance, sigma_tl,
      sigma_tl_spread;
  /// Between channels, mean over the gains, nearest positive semi-definite.
  SquareMatrix mu_correlation, sigma_row_correlation;
  std::vector<std::vector<double>> lambda;  ///< per knot, per channel; interpolated
  std::vector<RowDrift> row_drift;          ///< per knot; interpolated; empty: white at all of them

  double log_K_low() const { return knots_log_K.front(); }
  double log_K_high() const { return knots_log_K.back(); }
  bool operator==(const JointSegment&) const = default;
};

/// Segments are separated by breaks between conversion gains; most sensors have one.
struct JointGainModel {
  std::vector<JointSegment> segments;  ///< rising gain
  std::vector<std::string> notes;  ///< breaks found, signed regressions, projections of matrices,
                                   ///< gains so far apart that the law between them is a guess
  bool operator==(const JointGainModel&) const = default;
};

/// Parameters at one gain, one entry per channel: means, and how they vary from frame to frame.
struct GainParameters {
  GainSetting gain;
  bool measured = false;  ///< values as calibrated; otherwise from the joint model
  std::vector<double> K, lambda, mu_dn, sigma_row_dn, sigma_tl_dn;  ///< K: DN/e-
  std::vector<double> sigma_tl_spread_dn;
  SquareMatrix mu_covariance, sigma_row_covariance;  ///< DN², positive semi-definite
  RowDrift row_drift;
};

/// Fits the joint model. Gains without K are left out and named in the notes. Undecided with fewer
/// than two gains that have K.
Estimate<JointGainModel> fit_joint_model(const std::vector<PhysicsCalibration>& gains);

/// The joint model's parameters of a segment at a gain in dB; extrapolates outside the knots.
GainParameters joint_parameters(const JointSegment& segment, double gain_db);

/// The parameters as a model's entry for their gain: what was not asked of the joint model (frames,
/// standard errors, maps) is absent.
PhysicsCalibration calibration_of(const GainParameters& parameters);

/// The gain in dB at which the segment's K̂ has this logarithm; inside the knots.
double gain_db_of_log_K(const JointSegment& segment, double log_K);

/// Indices i such that gains i and i+1 (rising) lie on different conversion gains. A break is a
/// step of read noise or of K that departs by more than the factor kBreakFactor from what the
/// slopes of the two neighbouring intervals allow. At the ends, where one neighbour is missing,
/// read noise in DN may also grow between not at all (noise behind the amplifier) and like K (noise
/// before it); K always may grow like the gain setting.
inline constexpr double kBreakFactor = 1.4;
std::vector<int> conversion_gain_breaks(std::span<const double> gain_db,
                                        std::span<const double> log_K,
                                        std::span<const double> log_read_noise);

/// A line for every two neighbouring knots so far apart that the law's read noise between them is a
/// guess: more than 15 % above noise before and after the amplifier that adds in squares.
std::vector<std::string> wide_gap_notes(const JointSegment& segment,
                                        std::span<const std::string> gain_names);

}  // namespace malus
