// Whether a camera mixes a frame with the one before (temporal noise reduction, image lag): their
// noise is alike then, and less than the sensor's.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"
#include "malus/noise/calibration.h"

#include <utility>
#include <vector>

namespace malus {

/// Sums over the pixels of triples of successive frames. Of differences d1, d2 of three frames, the
/// mean of d1 d2 over that of their squares is -(1 - ρ)/2 for noise whose correlation from a frame
/// to the next is ρ and falls off as ρ, ρ², ...
struct SuccessiveProducts {
  double products = 0, squares = 0;
  double product2 = 0, cross = 0, square2 = 0;  ///< of these: squares and product
  double pixels = 0;
  double changed = 0;  ///< of them, those whose value is not the same in all three frames

  void merge(const SuccessiveProducts& other);
  /// The same of products and squares times a number each.
  SuccessiveProducts scaled(double of_products, double of_squares) const;
  /// ρ, and its standard error from the products' own scatter; both 0 where nothing is known.
  double correlation() const;
  double standard_error() const;
};

/// Looks at a few triples of successive frames of one level in the dark; memory holds two frames.
class SuccessiveFrames {
 public:
  explicit SuccessiveFrames(const MosaicGeometry& geometry) : geometry_(geometry) {}
  void add(View<const float> dn);
  double correlation() const { return sum_.correlation(); }
  double standard_error() const { return sum_.standard_error(); }
  /// Whether enough pixels change to tell: of a few, what they happen to do alike has no scatter.
  bool tells() const;
  /// The middle of the triples' correlations, the lower one of two: no single odd frame moves it.
  double middle_correlation() const;

 private:
  MosaicGeometry geometry_;
  Image first_, second_;
  SuccessiveProducts sum_;
  std::vector<double> of_triple_;  ///< correlations
};

/// The same of flats, each scaled to the light of the first one, channel by channel.
class SuccessiveFlats {
 public:
  /// dark_dn: per channel, black included; shading_dn: of the pixels about it, kept by the caller.
  SuccessiveFlats(const MosaicGeometry& geometry, std::vector<double> dark_dn,
                  View<const float> shading_dn)
      : geometry_(geometry), dark_dn_(std::move(dark_dn)), shading_dn_(shading_dn) {}
  /// light_dn: the frame's means above dark, per channel. Frames after one without light are not
  /// looked at.
  void add(View<const float> dn, const std::vector<double>& light_dn);
  /// In units of the mean square, so that levels count by their pixels. A frame of less light has
  /// more noise when it is scaled up: its shot noise grows as the scale, the rest as its square.
  /// shot_share: of the temporal variance, 0 ... 1.
  SuccessiveProducts products(double shot_share) const;

 private:
  struct Triple {
    SuccessiveProducts sum;
    std::vector<double> scale;  ///< of its three frames
  };
  MosaicGeometry geometry_;
  std::vector<double> dark_dn_;
  View<const float> shading_dn_;
  std::vector<double> first_light_dn_;
  std::vector<Image> waiting_;
  std::vector<double> scales_;
  std::vector<Triple> triples_;
  bool lit_ = true;
};

/// Whether successive dark frames correlate by more than 0.1 and eight standard errors, of pixels
/// enough to tell, and half of their triples by more than 0.1: beside one frame of much noise all
/// else is alike.
bool mixes_frames(const SuccessiveFrames& dark);

/// Appends a warning where they do: of frames that are mixed, or that drift.
void warn_of_temporal_filter(const SuccessiveFrames& dark, PhysicsCalibration& out);

}  // namespace malus
