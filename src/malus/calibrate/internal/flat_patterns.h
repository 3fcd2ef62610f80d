// What the pixels of a gain's flat levels show: their response, and whether neighbours are alike.
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/internal/dark_current.h"
#include "malus/calibrate/internal/flat_level.h"
#include "malus/calibrate/internal/matching_dark.h"
#include "malus/calibrate/internal/neighbour_correlation.h"
#include "malus/calibrate/internal/response.h"

#include <string>
#include <vector>

namespace malus {

/// Response is measured above this share of the range, where shot noise is small against the
/// signal.
inline constexpr double kResponseShare = 0.2;

struct FlatPatterns {
  explicit FlatPatterns(const MosaicGeometry& geometry)
      : response(geometry), neighbours(geometry) {}
  ResponseAccumulator response;
  NeighbourCorrelation neighbours;
  std::vector<ResponseLevel> of_response;

  /// Adds a level and takes its mean frame. good: which channels count for K in it; each one's
  /// response is that of its own bright levels, for in coloured or polarized light another may be
  /// at white before this one is. Neighbours are of several channels: they are taken of levels that
  /// are good in all.
  void add(const FrameFormat& format, const FrameSet& flat, FlatLevel& level,
           const MatchingDark& dark, const std::vector<bool>& good);
  /// Why PRNU is not known: which channels have no bright level, and why bright ones do not count
  /// (refused; empty: there are none).
  std::string response_missing(const FrameFormat& format, const std::string& refused) const;
};

}  // namespace malus
