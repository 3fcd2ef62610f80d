// The Gaussian posterior of the row groups' offsets, given second differences between rows.
#pragma once

#include "malus/denoise/row_noise.h"
#include "malus/noise/row_drift.h"

#include <vector>

namespace malus {

/// How a row's mean second difference stands to the groups' offsets: offset[group] minus half of
/// offset[above] and offset[below], in units of the channels' sigma_row. texture: the part of the
/// variance that is not the pixels' noise.
struct RowEvidence {
  int group, above, below;
  double value, variance;
  double texture = 0;
};

/// Mean and deviations of offsets that are each drawn from N(0, 1) and drift like this, given the
/// evidence with these variances in place of its own. The deviations are the whole posterior's:
/// slow waves over many groups, which second differences hardly see, are part of them.
RowNoise row_posterior(const std::vector<RowEvidence>& evidence,
                       const std::vector<double>& variance, int groups, const RowDrift& drift);

}  // namespace malus
