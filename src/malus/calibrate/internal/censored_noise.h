// Dark noise of which the camera cuts off more than its mirror image tells (cut_off_noise.h): from
// what shows of it, as a Tukey-lambda distribution (000 Eq. 3).
#pragma once

namespace malus {

/// What dark pixels show.
struct ShownNoise {
  double mean_dn = 0;       ///< above the floor
  double variance_dn2 = 0;  ///< of all pixels and frames together, rounding in it
  double zero_share = 0;    ///< at the floor
  double step_dn = 0;       ///< of the codes; 0: none
  double samples = 1;
};

/// The distribution that shows this when it is cut off at the floor and rounded: the three numbers
/// tell mean, deviation and shape. Standard errors are those of independent samples.
struct CensoredNoise {
  double mean_dn = 0, mean_stderr_dn = 0;            ///< above the floor
  double variance_dn2 = 0, variance_stderr_dn2 = 0;  ///< without rounding
  double lambda = 0, lambda_stderr = 0;
  double slope = 1;  ///< share of a small change of the mean that shows
  bool known = false;
};

/// Beyond this share of zeros, next to nothing of the distribution's middle shows.
inline constexpr double kMostCensoredZeros = 0.75;

/// Not known where more is cut off, the deviation is below 1.25 steps, or no shape shows it.
CensoredNoise find_censored_noise(const ShownNoise& shown);

}  // namespace malus
