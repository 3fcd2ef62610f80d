// What a flickering lamp leaves in flats whose frames are shifted to one mean and not scaled to it,
// as dim ones are: a frame of more light has more of its shading, too, and the pixels' temporal
// variance holds flicker² times the variance of the light over the frame.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/response.h"
#include "malus/calibrate/temporal.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

struct Flicker {
  std::vector<double> variance_dn2;    ///< per channel, in the pixels' temporal variance; 0: none
  std::vector<double> relative_light;  ///< per frame, over their mean; empty where none shows
};

/// The frames' light in sixteenths of their height and width, channel by channel.
class LampFlicker {
 public:
  /// dark_dn: per channel, black included; shading_dn: of the pixels about it, kept by the caller;
  /// left_out: pixels that tell nothing of the light.
  LampFlicker(const MosaicGeometry& geometry, std::vector<double> dark_dn,
              View<const float> shading_dn, const PixelPlaces& left_out);
  void add(View<const float> dn);
  /// temporal_dn2: variance of the pixels, per channel. A frame's light is told by how much of the
  /// shading it has, so that a black level that drifts is no light. Not where that scatters by less
  /// than ten times of what pixels and rows make of it (in even light nothing else is left, and to
  /// take it off would bias the variance), nor where the means do not change along: such rows
  /// drift.
  Flicker flicker(const std::vector<double>& temporal_dn2, const FrameRowNoise& rows) const;

 private:
  struct Channel;
  Channel channel(int c) const;
  double variance_dn2(int c, const Channel& own, double pixel_variance_dn2,
                      const FrameRowNoise& rows) const;
  std::size_t block(int channel, int r, int c) const;

  MosaicGeometry geometry_;
  std::vector<double> dark_dn_;
  View<const float> shading_dn_;
  PixelPlaces left_out_;
  std::vector<double> pixels_;             ///< per block
  std::vector<std::vector<double>> sums_;  ///< [frame][block], of the light of their pixels
};

}  // namespace malus
