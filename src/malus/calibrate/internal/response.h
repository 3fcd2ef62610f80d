// Relative response of the pixels, PRNU (EMVA 1288, section 8), from flat frames.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/temporal.h"
#include "malus/image/view.h"
#include "malus/noise/row_drift.h"

#include <map>
#include <vector>

namespace malus {

struct Response {
  /// Relative to the light: a polynomial of the place, and the surroundings (at most 15x15 pixels
  /// of the same channel) relative to that, so that uneven light and vignetting do not count;
  /// mean 1.
  Image map;
  /// Sd of the map per channel, sampling error removed, of the pixels within kDefectDeviations
  /// robust deviations of the median: a few defects would be most of it.
  std::vector<double> prnu;
  std::vector<double> prnu_stderr;
  /// Mean signal per channel that it was measured at, each level by its weight.
  std::vector<double> level_dn = {};
  /// And DarkReference::darkless_s over the signal.
  std::vector<double> darkless_s_per_dn = {};
};

/// The dark frames that belong to a flat level.
struct DarkReference {
  View<const float> shading_dn;   ///< their mean frame minus its channels' means
  std::vector<double> error_dn2;  ///< per channel, variance of the error of one of its pixels
  std::vector<double> doubt_dn2;  ///< standard error of that
  int set = 0;                    ///< levels of one set have this error in common
  int frames = 1;
  double darkless_s = 0;  ///< the flat's exposure less theirs; 0 if it is the same
};

/// Square of one level's PRNU, from differences of neighbours of one channel.
struct LevelResponse {
  double variance = 0, standard_error = 0;
};

/// Rows and columns of the sensor that see less than kUnlitShare of the light: masked ones. None
/// where a channel sees none.
struct UnlitLines {
  std::vector<int> rows, cols;  ///< rising, from 0
};

/// Row noise of flats and dark frames alike.
struct FrameRowNoise {
  std::vector<double> sigma_dn;  ///< per channel
  RowDrift drift;
};

/// Relative response of every pixel, from any number of flat levels weighted by their precision.
class ResponseAccumulator {
 public:
  explicit ResponseAccumulator(const MosaicGeometry& geometry);
  /// Takes the flat's mean frame. left_out: pixels that are part of the map alone. used: per
  /// channel; empty: all. Contract: two frames or more.
  LevelResponse add(TemporalAccumulator& flat, const DarkReference& dark,
                    const PixelPlaces& left_out = {}, const std::vector<bool>& used = {});
  /// Channels of which no level was added.
  std::vector<int> channels_without() const;
  /// Contract, of both: channels_without() is empty.
  Response response(const FrameRowNoise& rows) const;
  UnlitLines unlit_lines() const;

 private:
  struct SharedDark {
    std::vector<double> scale, error_dn2, doubt_dn2;  ///< per channel; scale: sum over the levels
    int frames = 1;
  };
  Image with_unlit_lines() const;  ///< left_out_
  double row_noise_left_over(int channel, const Image& light, const FrameRowNoise& rows) const;
  MosaicGeometry geometry_;
  Image sum_;
  Image left_out_;                   ///< above 0; empty: no pixel is
  Image error_;                      ///< sampling variance of sum_ that the flats make
  std::map<int, SharedDark> darks_;  ///< by set
  /// Per channel, sums over the levels.
  std::vector<double> weight_, weighted_mean_dn_, weighted_s_per_dn_;
  std::vector<double> per_row_noise_;  ///< variance of sum_ for one of row noise in each flat
  std::vector<bool> seen_;             ///< per channel
};

}  // namespace malus
