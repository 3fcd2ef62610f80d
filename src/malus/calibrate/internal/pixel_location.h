// Where a channel's ordinary pixels lie, whatever its defects are.
#pragma once

#include "malus/base/statistics.h"
#include "malus/calibrate/geometry.h"

#include <numeric>
#include <vector>

namespace malus {

/// Robust deviations beyond which a pixel counts as a defect.
inline constexpr double kDefectDeviations = 8.0;

/// Median and robust deviation.
struct PixelLocation {
  double centre = 0, deviation = 0;
};

/// The least that PixelLocation shows of values on a lattice of this step.
inline double least_shown_deviation(double step) { return 0.5 * step / kMedianOfNormal; }

/// value(row, col) of the pixels of one channel; of every k-th pixel of a large channel, which say
/// as much as all. k shares no divisor with the number of columns, so that pixels of all columns
/// are among them.
template <class Value>
std::vector<double> enough_of(const MosaicGeometry& geometry, int channel, const Value& value) {
  constexpr std::int64_t kEnough = 100000;
  auto step = static_cast<int>(1 + geometry.channel_pixels(channel) / kEnough);
  while (std::gcd(step, geometry.channel_cols(channel)) > 1) ++step;
  std::vector<double> values;
  int index = 0;
  for_channel(geometry, channel, [&](int, int, int row, int col) {
    if (index++ % step == 0) values.push_back(value(row, col));
  });
  return values;
}

/// Of those.
template <class Value>
PixelLocation location_of(const MosaicGeometry& geometry, int channel, const Value& value) {
  const std::vector<double> values = enough_of(geometry, channel, value);
  return {median_of(values), robust_deviation_of(values)};
}

}  // namespace malus
