// Is the noise of neighbouring pixels alike? On a sensor it is not; in-camera smoothing,
// sharpening, demosaicking and compression make it so, and K and the read noise wrong.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"
#include "malus/noise/calibration.h"

#include <algorithm>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace malus {

/// Correlation of the temporal noise of two pixels of the mosaic that lie side by side.
struct NeighbourLikeness {
  std::string where;  ///< "in a row", "in a column of one channel", ...
  double correlation = 0;
  double standard_error = 0;  ///< from the products' own scatter: right for heavy tails, too
};

/// Sums over pairs of frames of one light level, of any number of levels. What rows and columns
/// share is taken out: row and column noise is no likeness.
class NeighbourCorrelation {
 public:
  explicit NeighbourCorrelation(const MosaicGeometry& geometry);
  /// Takes the pair's frames. dark_dn: per channel, above which the second frame is scaled to the
  /// first's light, by a tenth at most; empty: the frames are dark.
  void add(View<const float> first, View<const float> second, const std::vector<double>& dark_dn);
  /// Of the variance of the frames taken so far, the share that there is without light.
  void hold_dark_share(double share) { dark_ = share * lags_.front().count; }
  double dark_share() const { return dark_ / std::max(lags_.front().count, 1.0); }
  /// Adds the sums of other frames of the same geometry.
  void merge(const NeighbourCorrelation& other);
  /// Next pixels and next ones of the same channel, in rows and columns; without pairs all 0. What
  /// halves of rows share is no likeness either.
  std::vector<NeighbourLikeness> likeness() const;
  /// Of the variance of a pixel without its row's, what all pixels of the same half of the row
  /// share, and not those of the other half: a sensor whose halves are read out by an amplifier
  /// each. 0 where that is not told from chance, and from what changes evenly along the row.
  double shared_by_halves() const;

 private:
  struct Lag {
    int down = 0, right = 0;
    std::string where;
    double products = 0, squares = 0, count = 0;
  };
  Image difference(View<const float> first, View<const float> second,
                   const std::vector<double>& dark_dn) const;
  MosaicGeometry geometry_;
  std::vector<Lag> lags_;
  double dark_ = 0;  ///< dark share times pairs of pixels
  /// Products of the means of a row's four quarters, summed over rows: within halves, of the two
  /// beside the middle, of the two outer ones; squares of the difference of the first two.
  struct Quarters {
    double within = 0, middle = 0, outer = 0, squares = 0, rows = 0;
    void add(std::span<const float> row);
    void add(const Quarters& other);
  } quarters_;
};

/// Pairs the frames of one set as they come, no more than `most` pairs; memory holds one frame.
class FramePairs {
 public:
  /// dark_dn: as in NeighbourCorrelation::add. correlation must live as long.
  FramePairs(NeighbourCorrelation& correlation, std::vector<double> dark_dn, int most)
      : correlation_(correlation), dark_dn_(std::move(dark_dn)), left_(most) {}
  void add(View<const float> dn);

 private:
  NeighbourCorrelation& correlation_;
  std::vector<double> dark_dn_;
  int left_;
  Image waiting_;
};

/// Appends a warning where the halves of the rows of dark frames have noise of their own
/// (shared_by_halves), and one where neighbours correlate by more than 0.03 in flat frames or 0.1
/// in dark ones, and by five standard errors; the frames that show it most are named. Else where
/// light makes next pixels of flat frames alike by more than 0.008 and five standard errors, with
/// what that takes off K: the sum of a filter's correlations is what the variance lacks (Moore,
/// Ninkov, Forrest, Opt. Eng. 45, 2006). Shot noise is white on every sensor, but a read-out
/// amplifier's own noise need not be: -0.04 along the rows of the EMVA 1288 sample camera in the
/// dark, -0.01 in its light. Reads K.
void warn_of_alike_neighbours(const NeighbourCorrelation& dark, const NeighbourCorrelation& flat,
                              PhysicsCalibration& out);

}  // namespace malus
