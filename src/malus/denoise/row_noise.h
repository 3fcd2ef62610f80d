// Row noise (banding): all pixels of a row group are lifted by one draw, scaled by their channel's
// sigma_row. The draws are estimated together by a Gaussian posterior: the model's prior says how
// large they can be, vertical second differences between rows of the same channels say how a row
// stands out from its neighbours, and the spread of that along the row says how much of it is the
// picture. Rows that stand out by more than the model allows are taken for picture and left alone;
// where rows do so all over the frame (level stripes, blinds), all offsets are held back; where
// they follow each other as a picture's do, in a part of the frame too, what they follow is
// (row_stripes.h).
#pragma once

#include "malus/denoise/saturated_pixels.h"
#include "malus/image/view.h"
#include "malus/noise/profile.h"

#include <optional>
#include <vector>

namespace malus {

struct RowNoise {
  std::vector<double> offset;  ///< per row group, in units of the channels' sigma_row
  /// Posterior deviation, same unit; 1 where nothing is known or offsets are held back.
  std::vector<double> deviation;
};

/// dn: mosaic in DN above black and bias; pixels that are not finite or at least their channel's
/// saturated_dn take no part. All offsets are 0 where the profile has no row noise.
RowNoise estimate_row_noise(View<const float> dn, const NoiseProfile& profile,
                            const std::vector<float>& saturated_dn);

/// Subtracts sigma_row * offset from every pixel that is not saturated.
void remove_row_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& rows,
                      const SaturatedPixels& saturated);

/// Variance of the row groups' offsets as the frame shows it, in units of the channels' sigma_row²:
/// the spread of second differences beyond what pixel noise and the picture explain; may be
/// negative. Too few rows: nothing is shown.
struct ShownRowVariance {
  double value = 0, error = 0;
};
std::optional<ShownRowVariance> shown_row_variance(View<const float> dn,
                                                   const NoiseProfile& profile,
                                                   const std::vector<float>& saturated_dn);

/// Fills sigma_row_dn (equal for all channels) and row_group (1 or 2) of a profile that knows only
/// the pixel noise, from the picture's rows: the spread of their second differences beyond what
/// pixel noise and the picture explain, in most pixels of the rows alike. 0 where in doubt, for a
/// picture's lines that are taken out cost far more than offsets that stay: when that is less than
/// three times its own error or more than twice the pixels' deviation, and where the rows repeat or
/// resemble their neighbours as a camera's do not.
void estimate_row_deviation(View<const float> dn, const std::vector<float>& saturated_dn,
                            NoiseProfile& profile);

}  // namespace malus
