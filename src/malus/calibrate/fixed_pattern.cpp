#include "malus/calibrate/fixed_pattern.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/pixel_location.h"
#include "malus/calibrate/row_drift_fit.h"
#include "malus/noise/row_drift.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {
namespace {

// The least that a median shows of values on a lattice.
double least_deviation(double step_dn) { return 0.5 * step_dn / kMedianOfNormal; }

// Standard normal equivalent of a χ² variable over its degrees of freedom (Wilson and Hilferty).
double chi_square_deviation(double ratio, double freedom) {
  const double a = 2.0 / (9.0 * freedom);
  return (std::cbrt(ratio) - (1.0 - a)) / std::sqrt(a);
}

// Chances that the heaviest of a pixel's values alone explains what it shows: of a heavy-tailed sum
// the tail is that of its largest term (Chistyakov, Theory Probab. Appl. 9, 1964). No variance of a
// variance serves here: below λ = -1/4 there is none.
class SingleValue {
 public:
  SingleValue(const ReadTail& tail, int frames) : tail_(tail), frames_(frames) {}
  /// Of a mean this far above the others' or farther.
  double above_mean(double difference_dn) const { return beyond(difference_dn * frames_); }
  /// Of a sum of squares this far above the others' or farther; the pixel's own mean moves along.
  double above_squares(double difference_dn2) const {
    return 2.0 * beyond(std::sqrt(std::max(difference_dn2, 0.0) / (1.0 - 1.0 / frames_)));
  }

 private:
  double beyond(double value_dn) const {
    return tail_.scale_dn > 0 ? frames_ * tukey_lambda_cdf(-value_dn / tail_.scale_dn, tail_.lambda)
                              : 0.0;
  }
  ReadTail tail_;
  int frames_;
};

}  // namespace

std::vector<double> channel_variances(View<const float> mosaic, const MosaicGeometry& geometry) {
  const std::vector<double> mean = channel_means(mosaic, geometry);
  std::vector<double> variance(mean.size(), 0.0);
  for (int r = 0; r < mosaic.rows(); ++r)
    for (int col = 0; col < mosaic.cols(); ++col) {
      const auto c = as_index(geometry.channel(r, col));
      const double d = mosaic(r, col) - mean[c];
      variance[c] += d * d;
    }
  for (int c = 0; c < geometry.channels(); ++c)
    variance[as_index(c)] /= static_cast<double>(geometry.channel_pixels(c) - 1);
  return variance;
}

OrdinaryPixels ordinary_pixels(View<const float> mosaic, double quantization_dn,
                               const MosaicGeometry& geometry,
                               const std::vector<DefectPixel>& listed,
                               View<const float> squares_dn2) {
  OrdinaryPixels out;
  auto next = listed.begin();
  const auto is_listed = [&](int r, int c) {
    const bool is = next != listed.end() && next->row == r && next->col == c;
    if (is) ++next;
    return is;
  };
  const double least = least_deviation(quantization_dn);
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const PixelLocation level =
        location_of(geometry, channel, [&](int r, int c) { return mosaic(r, c); });
    const double deviation = std::max(level.deviation, least);
    const double bound =
        deviation > 0 ? kDefectDeviations * deviation : std::numeric_limits<double>::infinity();
    Moments moments, squares;
    for_channel(geometry, channel, [&](int, int, int row, int col) {
      if (is_listed(row, col) || std::abs(mosaic(row, col) - level.centre) > bound) return;
      moments.add(mosaic(row, col));
      if (!squares_dn2.empty()) squares.add(squares_dn2(row, col));
    });
    if (!squares_dn2.empty()) out.squares_dn2.push_back(squares.mean());
    out.mean_dn.push_back(moments.mean());
    out.variance_dn2.push_back(moments.variance());
    out.variance_stderr_dn2.push_back(moments.variance_standard_error());
  }
  return out;
}

std::vector<double> temporal_of(const OrdinaryPixels& ordinary, int frames) {
  MALUS_REQUIRE(frames >= 2);
  std::vector<double> variance = ordinary.squares_dn2;
  for (double& v : variance) v /= frames - 1.0;
  return variance;
}

void subtract_levels(Image& mosaic_dn, const std::vector<double>& level_dn,
                     const MosaicGeometry& geometry) {
  for (int r = 0; r < mosaic_dn.rows(); ++r)
    for (int col = 0; col < mosaic_dn.cols(); ++col)
      mosaic_dn(r, col) -= static_cast<float>(level_dn[as_index(geometry.channel(r, col))]);
}

std::vector<double> dsnu_dn(std::vector<double> spatial_variance_dn2,
                            const std::vector<double>& temporal_variance_dn2, int frames) {
  for (std::size_t c = 0; c < spatial_variance_dn2.size(); ++c)
    spatial_variance_dn2[c] =
        std::sqrt(std::max(spatial_variance_dn2[c] - temporal_variance_dn2[c] / frames, 0.0));
  return spatial_variance_dn2;
}

namespace {

// Sampling variance that the rows and columns of a mean frame add to the spatial variance of a
// channel's pixels: there are fewer of them than of pixels.
double line_error_dn4(const MosaicGeometry& geometry, int channel, const PhysicsCalibration& out) {
  const auto c = as_index(channel);
  const int groups = geometry.channel_groups(channel);
  const double row = std::pow(out.sigma_row.mean[c], 2) / out.bias_frames,
               column = std::pow(out.sigma_column.mean[c], 2) / out.bias_frames;
  const double drift =
      drift_of_variances(out.row_drift.drift, groups, geometry.group_stride(channel), 0);
  return 2.0 * row * row * (1.0 + drift) / (groups - 1.0) +
         2.0 * column * column / (geometry.channel_cols(channel) - 1.0);
}

}  // namespace

