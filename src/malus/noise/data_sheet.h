// A calibration in the terms of the EMVA Standard 1288 (release 4.0 linear, 2021), which data
// sheets of machine-vision cameras use, and the profiles of its fixed pattern.
#pragma once

#include "malus/base/quantity.h"
#include "malus/base/statistics.h"
#include "malus/image/view.h"
#include "malus/noise/model.h"

#include <optional>
#include <vector>

namespace malus {

/// One value per channel: gain, temporal dark noise, read noise, dark signal, DSNU, PRNU,
/// saturation capacity, absolute sensitivity threshold (in electrons: quantum efficiency is not
/// measured here), dynamic range, largest SNR, linearity error. What the calibration lacks is NaN.
/// Temporal dark noise is without the converter's quantization, q²/12, as in the standard; below
/// 0.24 q² it is the standard's limit, 0.40 q, whose error is NaN. Threshold and dynamic range are
/// of the whole noise. Threshold, dynamic range, largest SNR and linearity error have no standard
/// errors, nor have DSNU and PRNU of models that hold none; read noise has none below 20 bias
/// frames.
/// DSNU and PRNU are of pixels within eight robust deviations of the channel's median; the standard
/// takes all, and a few defects then are most of both.
/// Saturation is the mean of the first level past the maximum of the variance, where flats show
/// that below white (PhotonTransferPoint::saturated), else the white level; less the dark signal.
/// Saturation, dynamic range and largest SNR are NaN where a channel's flats do not tell where it
/// saturates: they got neither past the maximum of the variance nor to white, and another channel's
/// at this gain showed such a maximum below white. Then white is not their level, too: they only
/// never got there.
std::vector<Quantity> data_sheet(const NoiseModel& model, const PhysicsCalibration& at_gain);

/// Over the channels whose value is known; NaN where none is.
struct ChannelMean {
  double value, standard_error;
};
/// The mean of a quantity of the data sheet, by its name. The standard error takes the channels'
/// errors as independent, which those of other pixels are; where they are one and the same in good
/// part (temporal_dark_noise, dark_signal, dsnu: the channels share rows and the frames' levels) it
/// is their mean, which it cannot exceed.
ChannelMean channel_mean(const Quantity& quantity);

/// Signal above dark [DN] that a channel saturates at, as data_sheet says.
double saturation_level_dn(const NoiseModel& model, const PhysicsCalibration& at_gain, int channel);

/// Whether a point's exposure is known and its signal lies between 5 and 95 % of saturation_dn
/// (above dark), where EMVA 1288 judges linearity. One at white does not: its mean is of what was
/// cut off.
bool counts_for_linearity(const PhotonTransferPoint& point, double saturation_dn);

/// Whether two levels of one exposure hold the same light, to 2 %: two settings of a lamp do not,
/// and then the exposure does not tell the light. Of the points that count for linearity.
bool exposure_tells_light(const std::vector<PhotonTransferPoint>& transfer, int channel,
                          double saturation_dn);

/// EMVA 1288, section "linearity": the line through signal above dark [DN] against exposure [s]
/// that weighs relative deviations equally, over the levels that count. None with fewer than three
/// exposures there, nor where the exposure does not tell the light.
std::optional<LineFit> linearity_line(const std::vector<PhotonTransferPoint>& transfer, int channel,
                                      double saturation_dn);

/// EMVA 1288, section "linearity": mean absolute deviation, in %, of the mean signal from
/// linearity_line over its levels. NaN where there is no line.
double linearity_error_percent(const std::vector<PhotonTransferPoint>& transfer, int channel,
                               double saturation_dn);

/// Intercept [DN^2] above the dark variance of the line whose slope is K: 0, as the dark point
/// holds it, but K_intercept_dn2 where the dark noise is cut off and the line was fitted without a
/// dark point: line_intercept_dn2, of older files by kMostDarkZeros.
double transfer_intercept_dn2(const PhysicsCalibration& at_gain, int channel);

/// How far the used points of the photon-transfer curve lie from that line: the sum of their
/// squared distances over their own variances, and the degrees of freedom, per channel one less
/// than points (two where the line has an intercept). Points without a standard error are left out.
struct TransferMisfit {
  double chi_square = 0;
  int degrees_of_freedom = 0;
};
TransferMisfit transfer_misfit(const PhysicsCalibration& at_gain, int channel);

/// EMVA 1288, "signal-to-noise ratio", of the temporal noise alone: s / sqrt(d² + s), signal s and
/// dark noise d (rows and quantization in it) in electrons.
double signal_to_noise(double signal, double dark_noise);

/// Mean of every row (column) of a map.
std::vector<double> row_profile(View<const float> map);
std::vector<double> column_profile(View<const float> map);

/// EMVA 1288 spectrogram along the rows: root of the power |Y_k|²/cols averaged over the rows, for
/// k = 0 .. cols/2 periods per row; white noise of standard deviation s gives s everywhere. Along
/// columns: the same of the transposed map. Empty of a map without pixels.
std::vector<double> row_spectrum(View<const float> map);
std::vector<double> column_spectrum(View<const float> map);

}  // namespace malus
