// The model's fixed pattern in a frame: how much of it there is, and taking it out.
#pragma once

#include "malus/denoise/saturated_pixels.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/noise/profile.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace malus {

/// A factor of a part of a map, with its standard error.
struct PatternShare {
  double most = 1;     ///< that a frame of this sensor can have
  bool grows = false;  ///< with exposure and temperature; else a sensor's frame holds the part once
  double kept = 1;     ///< FixedPattern's, of this part
  double value = 0;
  double stderr_value = std::numeric_limits<double>::infinity();
  /// Told from chance, so that taking it out can only help.
  bool present() const { return value > 0.1 && value > 4 * stderr_value && value * kept < most; }
  /// How often the part is to be taken out. More than once may be but the noise of a frame that the
  /// map was made of, and that would take outliers, which hold little of it, out too often.
  double taken() const {
    if (!present()) return 0;
    return value <= 1 ? value : grows ? std::max(value * kept, 1.0) : 1;
  }
};

/// The shares of a map's pixels and of its columns.
struct PatternShares {
  PatternShare pixels, columns;
  /// The pixels' own; once where the frame tells no difference from that. The share is told by what
  /// pixels differ by, and a glow that goes with them is many times that.
  double pixels_taken() const {
    const double own = pixels.taken();
    return own > 0 && std::abs(own - 1) < 2 * pixels.stderr_value ? 1 : own;
  }
  /// The columns' own where it contradicts that of the pixels; else that, if it is not told from
  /// chance, and if it is, what lies next to it between 1, which the same converters have in every
  /// frame, and the pixels': it is told by differences of neighbours, but is that of smooth shading
  /// too.
  double columns_taken() const {
    const double all = pixels_taken(), own = columns.taken();
    const bool agree = std::abs(columns.value - all) < 4 * columns.stderr_value;
    if (!agree) return own;
    return columns.present() ? std::clamp(own, std::min(all, 1.0), std::max(all, 1.0)) : all;
  }
  /// For the record: the pixels' where it counts.
  double taken() const { return pixels.present() ? pixels_taken() : columns_taken(); }
};

/// Pixels respond the same in every frame; dark signal grows with exposure and temperature.
struct MeasuredPattern {
  PatternShares dark{{.most = 10, .grows = true}, {.most = 10, .grows = true}};
  PatternShares response{{.most = 2}, {.most = 2}};
};

/// d and r of  dn = (1 + r (response - 1)) s + d dark + noise  for an unknown scene s, the maps'
/// columns with shares of their own. A pixel's
/// difference from the mean of its two neighbours in the row is compared with the same difference
/// of the maps, by least squares with Cauchy weights (Holland and Welsch, Commun. Stat. A6, 1977)
/// about as wide as half of the differences, which is wider than the noise in texture: the scene's
/// edges have little weight. So a frame of the calibrated camera has shares near one,
/// a synthetic frame without a pattern or one of another camera near zero, and a longer exposure
/// than that of the dark frames more than one. The standard errors are those of leaving out
/// eighths of the rows or of the columns, whichever are larger: both scenes and maps have
/// stripes. Where fewer than a tenth of the pixels lie within three deviations of their noise from
/// what the shares say, as in a chart of bars, none can be told and both are zero. dn_above_black:
/// every pixel finite; pixels at least as bright as saturated_dn (per channel) take no part.
/// Contract: maps are empty or of the frame's size.
MeasuredPattern measure_pattern(View<const float> dn_above_black, const SensorLayout& layout,
                                const NoiseProfile& profile,
                                const std::vector<float>& saturated_dn);

/// Takes out what is to be taken of both maps; saturated pixels stay.
void remove_pattern(Image& dn_above_black, const SensorLayout& layout, const FixedPattern& pattern,
                    const MeasuredPattern& shares, const SaturatedPixels& saturated);

}  // namespace malus
