// How many mosaic rows are read out together and share one draw of row noise (000, 3.2: two on
// IMX250MYR).
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/temporal.h"

#include <string>

namespace malus {

/// Variance of the rows' offsets over the frames, without what pixels alone lift the mean of a row
/// of this many columns by; negative by chance where there is none. temporal_variance_dn2: of a
/// pixel, its row's among it, averaged over channels. Contract: two frames or more.
struct RowVariance {
  double value_dn2 = 0, standard_error_dn2 = 0;
};
RowVariance row_variance_of(const RowLagAccumulator& rows, double temporal_variance_dn2, int cols);

/// Whether rows may be lifted by more than a twentieth of a pixel's noise, within three standard
/// errors: less than that changes nothing that a reader sees, whichever rows share it.
/// temporal_variance_dn2: as above.
bool row_noise_matters(const RowVariance& row, double temporal_variance_dn2);

/// Groups that can be told apart: 1 to 15 rows, starting at row 0.
/// row: of the same rows (row_variance_of).
/// Decides by the covariance of neighbouring rows' means over frames, for pairs inside and across
/// the groups, relative to the row noise itself: shared is what lies above the middle between
/// 1 and the smallest ratio (0, or what slow drift gives any two rows). Where a ratio is within
/// three standard errors of that middle, the group is 1 if no group of rows explains the ratios:
/// all alike, and below the 1 of rows that share everything. Undecided otherwise (row noise too
/// weak), and when the groups start on another row than the first (the frames were cropped).
Estimate<int> detect_row_group(const RowLagAccumulator& rows, const RowVariance& row);

/// What of the rows' noise speaks against groups of `declared` rows from row 0 on, for a warning;
/// empty where nothing does, or row noise is too weak. For groups that detect_row_group has not
/// found: where they start on another row than the first, and how many to crop. A pair of rows
/// inside the groups must share less than the middle between 1 and the least alike pairs of that
/// period, by three standard errors.
std::string contradiction_of_group(const RowLagAccumulator& rows, const RowVariance& row,
                                   int declared);

}  // namespace malus
