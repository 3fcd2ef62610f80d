// Whether a camera mixes a frame with the one before (temporal noise reduction): their noise is
// alike then, and less than the sensor's.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"
#include "malus/noise/calibration.h"

namespace malus {

/// Looks at a few triples of successive frames of one level in the dark; memory holds two frames.
class SuccessiveFrames {
 public:
  explicit SuccessiveFrames(const MosaicGeometry& geometry) : geometry_(geometry) {}
  void add(View<const float> dn);
  /// Correlation of a pixel's noise in a frame with that in the next, and its standard error from
  /// the products' own scatter; both 0 where nothing is known. Of differences d1, d2 of three
  /// frames, the mean of d1 d2 over that of their squares is -(1 - ρ)/2 for noise whose correlation
  /// falls off as ρ, ρ², ...
  double correlation() const;
  double standard_error() const;

 private:
  void use(View<const float> third);
  MosaicGeometry geometry_;
  Image first_, second_;
  int triples_ = 0;
  double products_ = 0, squares_ = 0;
  double product2_ = 0, cross_ = 0, square2_ = 0;  ///< sums of their squares and product
};

/// Appends a warning where successive dark frames correlate by more than 0.1 and eight standard
/// errors.
void warn_of_temporal_filter(const SuccessiveFrames& dark, PhysicsCalibration& out);

}  // namespace malus
