// What a denoiser must know of the noise at one gain, whatever kind of model it came from.
#pragma once

#include "malus/image/layout.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/noise_law.h"
#include "malus/noise/row_drift.h"
#include "malus/noise/variance_curve.h"

#include <algorithm>
#include <memory>
#include <optional>
#include <vector>

namespace malus {

struct ChannelProfile {
  VarianceCurve variance;      ///< of single pixels, without rows
  double bias_dn = 0;          ///< mean of dark pixels above the black level
  double sigma_row_dn = 0;     ///< sd of the row groups' offsets
  double sigma_column_dn = 0;  ///< sd of the columns' offsets; 0 where the variance holds them
  double gain_dn_per_e = 0;    ///< 0 when not known
  /// Of the variance, what is not sure to be there: where a converter's step hides the dark noise,
  /// that is a guess [DN²].
  double guessed_dn2 = 0;
  /// Distribution of the pixels about signal and bias; none: NoiseLaw::gaussian(variance).
  std::optional<NoiseLaw> law = std::nullopt;
  NoiseLaw distribution() const { return law ? *law : NoiseLaw::gaussian(variance); }
};

/// Pixels that do not tell the light, by their place in a frame of the whole sensor.
struct DefectList {
  int rows = 0, cols = 0;  ///< of such a frame; 0: not known, and then there are no places
  struct Place {
    int row = 0, col = 0;
  };
  std::vector<Place> places;
};

struct NoiseProfile {
  SensorLayout layout;
  std::vector<ChannelProfile> channels;  ///< one per channel of the layout
  int row_group = 1;                     ///< mosaic rows that share one draw of row noise
  RowDrift row_drift = {};               ///< what these draws have in common
  /// The converter's step, whose rounding the channels' variances hold; 0: none, or not known.
  double step_dn = 0;
  bool estimated_from_picture = false;  ///< no model was given
  /// Bias and dark variance are those of dark frames that the camera cut off at 0; between two
  /// gains, of either.
  bool dark_was_cut_off = false;
  DefectList defects;
  /// Taken out of frames of its size as far as they show it; null: none is known. Models give it
  /// where it is asked for (fixed_pattern_at), since it is as large as a frame.
  std::shared_ptr<const FixedPattern> pattern = nullptr;

  bool has_column_noise() const {
    return std::any_of(channels.begin(), channels.end(),
                       [](const ChannelProfile& channel) { return channel.sigma_column_dn > 0; });
  }

  /// For pixels that hold no bias, or shall keep it.
  void clear_bias() {
    for (ChannelProfile& channel : channels) channel.bias_dn = 0;
  }
};

}  // namespace malus
