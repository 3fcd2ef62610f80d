// What calibration measured at one gain, for every kind of model.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/view.h"
#include "malus/noise/matrix.h"
#include "malus/noise/row_drift.h"

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// A parameter over the bias frames of one gain: one entry per channel in mosaic order. Fields not
/// measured are empty.
struct ChannelStatistics {
  std::vector<double> mean;
  std::vector<double> standard_error;  ///< of the mean; NaN where it cannot be told
  /// Sd of the parameter from frame to frame, sampling error of one frame removed; NaN where one
  /// frame cannot tell.
  std::vector<double> spread;
  /// Over frames, between channels, sampling error removed; n = 0 if not measured.
  SquareMatrix covariance;
  /// [frame][channel]: every frame's own estimate, sampling error and all; NaN where a frame had
  /// none; empty if not kept.
  std::vector<std::vector<double>> per_frame = {};
  bool operator==(const ChannelStatistics&) const = default;
};

/// One point of the photon-transfer curve.
struct PhotonTransferPoint {
  int channel = 0;
  double exposure_s = 0;
  double mean_dn = 0;       ///< signal above dark
  double variance_dn2 = 0;  ///< temporal variance minus dark_variance_dn2
  double variance_stderr_dn2 = 0;
  bool used = false;
  std::string why_not;     ///< reason when not used, with numbers
  bool saturated = false;  ///< past the maximum of the variance, below white (EMVA 1288)
  bool at_white = false;   ///< more pixels than a stray few are at the white level
  /// Temporal, of the level's own dark frames, else of the bias frames; 0: not known (older files).
  double dark_variance_dn2 = 0;
  bool operator==(const PhotonTransferPoint&) const = default;
};

/// The physics calibration at one gain (000, 3.2).
struct PhysicsCalibration {
  GainSetting gain;
  int bias_frames = 0;
  int flat_levels = 0;
  ChannelStatistics K;  ///< DN/e-; standard_error from the photon-transfer fit
  std::vector<double> K_intercept_dn2, K_intercept_stderr_dn2;  ///< of the photon-transfer line
  /// Where any channel's dark noise is cut off, intercept of the line whose slope is K, above the
  /// dark variance: K_intercept_dn2 of channels whose line was fitted without the dark point, else
  /// 0. Empty where nothing is cut off, and of older files (transfer_intercept_dn2).
  std::vector<double> line_intercept_dn2;
  ChannelStatistics mu;                     ///< DN above black
  ChannelStatistics sigma_row;              ///< DN
  MeasuredRowDrift row_drift;               ///< of the row groups' offsets
  ChannelStatistics sigma_tl;               ///< DN
  ChannelStatistics lambda;                 ///< 1
  ChannelStatistics sigma_column;           ///< DN; part of sigma_tl (column_noise.h)
  std::vector<double> temporal_sd_dark_dn;  ///< rows, quantisation and all
  std::vector<double> temporal_sd_dark_stderr_dn;
  /// Where the converter's step hides the dark noise of a channel: variance without light as lit
  /// frames hold it, rows and q²/12 in it, where K's line begins. Empty: temporal_sd_dark squared.
  std::vector<double> dark_point_dn2, dark_point_stderr_dn2;
  /// Per channel, share of the dark pixels at DN 0 where the camera cuts the noise off; empty where
  /// it does not.
  std::vector<double> dark_zero_share;
  /// mu, sigma_row, sigma_tl, lambda, temporal_sd_dark and dsnu are those before the cut.
  bool cut_off_undone = false;
  /// More than kMostUndoneDarkZeros in any channel, and not undone.
  bool dark_was_cut_off() const;
  /// Sd of the fixed pattern, in the dark and of the response (relative): without defects and
  /// sampling error.
  std::vector<double> dsnu_dn, prnu;
  std::vector<double> dsnu_stderr_dn, prnu_stderr;  ///< may be empty
  SquareMatrix row_correlation;  ///< between the channels' row-group offsets inside a frame
  std::vector<PhotonTransferPoint> transfer;
  /// Mosaics, either may be empty: per-pixel mean of the bias frames minus the channel's mean;
  /// relative response, mean 1 per channel.
  Image dark_shading_dn, prnu_map;
  /// Read-noise residuals of all bias frames per channel: counts of |residual| in cells
  /// [i, i + 1) * residual_cell_dn, the last one with all beyond; empty if not kept.
  std::vector<double> residual_cell_dn;
  std::vector<std::vector<double>> residual_counts;
  std::vector<std::string> warnings;
  bool operator==(const PhysicsCalibration&) const = default;
};

