// Slow drift of row noise: how much a row group's offset has in common with the groups before it.
// 000 draws every row group anew; real cameras also drift slowly while they read out a frame
// (docs/calibration.md, "Rows of a real camera").
#pragma once

#include <string>
#include <vector>

namespace malus {

/// The offset of row group g is sigma_b z_g with z_g of variance 1 and autocorrelation
///   rho(k) = share exp(-k / length_groups) for k >= 1:
/// a slow part (first-order autoregressive) of variance `share` and a white part of 1 - share.
/// share 0: white, as in 000; the length is 0 then.
struct RowDrift {
  double share = 0;          ///< of sigma_b², in [0, 1]
  double length_groups = 0;  ///< row groups over which the slow part falls to 1/e

  bool white() const { return share == 0; }
  bool operator==(const RowDrift&) const = default;
};

/// Lengths that can be drawn: below the first the slow part is white too, above the second a
/// frame's level would change and not its rows.
inline constexpr double kShortestRowDrift = 0.25, kLongestRowDrift = 256;

/// A drift as calibration found it; white where it found none.
struct MeasuredRowDrift {
  RowDrift drift;
  double share_stderr = 0, length_stderr = 0;
  bool operator==(const MeasuredRowDrift&) const = default;
};

/// What is impossible about the drift; empty when nothing is.
std::string contradiction_in(const RowDrift& drift);

/// "33 ± 2 % of the rows' variance, over 2.0 ± 0.1 row groups"; errors of 0 (published,
/// interpolated) are left out. Contract: not white.
std::string text_of(const MeasuredRowDrift& measured);

/// rho(lag), lag >= 0 in row groups.
double row_autocorrelation(const RowDrift& drift, int lag);

/// Power of the offsets at an angular frequency [radians per row group], over that of white ones of
/// their variance.
double row_power(const RowDrift& drift, double frequency);

/// Weights k_0, k_1, ... of independent standard normal draws w with z_g = sum_j k_j w_(g-j); their
/// squares add to 1. A white part plus a first-order autoregressive one is an ARMA(1,1) process
/// (Granger, Morris, "Time series modelling and interpretation", JRSS A 139, 1976), whose weights
/// after the first fall by exp(-1/length); those below 1e-3 of the second one are left out. White:
/// one weight of exactly 1.
std::vector<double> row_kernel(const RowDrift& drift);

/// Between two gains, t from 0 to 1: the share linearly, the length in its logarithm; a white end
/// has no length and takes the other's.
RowDrift interpolated(const RowDrift& low, const RowDrift& high, double t);

}  // namespace malus
