#include "malus/calibrate/dark_point.h"

#include "malus/base/index.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

// Fourth moment over the squared second, minus the 3 of a normal distribution, of the residuals of
// dark pixels; those beyond the kept cells count as the last one. 0 where none are kept.
double dark_excess_kurtosis(int channel, const PhysicsCalibration& bias) {
  if (bias.residual_counts.size() <= as_index(channel)) return 0.0;
  const std::vector<double>& counts = bias.residual_counts[as_index(channel)];
  double samples = 0, second = 0, fourth = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    const double square = std::pow(static_cast<double>(i) + 0.5, 2);
    samples += counts[i];
    second += counts[i] * square;
    fourth += counts[i] * square * square;
  }
  return second > 0 ? samples * fourth / (second * second) - 3.0 : 0.0;
}

}  // namespace

DarkPoint dark_point(int channel, const MosaicGeometry& geometry, double variance_dn2,
                     const PhysicsCalibration& bias) {
  DarkPoint point;
  point.variance_dn2 = variance_dn2;
  point.row_variance_dn2 = std::pow(bias.sigma_row.mean[as_index(channel)], 2);
  point.pixels = geometry.channel_pixels(channel);
  point.row_groups = geometry.channel_groups(channel);
  const double pixel = std::max(point.variance_dn2 - point.row_variance_dn2, 0.0);
  point.fourth_cumulant_dn4 = dark_excess_kurtosis(channel, bias) * pixel * pixel;
  point.variance_stderr_dn2 = std::sqrt(variance_error_dn4(0.0, bias.bias_frames, point, 0.0));
  return point;
}

}  // namespace malus
