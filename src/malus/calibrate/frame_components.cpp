#include "malus/calibrate/internal/frame_components.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {
struct FrameAnalyzer::Sums {
  std::vector<double> group, column, square, mean;  ///< column: [cell row][col]; others by channel
};

FrameAnalyzer::FrameAnalyzer(const MosaicGeometry& geometry, std::vector<double> black_dn,
                             const Image* fixed_pattern_dn, int frames, std::vector<double> cell_dn)
    : geometry_(geometry),
      black_dn_(std::move(black_dn)),
      pattern_dn_(fixed_pattern_dn),
      kept_(!fixed_pattern_dn ? 1.0 : 1.0 - 1.0 / frames),
      cell_dn_(std::move(cell_dn)),
      pattern_mean_dn_(black_dn_),
      row_products_(geometry.channels()) {
  MALUS_REQUIRE(!pattern_dn_ || frames >= 2);
  if (pattern_dn_) pattern_mean_dn_ = channel_means(*pattern_dn_, geometry_);
}

float FrameAnalyzer::pattern(int row, int col) const {
  return !pattern_dn_ ? static_cast<float>(black_dn_[as_index(geometry_.channel(row, col))])
                      : (*pattern_dn_)(row, col);
}

FrameAnalyzer::Sums FrameAnalyzer::sum(View<const float> dn) const {
  const int channels = geometry_.channels(), cols = geometry_.cols();
  Sums s;
  s.group.assign(as_index(geometry_.groups() * channels), 0.0);
  s.column.assign(as_index(geometry_.cell_rows() * cols), 0.0);
  s.square.assign(as_index(channels), 0.0);
  s.mean.assign(as_index(channels), 0.0);
  std::vector<float> value(as_index(cols));
  for (int r = 0; r < geometry_.rows(); ++r) {
    const int phase = r % geometry_.cell_rows();
    const float* x = dn.row(r);
    for (int col = 0; col < cols; ++col) value[as_index(col)] = x[col] - pattern(r, col);
    double* column = &s.column[as_index(phase * cols)];
    for (int col = 0; col < cols; ++col) column[col] += value[as_index(col)];
    for (int j = 0; j < geometry_.cell_cols(); ++j) {
      double total = 0.0, square = 0.0;
      for (int col = j; col < cols; col += geometry_.cell_cols()) {
        const double v = value[as_index(col)];
        total += v;
        square += v * v;
      }
      const int c = geometry_.channel(r, j);
      s.group[geometry_.group_index(r / geometry_.row_group(), c)] += total;
      s.square[as_index(c)] += square;
      s.mean[as_index(c)] += total;
    }
  }
  for (int c = 0; c < channels; ++c)
    s.mean[as_index(c)] /= static_cast<double>(geometry_.channel_pixels(c));
  return s;
}

FrameComponents FrameAnalyzer::analyze(View<const float> dn) {
  const Sums s = sum(dn);
  const auto channels = as_index(geometry_.channels());
  FrameComponents out;
  out.mean_dn.resize(channels);
  out.pixel_variance_dn2.resize(channels);
  out.row_variance_dn2.resize(channels);
  out.column_variance_dn2.resize(channels);
  for (int c = 0; c < geometry_.channels(); ++c) {
    const double mean = s.mean[as_index(c)];
    const auto pixels = static_cast<double>(geometry_.channel_pixels(c));
    const int rows = geometry_.channel_rows(c), columns = geometry_.channel_cols(c);
    double group_square = 0, column_square = 0, inverse_count = 0;
    Moments group_means, column_means;
    for (int g = 0; g < geometry_.groups(); ++g) {
      const int n = geometry_.group_pixels(g, c);
      if (n == 0) continue;
      const double d = s.group[geometry_.group_index(g, c)] / n - mean;
      group_means.add(d);
      group_square += n * d * d;
      inverse_count += 1.0 / n;
    }
    const double* column = &s.column[as_index(c / geometry_.cell_cols() * geometry_.cols())];
    for (int col = c % geometry_.cell_cols(); col < geometry_.cols();
         col += geometry_.cell_cols()) {
      const double d = column[col] / rows - mean;
      column_means.add(d);
      column_square += rows * d * d;
    }
    const auto groups = static_cast<double>(group_means.count());
    const double left = s.square[as_index(c)] - pixels * mean * mean - group_square - column_square;
    const double pixel = left / (pixels - groups - (columns - 1));
    out.pixel_variance_dn2[as_index(c)] = pixel / kept_;
    out.row_variance_dn2[as_index(c)] =
        (group_means.variance() - pixel * inverse_count / groups) / kept_;
    out.column_variance_dn2[as_index(c)] = (column_means.variance() - pixel / rows) / kept_;
    out.mean_dn[as_index(c)] = mean + pattern_mean_dn_[as_index(c)] - black_dn_[as_index(c)];
  }
  for (int g = 0; g < geometry_.groups(); ++g) {
    double sum = 0;
    int pixels = 0;
    for (int c = 0; c < geometry_.channels(); ++c) {
      sum += s.group[geometry_.group_index(g, c)];
      pixels += geometry_.group_pixels(g, c);
    }
    out.row_offset_dn.push_back(sum / pixels);
  }
  add_row_covariance(s, out);
  fill_histograms(dn, s, out);
  return out;
}

