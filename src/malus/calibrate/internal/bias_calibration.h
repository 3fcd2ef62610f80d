// Everything that one gain's bias frames tell: level, row, column and read noise (000, 3.2).
#pragma once

#include "malus/calibrate/internal/cut_off_noise.h"
#include "malus/calibrate/internal/defects.h"
#include "malus/calibrate/internal/flat_checks.h"
#include "malus/calibrate/internal/frame_components.h"
#include "malus/calibrate/internal/gain_run.h"
#include "malus/calibrate/internal/neighbour_correlation.h"
#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/calibrate/internal/temporal_filter.h"
#include "malus/calibrate/temporal.h"

#include <vector>

namespace malus {

/// First pass over the bias frames: fixed pattern and temporal variance.
struct DarkPass {
  TemporalAccumulator temporal;
  RowLagAccumulator rows;
  std::vector<double> floor_dn;  ///< per channel: where noise is cut off, code 0 or the lowest one
  /// floor_dn in codes as the files hold them, of frames that were moved to another black level.
  std::vector<double> floor_code_dn;
  std::vector<double> zero_share;  ///< per channel: share of pixels there
  std::vector<double> constancy;   ///< per channel: EqualValues::chance_of_constancy
  NeighbourCorrelation neighbours;
  std::vector<HiddenNoise> hidden;  ///< per channel, by measure_bias; empty of a single frame
  SuccessiveFrames successive;
  double step_dn = 0;  ///< of the codes as the files hold them; 0: not whole numbers
  std::vector<ChannelCodes> codes = {};
  /// Per channel, by measure_bias; empty of a single frame and where single_frame is set.
  std::vector<CutOffNoise> cut_off = {};
  std::vector<FarthestValue> farthest = {};  ///< by measure_bias
  /// By measure_bias: the drift may be the row group's, which is not known, or chance. Errors hold
  /// it, but the model should not.
  bool doubtful_drift = false;
};

/// To judge its pixels by; shading_dn: the mean frame, from any level of each channel.
DarkPixels dark_pixels(const DarkPass& dark, View<const float> shading_dn);

/// step_dn: quantization_step of the bias set's first frame. The row group need not be known.
DarkPass measure_dark(const GainRun& run, double step_dn);

/// Second pass: takes every frame apart and fills mu, sigma_row, row_drift (white unless the fixed
/// pattern was removed; see doubtful_drift), sigma_column, sigma_tl, lambda, temporal_sd_dark,
/// dsnu, dark_shading, row_correlation, bias_frames and warnings of `out`. Takes the mean frame of
/// `dark`.
void measure_bias(const GainRun& run, DarkPass& dark, PhysicsCalibration& out);

}  // namespace malus