void measure_dsnu(const OrdinaryPixels& mean_frame,
                  const std::vector<double>& temporal_variance_dn2, const MosaicGeometry& geometry,
                  PhysicsCalibration& out) {
  const int frames = out.bias_frames;
  out.dsnu_dn = dsnu_dn(mean_frame.variance_dn2, temporal_variance_dn2, frames);
  out.dsnu_stderr_dn.clear();
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const auto c = as_index(channel);
    const double temporal_error_dn2 =
        2.0 * out.temporal_sd_dark_dn[c] * out.temporal_sd_dark_stderr_dn[c] / frames;
    const double error_dn4 = std::pow(mean_frame.variance_stderr_dn2[c], 2) +
                             line_error_dn4(geometry, channel, out) +
                             temporal_error_dn2 * temporal_error_dn2;
    out.dsnu_stderr_dn.push_back(root_standard_error(
        mean_frame.variance_dn2[c] - temporal_variance_dn2[c] / frames, std::sqrt(error_dn4)));
  }
}

namespace {

// What a channel's ordinary pixels show in the dark.
struct UsualPixel {
  PixelLocation level;
  double squares;        // sum over the frames
  bool constancy_tells;  // a pixel that never changes is none of them
};

UsualPixel usual_pixel(const DarkPixels& dark, const MosaicGeometry& geometry, int channel,
                       double chance) {
  UsualPixel usual{
      location_of(geometry, channel, [&](int r, int c) { return dark.shading_dn(r, c); }),
      location_of(geometry, channel, [&](int r, int c) { return dark.sum_of_squares(r, c); })
          .centre,
      dark.constancy[as_index(channel)] < chance};
  if (usual.constancy_tells) return usual;
  usual.level.deviation = std::max(usual.level.deviation, least_deviation(dark.step_dn));
  // A mean between two codes gives half of the values either.
  usual.squares = std::max(usual.squares, (dark.frames - 1) * dark.step_dn * dark.step_dn / 4.0);
  return usual;
}

}  // namespace

std::vector<DefectPixel> find_defects(const DarkPixels& dark, View<const float> response,
                                      const MosaicGeometry& geometry) {
  constexpr double kNoisyRatio = 4.0, kDeadBelow = 0.5;
  constexpr double kExpectedByChance = 0.05;  // of all the channel's pixels
  // Aligning the frames' means moves even a pixel that never changes a little.
  constexpr double kStuckRatio = 0.02;
  constexpr int kStuckNeedsFrames = 20;
  const int frames = dark.frames;
  std::vector<DefectPixel> defects;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const double chance = kExpectedByChance / static_cast<double>(geometry.channel_pixels(channel));
    const UsualPixel usual = usual_pixel(dark, geometry, channel, chance);
    const SingleValue single(dark.tails[as_index(channel)], frames);
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      if (defects.size() >= kMostDefects) return;
      const double above = dark.shading_dn(r, c) - usual.level.centre;
      const double squares = dark.sum_of_squares(r, c);
      const double hot = usual.level.deviation > 0 ? above / usual.level.deviation : 0.0;
      const double ratio = usual.squares > 0 ? squares / usual.squares : 1.0;
      const double noisy = frames >= 2 ? chi_square_deviation(ratio, frames - 1.0) : 0.0;
      const bool dead = !response.empty() && response(r, c) < kDeadBelow;
      if (frames >= kStuckNeedsFrames && usual.constancy_tells && ratio < kStuckRatio &&
          (dead || response.empty()))
        defects.push_back({r, c, "stuck", noisy});
      else if (dead)
        defects.push_back({r, c, "dead", response(r, c)});
      else if (hot > kDefectDeviations && single.above_mean(above) < chance)
        defects.push_back({r, c, "hot", hot});
      else if (noisy > kDefectDeviations && ratio > kNoisyRatio &&
               single.above_squares(squares - usual.squares) < chance)
        defects.push_back({r, c, "noisy", noisy});
    });
  }
  return defects;
}

std::vector<double> temporal_excess_dn2(const DarkPixels& dark,
                                        const std::vector<DefectPixel>& defects,
                                        const MosaicGeometry& geometry) {
  MALUS_REQUIRE(dark.frames >= 2);
  const std::vector<double> all = channel_means(dark.sum_of_squares, geometry);
  std::vector<double> listed(all.size(), 0.0), count(all.size(), 0.0), excess;
  for (const DefectPixel& defect : defects) {
    const auto c = as_index(geometry.channel(defect.row, defect.col));
    listed[c] += dark.sum_of_squares(defect.row, defect.col);
    count[c] += 1.0;
  }
  for (std::size_t c = 0; c < all.size(); ++c) {
    const auto pixels = static_cast<double>(geometry.channel_pixels(static_cast<int>(c)));
    const double others =
        count[c] < pixels ? (all[c] * pixels - listed[c]) / (pixels - count[c]) : all[c];
    excess.push_back((all[c] - others) / (dark.frames - 1.0));
  }
  return excess;
}

}  // namespace malus
