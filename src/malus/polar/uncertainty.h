// How far to trust Stokes parameters, DoLP and AoLP: propagation of the variances of the four
// intensities, and DoLP with its bias removed.
#pragma once

#include "malus/image/shared_offsets.h"
#include "malus/polar/stokes.h"

#include <string>

namespace malus {

/// Covariance of (S0, S1, S2) of one pixel, in the intensities' unit squared.
struct StokesCovariance {
  double s0s0 = 0, s1s1 = 0, s2s2 = 0, s0s1 = 0, s0s2 = 0, s1s2 = 0;
};

/// Of intensities with these variances and every two of them correlated by `shared`; S is linear in
/// them, so this is exact. A difference of two loses to the correlation no more than what both
/// have: beside a far larger error nothing cancels.
StokesCovariance stokes_covariance(double v0, double v45, double v90, double v135,
                                   double shared = 0);

/// Variance of DoLP, to first order and never more than the square of the largest error there can
/// be: light has a DoLP of 0 to 1, so that is 1, or DoLP itself where noise makes it more. NaN
/// where DoLP is undefined. Where S1 = S2 = 0 it has no gradient: there the mean over all
/// directions, (Var S1 + Var S2) / (2 S0²).
double dolp_variance(const Stokes& s, const StokesCovariance& covariance);

/// What the four intensities are: kMeasured, samples whose noise is independent, has mean zero and
/// lengthens (S1, S2), see corrected_dolp; kDenoised, estimates of a filter, whose errors are
/// correlated and shorten it, see expected_dolp.
enum class Intensities { kMeasured, kDenoised };

/// Mean squared error of AoLP in deg² on its circle of 180 degrees, over the truths that may be
/// behind such a vector (polar/internal/angle_error.h): to first order where (S1, S2) is far above
/// its noise, and never more than that of an angle that nothing is known of, 180²/12; NaN where
/// S0 <= 0. Exact where the noise is the same in all directions, within a quarter of the deviation
/// where its variance along one is twice that across.
double aolp_variance_deg2(const Stokes& s, const StokesCovariance& covariance,
                          Intensities intensities);

inline constexpr double kUnknownAngleVarianceDeg2 = 180.0 * 180.0 / 12.0;

/// DoLP without its positive (Rician) bias: the modified asymptotic estimator
/// p - b² (1 - exp(-p²/b²)) / (2p), b² the variance of (S1, S2)/S0 across the direction of
/// polarization; never negative, 0 where DoLP is 0, NaN where it is undefined. (Plaszczynski,
/// Montier, Levrier, Tristram, MNRAS 439, 4048, 2014, arXiv 1312.0437.)
double corrected_dolp(const Stokes& s, const StokesCovariance& covariance);

/// The mean of DoLP where (S1, S2) lies about its estimate with the stated error: an estimate that
/// a filter made has lost polarization that it could not tell from noise, so the truth's mean
/// length is that of a Rice distribution (Rice, Bell Syst. Tech. J. 24, 1945, eq. 4.2-3) about it.
/// Not lifted above 1; NaN where DoLP is undefined.
double expected_dolp(const Stokes& s, const StokesCovariance& covariance);

/// Variance planes of one colour, sizes as the Stokes planes.
struct StokesUncertainty {
  Image s0_variance, s1_variance, s2_variance;  ///< DN²
  Image dolp_sd;                                ///< 1
  Image aolp_sd_deg;
  Image dolp_corrected;
};

/// variance: planes of the four intensities' variances in DN². Measured intensities are
/// independent; the errors of denoised ones are correlated, which the variances take into account.
/// Where one of the four is not finite, as of a saturated pixel, deviations and corrected DoLP are
/// NaN.
StokesUncertainty propagate(const StokesPlanes& stokes, const AnglePlanes& variance,
                            Intensities intensities);

/// Variances come from files and arrays: throws InputError, naming the source and the first pixel
/// of a channel, where one is negative. NaN is legal: of saturated pixels none is known.
void require_variances(const Planes& packed_variance, const SensorLayout& layout,
                       const std::string& source);

/// As stokes_per_color, for packed planes of variances (image/pack.h): a colour with several sites
/// of one angle has the variance of their mean. Errors of such sites are independent where they are
/// measured, and correlated after a filter.
std::vector<StokesUncertainty> uncertainty_per_color(const std::vector<StokesPlanes>& stokes,
                                                     const Planes& packed_variance,
                                                     const SensorLayout& layout,
                                                     Intensities intensities);

/// The same after merge_greens: green has the variance of the mean of both greens. offsets: what
/// the variances hold of row and column noise, which pixels of one line have in common: in S0 it
/// adds up, in S1 and S2 it cancels where all four share their group of lines.
std::vector<StokesUncertainty> uncertainty_of(const StokesPicture& picture,
                                              const Planes& packed_variance,
                                              const SensorLayout& layout, Intensities intensities,
                                              const SharedOffsets& offsets = {});

/// Of the mean of the picture's colours (mean_stokes), as DoLP and AoLP pictures show it: not the
/// mean of the colours' own deviations, for the angles of the colours may differ, and noise
/// averages out.
StokesUncertainty uncertainty_of_mean(const StokesPicture& picture, const Planes& packed_variance,
                                      const SensorLayout& layout, Intensities intensities,
                                      const SharedOffsets& offsets = {});

}  // namespace malus
