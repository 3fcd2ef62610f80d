// The mean of frames of one scene that stood still: what a camera that is read out several times
// tells of it. Its noise: noise/frame_mean.h.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/seen_frames.h"
#include "malus/image/view.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Mean of frames of one scene; memory does not grow with their number. Sums in double.
class FrameMean {
 public:
  /// Contract: all frames of one size.
  void add(View<const float> frame_dn);
  int count() const { return count_; }
  int rows() const { return sum_.rows(); }  ///< 0 before the first frame, as cols()
  int cols() const { return sum_.cols(); }
  /// Contract: count() > 0.
  Image mean() const;

 private:
  int count_ = 0;
  Plane<double> sum_;
};

/// The same of raw frames, with what they say of themselves.
class SceneMean {
 public:
  /// of_frames: how many will come, at least 2.
  explicit SceneMean(int of_frames);

  /// Throws InputError, which names the frame, where its size, layout, black, white, gain, exposure
  /// or kind of pixels is not the first one's, for a mean, and for a copy of a frame (SeenFrames):
  /// its noise does not average out.
  void add(const RawFrame& frame);

  /// All of them have come: floats with what the frames tell of themselves, black included; of
  /// floats that tell none it is 0, and known. A pixel that is saturated in more than a tenth of
  /// the frames is at white: of its mean the camera cut off too much.
  RawFrame take();

  /// Share of the picture where the first half of the frames and the second differ by more than
  /// noise, in places of 4x4 pixels or a cell beside others: scene or camera moved. Light that
  /// changed everywhere alike does not count. 0 of less than two frames.
  double changed_share() const;

 private:
  void begin(const RawFrame& frame);

  int of_frames_;
  RawFrame first_;  ///< without its pixels
  FrameMean pixels_;
  SeenFrames seen_;
  std::vector<std::uint32_t> saturated_;  ///< frames, per pixel; empty until one is
  int place_rows_ = 0, place_cols_ = 0;
  Plane<double> early_, late_;  ///< the halves' sums, per place
};

/// Throws InputError for a mean of frames, where the noise of one is worked on.
void require_single(const RawFrame& frame);

}  // namespace malus