void FrameAnalyzer::expect(const std::vector<OffsetSpread>& spread, Image constant) {
  MALUS_REQUIRE(pattern_dn_ && static_cast<int>(spread.size()) == geometry_.channels());
  spread_ = spread;
  constant_ = std::move(constant);
}

// What of a pixel's own mean over the other frames, and of its group's over the other pixels, is
// taken for its offset: prior variance over prior plus sampling variance (1 where nothing is
// known).
struct FrameAnalyzer::Shares {
  double pattern = 1, row = 1;
  double left_dn2 = 0;  ///< variance of the offset's error
  double reach_dn = 0;  ///< of ordinary pixels' means about the centre
};

FrameAnalyzer::Shares FrameAnalyzer::shares(int channel, int group_pixels) const {
  constexpr double kReach = 4.0;
  Shares out;
  if (spread_.empty()) return out;
  const OffsetSpread& known = spread_[as_index(channel)];
  const double others = (1.0 - kept_) / kept_;  // 1 / (frames - 1)
  const auto share = [](double prior, double error) {
    return error > 0 ? prior / (prior + error) : 1.0;
  };
  // Rows' noise in the mean of the other frames goes with the row's own, below.
  const double pattern_error = known.pixel_variance_dn2 * others;
  out.pattern = share(known.within_groups_dn2, pattern_error);
  const double left = out.pattern * pattern_error;
  // As does what of the rows' own pattern is not taken for the pixels'.
  const double fixed = known.pattern_variance_dn2 - known.within_groups_dn2,
               left_out = 1.0 - out.pattern;
  const double row = known.row_variance_dn2 * (1.0 + out.pattern * out.pattern * others) +
                     left_out * left_out * std::max(fixed, 0.0);
  const double row_error = (known.pixel_variance_dn2 + left) / (group_pixels - 1.0);
  out.row = share(row, row_error);
  out.left_dn2 = left + out.row * row_error;
  out.reach_dn = kReach * std::sqrt(known.pattern_variance_dn2 +
                                    (known.pixel_variance_dn2 + known.row_variance_dn2) * others);
  return out;
}

// Residuals of one group's pixels about their own offsets (the pattern's) before what they have in
// common is taken off, row by row; NaN where no offset is known. Sums and counts by channel.
struct FrameAnalyzer::GroupResiduals {
  std::vector<float> value_dn;
  std::vector<double> sum_dn;
  std::vector<int> count;
};

void FrameAnalyzer::fill_group(View<const float> dn, const Sums& sums, int group,
                               GroupResiduals& out) const {
  const double others = (1.0 - kept_) / kept_;  // 1 / (frames - 1); 0 without a pattern
  const int begin = group * geometry_.row_group();
  const int end = std::min(begin + geometry_.row_group(), geometry_.rows());
  out.value_dn.assign(as_index((end - begin) * geometry_.cols()), 0.0F);
  out.sum_dn.assign(as_index(geometry_.channels()), 0.0);
  out.count.assign(as_index(geometry_.channels()), 0);
  for (int r = begin; r < end; ++r)
    for (int j = 0; j < geometry_.cell_cols(); ++j) {
      const int c = geometry_.channel(r, j);
      const Shares share = shares(c, geometry_.group_pixels(group, c));
      // own: DN about the pattern and the frame's level. The other frames, which the pixel's own
      // noise is no part of, put the pattern at own * others below.
      const auto own_factor = static_cast<float>(1.0 + share.pattern * others),
                 left_factor = static_cast<float>(1.0 - share.pattern),
                 mean = static_cast<float>(sums.mean[as_index(c)]),
                 back = static_cast<float>(others), reach = static_cast<float>(share.reach_dn),
                 centre = static_cast<float>(spread_.empty() ? 0 : spread_[as_index(c)].centre_dn);
      float* value = &out.value_dn[as_index((r - begin) * geometry_.cols())];
      for (int col = j; col < geometry_.cols(); col += geometry_.cell_cols()) {
        const float known = pattern(r, col), own = dn(r, col) - known - mean, away = known - centre;
        // Hot, or hit by a value far out in the tail in another frame: no prior holds for it. Its
        // own value in this frame has no part in the choice.
        if (!spread_.empty() && (std::abs(away - own * back) > reach ||
                                 (!constant_.empty() && constant_(r, col) > 0))) {
          value[col] = std::numeric_limits<float>::quiet_NaN();
          continue;
        }
        value[col] = own_factor * own + left_factor * away;
        out.sum_dn[as_index(c)] += value[col];
        ++out.count[as_index(c)];
      }
    }
}

