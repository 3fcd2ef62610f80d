// Per-pixel mean and temporal variance of any number of frames of one setting, in one pass and two
// planes of memory; and what each row shares with the rows after it.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <utility>
#include <vector>

namespace malus {

using PixelPlaces = std::vector<std::pair<int, int>>;  ///< (row, column), none twice

/// How frames are brought to one level before their temporal variance is taken: a drift of the
/// black level adds to every pixel, a flickering lamp multiplies.
enum class FrameAlignment { kAdditive, kMultiplicative };

/// Streaming mean and sum of squares per pixel (Welford) after aligning each frame's channel means
/// to the first frame's.
class TemporalAccumulator {
 public:
  /// dark_dn: one per channel, subtracted first, so that alignment scales light and not black.
  TemporalAccumulator(const MosaicGeometry& geometry, std::vector<double> dark_dn,
                      FrameAlignment alignment);
  void add(View<const float> dn);

  FrameAlignment alignment() const { return alignment_; }
  int frames() const { return frames_; }
  /// Mean of all frames' means above dark, per channel, DN.
  std::vector<double> mean_dn() const;
  /// The same without these pixels. shading_dn: of the pixels without light, about their channel's
  /// mean. Contract: the mean frame was not given away.
  std::vector<double> mean_dn(const PixelPlaces& left_out, View<const float> shading_dn) const;
  /// Sd of the frames' means from frame to frame, per channel; 0 for a single frame.
  std::vector<double> frame_deviation_dn() const;
  /// Each frame's means above those of all frames, DN: [frame][channel].
  std::vector<std::vector<double>> frame_drifts_dn() const;
  /// Unbiased temporal variance of a pixel about its own mean, averaged over the channel, frame
  /// means aligned; DN². Contract: at least two frames.
  std::vector<double> variance_dn2(const PixelPlaces& left_out = {}) const;
  /// Sum of squares of one pixel about its mean; the variance is this / (frames - 1).
  View<const float> sum_of_squares() const { return m2_; }
  /// Mean frame above dark, aligned to the first.
  View<const float> aligned_mean_dn() const { return mean_; }
  /// Gives the mean frame in DN above dark away: a large sensor's planes are not copied. Nothing
  /// may be added afterwards; means, variances and sums of squares stay.
  Image release_mean_frame_dn();
  /// One mean per frame and channel: [frame][channel].
  const std::vector<std::vector<double>>& frame_means_dn() const { return frame_means_; }

 private:
  MosaicGeometry geometry_;
  std::vector<double> dark_dn_;
  FrameAlignment alignment_;
  int frames_ = 0;
  Image mean_, m2_;
  std::vector<std::vector<double>> frame_means_;
};

/// Covariances over frames between the means of rows r and r + lag, lag 0..3, without storing rows.
class RowLagAccumulator {
 public:
  static constexpr int kLags = 4;
  explicit RowLagAccumulator(const MosaicGeometry& geometry);
  void add(View<const float> dn, const std::vector<double>& channel_means_dn);
  int frames() const { return frames_; }
  int rows() const { return geometry_.rows(); }
  int cols() const { return geometry_.cols(); }
  /// Covariance over frames in DN²; contract: at least two frames, 0 <= lag < kLags.
  double covariance_dn2(int row, int lag) const;

 private:
  MosaicGeometry geometry_;
  int frames_ = 0;
  std::vector<double> sum_, product_[kLags];
};

}  // namespace malus
