// What flat frames say against themselves and against the session, as warnings with numbers.
#pragma once

#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/internal/light_profile.h"
#include "malus/calibrate/internal/temporal_filter.h"
#include "malus/noise/calibration.h"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// The two largest codes of any number of pixels, with their counts.
class TopCodes {
 public:
  void add(float dn) {
    if (dn < next_) return;
    if (dn == largest_)
      ++at_largest_;
    else if (dn > largest_)
      next_ = largest_, at_next_ = at_largest_, largest_ = dn, at_largest_ = 1;
    else if (dn == next_)
      ++at_next_;
    else
      next_ = dn, at_next_ = 1;
  }
  /// Whether add() would count it.
  bool reaches(float dn) const { return dn >= next_; }
  bool empty() const { return at_largest_ == 0; }
  float largest() const { return largest_; }
  std::int64_t at_largest() const { return at_largest_; }
  std::int64_t at_next() const { return at_next_; }

 private:
  float largest_ = -1e30F, next_ = -1e30F;
  std::int64_t at_largest_ = 0, at_next_ = 0;
};

/// What one set of flats showed.
struct FlatObservation {
  std::string name;                     ///< of the set
  std::vector<std::string> sources;     ///< file of each frame that counts
  std::vector<std::string> unlike;      ///< and of those left out, whose light is another
  double unlike_dn = 0;                 ///< the first one's, above dark
  std::vector<double> signal_dn;        ///< above dark, mean over the channels: one per frame
  TopCodes codes;                       ///< of the pixels that are no defects
  std::int64_t pixels = 0;              ///< of all frames
  std::int64_t above_white = 0;         ///< of these, beyond the white level
  std::vector<double> code_spacing_dn;  ///< code_spacing per channel; 0: not known
  std::vector<double> code_step_dn;     ///< quantization_step per channel
  double variance_dn2 = 0;              ///< temporal, of the first channel; 0: not known
  double mean_variance_dn2 = 0;         ///< of all channels
  LightChange light;                    ///< inside the frame
  SuccessiveProducts successive;        ///< empty: not to be judged
};

/// Of one channel's dark frames.
struct ChannelCodes {
  std::string name;
  double step_dn = 0;     ///< of which all values are multiples; 0: not whole numbers
  double spacing_dn = 0;  ///< occupied_spacing; 0: not known
  std::optional<double> left_out_dn = {};  ///< left_out_code, as the files hold it
};

/// What they are judged by.
struct FlatReference {
  double dark_sd_dn = 0;   ///< temporal noise without light
  double frame_sd_dn = 0;  ///< of a frame's mean from frame to frame, without light
  int bias_frames = 0;
  double row_variance_dn2 = 0, column_variance_dn2 = 0;  ///< of rows and columns, without light
  double row_groups = 0;                                 ///< in the frame
  double step_dn = 0;                                    ///< of the codes; 0: not whole numbers
  std::vector<ChannelCodes> codes = {};                  ///< per channel
  double black_dn = 0, white_dn = 0;
};

/// Appends warnings to `out`: levels below the bias frames by more than half of the dark noise,
/// eight standard errors and a thousandth of a step; levels whose frames' light differs by more
/// than 10 % (and by more than the dark level does); levels with frames that were left out for
/// their light; levels of which more than a thousandth lies
/// above white; flats whose largest code is below white and holds more than 1 % of a level's pixels
/// and ten times as many as the next lower code; codes that lie farther apart in bright levels than
/// in others, where the rounding that this makes is more than 1 % of a level's variance; codes that
/// lie farther apart than their step everywhere (warn_of_scaled_codes); light that changes inside
/// the frames of a level by more than 1 % of its variance and six standard errors. True where
/// there was any to append.
[[nodiscard]] bool warn_of_flats(const std::vector<FlatObservation>& flats,
                                 const FlatReference& reference, PhysicsCalibration& out);

/// Appends a warning where a channel's codes lie farther apart than the step of which all are
/// multiples, by 2 % in the brighter half of the flats alike, or in the dark frames and in the
/// level where they are finest: values were multiplied after the conversion (white balance scales
/// some channels alone; the worst is told), or the converter leaves codes out. Not where the
/// rounding that this hides is below 0.1 % of the dark variance and the codes that do not occur lie
/// closer than two deviations of the dark noise. Else a warning where a code among a channel's dark
/// ones does not occur, though their noise is half a step wide or more: that bends what is measured
/// of it, however far away the next such code is. Reads temporal_sd_dark_dn.
void warn_of_scaled_codes(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                          PhysicsCalibration& out);

/// Appends a warning where the flats' noise correlates from a frame to the next by more than 0.005
/// and five standard errors, with what that takes off K: the camera's charge or files hold a share
/// of the frame before. Not where the dark frames have told so.
void warn_of_image_lag(const std::vector<FlatObservation>& flats, const SuccessiveFrames& dark,
                       PhysicsCalibration& out);

}  // namespace malus