void FrameAnalyzer::fill_histograms(View<const float> dn, const Sums& sums,
                                    FrameComponents& out) const {
  constexpr std::size_t kDenseCells = 512;
  const auto channels = as_index(geometry_.channels());
  std::vector<std::vector<std::uint32_t>> dense(channels,
                                                std::vector<std::uint32_t>(kDenseCells, 0));
  std::vector<std::vector<std::uint32_t>> dense_above = dense;
  std::vector<std::vector<std::int32_t>> beyond(channels), beyond_above(channels);
  GroupResiduals group;
  for (int r = 0; r < geometry_.rows(); ++r) {
    const int g = r / geometry_.row_group(), first = g * geometry_.row_group();
    if (r == first) fill_group(dn, sums, g, group);
    const float* value = &group.value_dn[as_index((r - first) * geometry_.cols())];
    for (int j = 0; j < geometry_.cell_cols(); ++j) {
      const auto c = as_index(geometry_.channel(r, j));
      if (group.count[c] < 2) continue;
      // The row's offset is that of the group's other pixels about the same estimates of theirs,
      // so that what rows left in the mean of the frames goes with it.
      const double cell = cell_dn_[c],
                   of_row =
                       shares(static_cast<int>(c), geometry_.group_pixels(g, static_cast<int>(c)))
                           .row /
                       (group.count[c] - 1.0);
      const auto own_cells = static_cast<float>((1.0 + of_row) / cell),
                 row_cells = static_cast<float>(of_row * group.sum_dn[c] / cell);
      for (int col = j; col < geometry_.cols(); col += geometry_.cell_cols()) {
        if (std::isnan(value[col])) continue;
        const float residual = own_cells * value[col] - row_cells, cells = std::abs(residual);
        if (cells < static_cast<float>(kDenseCells)) {
          ++dense[c][static_cast<std::size_t>(cells)];
          dense_above[c][static_cast<std::size_t>(cells)] += residual > 0;
        } else {
          beyond[c].push_back(static_cast<std::int32_t>(std::min(cells, 1e9F)));
          if (residual > 0) beyond_above[c].push_back(beyond[c].back());
        }
      }
    }
  }
  for (std::size_t c = 0; c < channels; ++c) {
    out.residuals.emplace_back(cell_dn_[c]);
    out.residuals.back().assign(dense[c], beyond[c]);
    out.residuals_above.emplace_back(cell_dn_[c]);
    out.residuals_above.back().assign(dense_above[c], beyond_above[c]);
  }
}

void FrameAnalyzer::add_row_covariance(const Sums& sums, const FrameComponents& components) {
  const int channels = geometry_.channels();
  ++analyzed_;
  for (int a = 0; a < channels; ++a) {
    row_products_(a, a) += components.row_variance_dn2[as_index(a)];
    for (int b = 0; b < a; ++b) {
      double product = 0.0;
      int groups = 0;
      for (int g = 0; g < geometry_.groups(); ++g) {
        const int na = geometry_.group_pixels(g, a), nb = geometry_.group_pixels(g, b);
        if (na == 0 || nb == 0) continue;
        product += (sums.group[geometry_.group_index(g, a)] / na - sums.mean[as_index(a)]) *
                   (sums.group[geometry_.group_index(g, b)] / nb - sums.mean[as_index(b)]);
        ++groups;
      }
      if (groups < 2) continue;
      row_products_(a, b) += product / (groups - 1) / kept_;
      row_products_(b, a) = row_products_(a, b);
    }
  }
}

SquareMatrix FrameAnalyzer::row_covariance_dn2() const {
  SquareMatrix mean = row_products_;
  for (double& value : mean.values) value /= std::max(analyzed_, 1);
  return mean;
}

double FrameAnalyzer::offset_variance_dn2(int channel, double pixel_variance_dn2) const {
  if (!spread_.empty())
    return shares(channel, static_cast<int>(geometry_.pixels_per_group(channel))).left_dn2;
  const double kept = (1.0 - 1.0 / geometry_.pixels_per_group(channel)) * kept_;
  return pixel_variance_dn2 * (1.0 / kept - 1.0);
}

}  // namespace malus
