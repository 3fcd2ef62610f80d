// What one row of the mosaic tells of the row groups' offsets: its mean second difference to the
// rows of the same channels above and below, and how far that is to be trusted.
#pragma once

#include "malus/denoise/internal/row_posterior.h"
#include "malus/image/view.h"
#include "malus/noise/profile.h"

#include <optional>
#include <vector>

namespace malus {

/// The row against the rows this many periods of the layout away; dn and saturated_dn as in
/// estimate_row_noise. Nothing where those lie outside of the frame, or no pixel can be compared.
std::optional<RowEvidence> row_evidence(View<const float> dn, const NoiseProfile& profile,
                                        const std::vector<float>& saturated_dn, int row,
                                        int periods);

/// The same of the place where most pixels of the row lie: a camera lifts all of them, and those
/// that stand out from the others (windows at night, letters) are the picture's. reach: the
/// deviations from that place at which a pixel has no influence. The variance is that of the pixels
/// that have.
std::optional<RowEvidence> evidence_of_most(View<const float> dn, const NoiseProfile& profile,
                                            const std::vector<float>& saturated_dn, int row,
                                            int periods, double reach);

}  // namespace malus
