// Overall system gain K from the photon-transfer curve: the temporal variance of flat frames rises
// with their mean by K (000, 3.2; EMVA 1288, section 6; Janesick, Photon Transfer, 2007).
#pragma once

#include "malus/base/estimate.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Why a level must not be used for K.
enum class Refusal {
  kNone,
  kOneFrame,
  kAboveLimit,  ///< of the range
  kWhite,       ///< too many pixels at the white level
  kNotAboveDark,
  kPastMaximum,  ///< the variance falls while the mean rises
  kHidden,       ///< the converter's step hides the noise
  kCutOff        ///< too many pixels at 0
};

/// The same in words, with the level's numbers.
struct RefusedLevel {
  Refusal reason = Refusal::kNone;
  std::string words = {};
  bool empty() const { return reason == Refusal::kNone; }
};

/// One channel at one light level, with the dark frames that belong to it.
struct TransferLevel {
  double mean_dn = 0;             ///< signal above dark
  double mean_variance_dn2 = 0;   ///< error of the flats' share in mean_dn, squared
  double variance_dn2 = 0;        ///< temporal, dark part and all
  double rounding_error_dn2 = 0;  ///< standard error that rounding adds to variance_dn2
  int frames = 0;
  double exposure_s = 0;              ///< 0: not known
  double dark_variance_dn2 = 0;       ///< temporal variance of the matching dark frames
  int dark_frames = 0;                ///< their number; 0: the common dark point was used
  int dark_set = 0;                   ///< which: levels of one set share the error of its frames
  double dark_zero_share = 0;         ///< of the matching dark frames' pixels at the floor
  double dark_current_dn = 0;         ///< level of the matching dark frames above the bias frames
  double dark_mean_variance_dn2 = 0;  ///< error of the dark frames' share in mean_dn, squared
  bool saturated = false;             ///< past the maximum of the variance, below white
  double zero_share = 0;              ///< of the pixels at the floor
  bool at_white = false;              ///< more pixels than a stray few are at the white level
  RefusedLevel refused;               ///< empty where the level may be used
};

/// The channel's dark point, common to all levels.
struct DarkPoint {
  double variance_dn2 = 0, variance_stderr_dn2 = 0;
  double row_variance_dn2 = 0;     ///< σ_b² inside variance_dn2
  double fourth_cumulant_dn4 = 0;  ///< of a pixel's dark noise: above 0 for heavy tails
  std::int64_t pixels = 0;         ///< of the channel
  /// Draws of row noise in a frame: row groups, fewer where they drift (Σ ρ² of them count as one).
  double row_groups = 0;
  double column_variance_dn2 = 0;  ///< σ_col² inside variance_dn2
  double columns = 0;              ///< draws of it in a frame
  /// The camera's black level cuts the dark noise off, so that its variance and its mean are not
  /// those of no light: the line does not go through the dark point.
  bool cut_off = false;
};

/// Squared standard error of the temporal variance of `frames` (two or more), averaged over the
/// channel's pixels: 2/(M-1) [(σ⁴ + 2 σ² (σ_b² + σ_col²) + 2 σ_b² σ_col²) / P + σ_b⁴ / G +
/// σ_col⁴ / C] + (K² shot + κ) / (M P).
/// shot_dn2: of σ² the shot noise, of light and of dark current beyond the bias frames'.
double variance_error_dn4(double shot_dn2, int frames, const DarkPoint& dark, double gain_dn_per_e);

/// The same of a level's flats, and of the dark frames of its own (0 where it has none).
double flat_error_dn4(const TransferLevel& level, const DarkPoint& dark, double gain_dn_per_e);
double dark_error_dn4(const TransferLevel& level, const DarkPoint& dark, double gain_dn_per_e);

struct TransferFit {
  double slope_dn_per_e = 0, slope_stderr = 0;
  /// Line's slope minus that without light, where the levels show that the sensor is not linear: by
  /// the mean against the exposure, or by the variance against the mean. In slope_stderr, too.
  double bend_dn_per_e = 0;
  double response_bend_per_dn = 0;  ///< b of x = s (1 - b s) that makes it; 0 where no bend shows
  /// The means do not follow the exposures (is_beyond_bends), which tell no bend then.
  bool exposures_tell_no_light = false;
  /// Of the line that the dark point does not hold, minus the dark variance; 0 within its error
  /// on a linear sensor.
  double intercept_dn2 = 0, intercept_stderr_dn2 = 0;
  double chi_square_per_level = 0;          ///< with sampling errors alone
  double excess_deviation_dn2 = 0;          ///< scatter beyond the sampling errors (nonlinearity)
  std::vector<double> variance_stderr_dn2;  ///< of each level's variance
};

/// Line through the dark point (unless it is cut off) and the levels, weighted by 1/variance.
/// Sampling variances follow from the fitted line: 2σ⁴/((M-1)P) with the kurtosis of Poisson and
/// dark noise and the row noise, which does not average over a row. Levels beyond three deviations
/// are weighted down (Huber). Levels with the same dark frames have those frames' error in common,
/// which no number of levels averages out: generalised least squares. When the scatter is more than
/// sampling explains (χ² at the level of 1e-4), a constant variance is added to every level until
/// it is explained (Mandel and Paule, Anal. Chem. 42, 1970). A nonlinear sensor has another slope
/// without light: where the means' bend against the exposure (response_bend_per_dn) or that of the
/// variances, by a parabola at 3.6 standard errors, shows one, the difference is added to the
/// standard error in squares. Undecided: fewer than two usable levels, or a variance that does
/// not rise with the light.
Estimate<TransferFit> fit_photon_transfer(const std::vector<TransferLevel>& levels,
                                          const DarkPoint& dark);

}  // namespace malus
