#include "malus/calibrate/internal/fixed_pattern.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/line_means.h"
#include "malus/calibrate/internal/pixel_location.h"
#include "malus/calibrate/internal/row_drift_fit.h"
#include "malus/noise/row_drift.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {
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
  const double least = least_shown_deviation(quantization_dn);
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const PixelLocation level =
        location_of(geometry, channel, [&](int r, int c) { return mosaic(r, c); });
    const double deviation = std::max(level.deviation, least);
    const double bound =
        deviation > 0 ? kDefectDeviations * deviation : std::numeric_limits<double>::infinity();
    Moments moments, squares;
    LineMeans rows(geometry.channel_rows(channel)), cols(geometry.channel_cols(channel)),
        groups(geometry.groups());
    for_channel(geometry, channel, [&](int r, int c, int row, int col) {
      if (is_listed(row, col) || std::abs(mosaic(row, col) - level.centre) > bound) return;
      moments.add(mosaic(row, col));
      rows.add(r, mosaic(row, col) - level.centre);
      cols.add(c, mosaic(row, col) - level.centre);
      groups.add(row / geometry.row_group(), mosaic(row, col) - level.centre);
      if (!squares_dn2.empty()) squares.add(squares_dn2(row, col));
    });
    if (!squares_dn2.empty()) out.squares_dn2.push_back(squares.mean());
    out.mean_dn.push_back(moments.mean());
    out.variance_dn2.push_back(moments.variance());
    out.variance_stderr_dn2.push_back(moments.variance_standard_error());
    out.row_variance_dn2.push_back(rows.variance(moments.variance()));
    out.column_variance_dn2.push_back(cols.variance(moments.variance()));
    out.within_groups_dn2.push_back(groups.within(moments.variance()));
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

// What row and column noise leave in a mean frame.
double rows_left_dn2(const PhysicsCalibration& bias, std::size_t c) {
  return std::pow(bias.sigma_row.mean[c], 2) / bias.bias_frames;
}
double columns_left_dn2(const PhysicsCalibration& bias, std::size_t c) {
  return std::pow(bias.sigma_column.mean[c], 2) / bias.bias_frames;
}

}  // namespace

double line_error_dn4(double row_dn2, double column_dn2, const MosaicGeometry& geometry,
                      int channel, const RowDrift& drift) {
  const int groups = geometry.channel_groups(channel);
  const double of_drift = drift_of_variances(drift, groups, geometry.group_stride(channel), 0);
  return 2.0 * row_dn2 * row_dn2 * (1.0 + of_drift) / (groups - 1.0) +
         2.0 * column_dn2 * column_dn2 / (geometry.channel_cols(channel) - 1.0);
}

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
    const double error_dn4 =
        std::pow(mean_frame.variance_stderr_dn2[c], 2) +
        line_error_dn4(std::max(rows_left_dn2(out, c), mean_frame.row_variance_dn2[c]),
                       std::max(columns_left_dn2(out, c), mean_frame.column_variance_dn2[c]),
                       geometry, channel, out.row_drift.drift) +
        temporal_error_dn2 * temporal_error_dn2;
    out.dsnu_stderr_dn.push_back(root_standard_error(
        mean_frame.variance_dn2[c] - temporal_variance_dn2[c] / frames, std::sqrt(error_dn4)));
  }
}

std::vector<double> pattern_error_of_mean(const OrdinaryPixels& mean_frame,
                                          const MosaicGeometry& geometry,
                                          const PhysicsCalibration& bias) {
  std::vector<double> error_dn2;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const auto c = as_index(channel);
    const double all = std::pow(bias.dsnu_dn[c], 2),
                 rows =
                     std::clamp(mean_frame.row_variance_dn2[c] - rows_left_dn2(bias, c), 0.0, all),
                 columns = std::clamp(mean_frame.column_variance_dn2[c] - columns_left_dn2(bias, c),
                                      0.0, all - rows);
    error_dn2.push_back(
        (all - rows - columns) / static_cast<double>(geometry.channel_pixels(channel)) +
        rows / geometry.channel_rows(channel) + columns / geometry.channel_cols(channel));
  }
  return error_dn2;
}

}  // namespace malus