/// Heteroscedastic Gaussian noise at one gain: variance = max(slope s + offset, 0), s the signal in
/// DN above black. One entry per channel. The offset is that of frames as they were recorded: row
/// noise and, of frames of whole numbers, quantisation (q²/12) are part of it, whichever way it was
/// measured. Who draws frames that will be rounded takes q²/12 out.
struct GaussianCalibration {
  GainSetting gain;
  int levels = 0;  ///< signal levels that the line was fitted to; 0 when published, not fitted
  std::vector<double> slope_dn, slope_stderr_dn;
  std::vector<double> offset_dn2, offset_stderr_dn2;
  std::vector<double> bias_dn;  ///< mean of dark pixels above the black level; may be empty
  std::vector<std::string> warnings;
  bool operator==(const GaussianCalibration&) const = default;
};

/// One channel of a non-parametric model: the distribution of noisy - clean at rising signal levels
/// (001, S1-S2). Row noise is kept apart.
struct NonparametricChannel {
  std::vector<double> level_dn;          ///< centres, rising, DN above black
  std::vector<std::int64_t> samples;     ///< per level; borrowed ones included
  std::vector<double> bin_edges_dn;      ///< rising; common to all levels
  std::vector<std::vector<double>> pmf;  ///< per level: bin probabilities that add to 1
  bool operator==(const NonparametricChannel&) const = default;
};

/// Moments of one level's noise, uniform inside each bin.
struct LevelMoments {
  double mean_dn = 0, variance_dn2 = 0;
};
LevelMoments level_moments(const NonparametricChannel& channel, std::size_t level);

struct NonparametricCalibration {
  GainSetting gain;
  int frames = 0;
  std::vector<NonparametricChannel> channels;             ///< one per channel of the layout
  std::vector<double> sigma_row_dn, sigma_row_stderr_dn;  ///< sd of the row groups' offsets
  MeasuredRowDrift row_drift;
  std::vector<double> K;  ///< DN/e-, where flats gave it: lets gains be compared; may be empty
  std::vector<std::string> warnings;
  bool operator==(const NonparametricCalibration&) const = default;
};

/// Whole real bias frames of one gain, for dark-frame sampling: mosaics in DN above black.
struct DarkFrameBank {
  GainSetting gain;
  std::vector<Image> frames_dn;  ///< all of one size, a multiple of the layout's cell
  bool operator==(const DarkFrameBank&) const = default;
};

/// Mosaic position of a defect pixel and what is wrong with it ("hot", "dead", "noisy", "stuck").
struct DefectPixel {
  int row = 0, col = 0;
  std::string kind;
  /// What condemned it: hot, deviations of the dark signal from its channel's median; dead,
  /// response over its neighbourhood's; noisy and stuck, normal equivalent of its variance's chi
  /// square.
  double value = 0;
  bool operator==(const DefectPixel&) const = default;
};

/// Share of a channel's pixels at DN 0, dark or of a flat level: with more calibration warns, and
/// where it undid the cut-off in the dark point, it leaves such a level out.
inline constexpr double kMostSilentZeros = 1e-3;

/// Share of a channel's dark pixels at DN 0: with more, which makes the variance of normal noise
/// 1.8 % too small, the dark point moves by as much as its error, and K rests on the flats alone.
inline constexpr double kMostDarkZeros = 1e-2;

/// The same share, for denoising: with more it works out what bias and variance were before the
/// cut, as of normal noise (before_cut_off). Up to here they are nearly right as measured, the
/// deviation of normal noise to 1.8 % and its mean to 0.7 % of that, and no law has to be assumed.
/// The highest of the three: kMostDarkZeros only leaves one point out of many.
inline constexpr double kMostUndoneDarkZeros = 2e-2;

inline bool PhysicsCalibration::dark_was_cut_off() const {
  return !cut_off_undone && std::any_of(dark_zero_share.begin(), dark_zero_share.end(),
                                        [](double share) { return share > kMostUndoneDarkZeros; });
}

/// Share of a sensor's pixels; with more defects the list is hardly true, and filling them harms.
inline constexpr double kManyDefects = 0.01;

}  // namespace malus
