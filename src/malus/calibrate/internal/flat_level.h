// What the frames of one light level show, in one pass over them.
#pragma once

#include "malus/calibrate/internal/flat_checks.h"
#include "malus/calibrate/internal/gain_map.h"
#include "malus/calibrate/internal/gain_run.h"
#include "malus/calibrate/internal/matching_dark.h"
#include "malus/calibrate/internal/neighbour_correlation.h"
#include "malus/calibrate/internal/response.h"
#include "malus/calibrate/temporal.h"

#include <vector>

namespace malus {

struct FlatLevel {
  TemporalAccumulator temporal;
  NeighbourCorrelation neighbours;
  std::vector<double> saturated,
      at_zero;  ///< shares of the pixels at white and at the floor, per channel
  /// Temporal, frame means aligned, without left_out and without what a lamp's flicker makes of
  /// uneven light; per channel. Empty of a single frame.
  std::vector<double> variance_dn2;
  /// Defects without light (MatchingDark), and those at white in any frame by their own dark
  /// current. They tell nothing of the light. Line by line.
  PixelPlaces left_out;
  FlatObservation seen;
  GainBlocks gains;
};

/// dark: what belongs to these flats without light. Frames whose light differs from the median's by
/// more than half, and more than the dark level does, are left out (FlatObservation::unlike) where
/// two or more remain and they are the most; the others are read again then. Errors as
/// for_each_frame.
FlatLevel measure_level(const GainRun& run, const FrameSet& flat, const MatchingDark& dark,
                        const FrameRowNoise& rows);

/// Variance of frames that had all been of their mean light, DN². Scaling a frame by a, to that
/// mean, makes a times of its shot noise what such a frame has, and a² times of the noise without
/// light.
double steady_variance_dn2(const TemporalAccumulator& temporal, std::size_t channel, double mean_dn,
                           double variance_dn2, double dark_variance_dn2);

}  // namespace malus
