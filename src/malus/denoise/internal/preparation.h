// What all denoising methods share before and after the filter.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/noise/stabilize.h"

#include <cstdint>
#include <vector>

namespace malus::internal {

/// An input pixel that is not a number, to be put back.
struct NonfinitePixel {
  int row, col;
  float value;
};

struct PreparedFrame {
  Image dn;  ///< above black and bias, row noise removed, every pixel finite
  SensorLayout layout;
  double saturated_dn = 0;  ///< above black; pixels at least this bright are not trusted
  std::vector<NonfinitePixel> nonfinite;
  std::vector<double> mean_dn;  ///< per channel
};

/// Fills the report's fields about the input.
PreparedFrame prepare(RawFrame frame, const NoiseProfile& profile, bool remove_rows,
                      Denoised& report);

/// One per channel; strength multiplies the deviation.
std::vector<Stabilizer> make_stabilizers(const NoiseProfile& profile, double highest_dn,
                                         double strength);

}  // namespace malus::internal
