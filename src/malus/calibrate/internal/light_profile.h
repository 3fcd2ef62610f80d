// Whether the light of a flat changes inside the frame from frame to frame. Mains flicker under a
// rolling shutter makes it, and a lamp that moves; frames are brought to one mean, so what changes
// inside them stays in the pixels' temporal variance, and counts in K.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/temporal.h"
#include "malus/image/view.h"

#include <vector>

namespace malus {

/// Rows and columns that see less than this share of the frame's mean light are masked ones.
inline constexpr double kUnlitShare = 0.05;

/// What light that changes from frame to frame adds to a pixel's temporal variance; row and column
/// noise included, but not in the standard errors, which are those of the pixels' noise.
struct LightChange {
  double rows_dn2 = 0, rows_stderr_dn2 = 0;        ///< light that changes down the frame
  double columns_dn2 = 0, columns_stderr_dn2 = 0;  ///< and across it
  int row_bands = 0, column_bands = 0;             ///< that were compared
};

/// The frame's light in bands of rows and of columns, frame by frame: kilobytes.
class LightProfile {
 public:
  /// dark_dn: per channel, black included.
  LightProfile(const MosaicGeometry& geometry, std::vector<double> dark_dn);
  void add(View<const float> dn);
  /// variance_dn2: temporal, mean over the channels: what of the bands' scatter is that of their
  /// pixels. alignment: how the variance's frames were brought to one mean; the bands are brought
  /// to it alike. Dim frames are not scaled: their light is lost in its own error, and scaled by it
  /// the noise of constant light was told to change by thousands of per cent. relative_light: a
  /// lamp's flicker (Flicker), of which the bands of frames that are not scaled have their shares;
  /// empty: none. All 0 from fewer than two frames, and of scaled frames without light.
  LightChange change(double variance_dn2, FrameAlignment alignment,
                     const std::vector<double>& relative_light = {}) const;

 private:
  struct Bands {
    std::vector<double> pixels;                ///< of each
    std::vector<std::vector<double>> sums_dn;  ///< [frame][band], of the light of their pixels
  };
  /// Variance from frame to frame of one band's mean light, once frames have one mean.
  double band_variance_dn2(const Bands& bands, std::size_t band, FrameAlignment alignment,
                           const std::vector<double>& relative_light) const;
  bool is_lit(const Bands& bands, std::size_t band) const;
  /// lit: bands that count, added up.
  double excess_dn2(const Bands& bands, double variance_dn2, FrameAlignment alignment,
                    const std::vector<double>& relative_light, double& standard_error_dn2,
                    int& lit) const;
  double all_pixels() const { return static_cast<double>(geometry_.rows()) * geometry_.cols(); }
  const MosaicGeometry geometry_;
  std::vector<double> dark_dn_;
  Bands rows_, columns_;
  std::vector<double> frame_sums_dn_;  ///< light of all pixels, per frame
  double light_ = 0;                   ///< sum over the frames
};

}  // namespace malus
