#include "malus/calibrate/frame_components.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"

#include <cmath>

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

void FrameAnalyzer::expect(const std::vector<OffsetSpread>& spread) {
  MALUS_REQUIRE(pattern_dn_ && static_cast<int>(spread.size()) == geometry_.channels());
  spread_ = spread;
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
  const double pattern_error =
                   (known.pixel_variance_dn2 + known.row_variance_dn2) * (1.0 - kept_) / kept_,
               row_error = known.pixel_variance_dn2 / ((group_pixels - 1.0) * kept_);
  const auto share = [](double prior, double error) {
    return error > 0 ? prior / (prior + error) : 1.0;
  };
  out.pattern = share(known.pattern_variance_dn2, pattern_error);
  out.row = share(known.row_variance_dn2, row_error);
  out.left_dn2 = out.pattern * pattern_error + out.row * row_error;
  out.reach_dn = kReach * std::sqrt(known.pattern_variance_dn2 + pattern_error);
  return out;
}

void FrameAnalyzer::fill_histograms(View<const float> dn, const Sums& sums,
                                    FrameComponents& out) const {
  constexpr std::size_t kDenseCells = 512;
  const auto channels = as_index(geometry_.channels());
  std::vector<std::vector<std::uint32_t>> dense(channels,
                                                std::vector<std::uint32_t>(kDenseCells, 0));
  std::vector<std::vector<std::int32_t>> beyond(channels);
  const double others = (1.0 - kept_) / kept_;  // 1 / (frames - 1); 0 without a pattern
  for (int r = 0; r < geometry_.rows(); ++r)
    for (int j = 0; j < geometry_.cell_cols(); ++j) {
      const int c = geometry_.channel(r, j);
      const std::size_t index = geometry_.group_index(r / geometry_.row_group(), c);
      const int n = geometry_.group_pixels(r / geometry_.row_group(), c);
      const Shares share = shares(c, n);
      if (n < 2) continue;
      // About the means of the other frames and the other pixels: independent of the pixel's own
      // noise. own: DN about the pattern and the frame's level; the other frames put the pattern at
      // own * others below.
      const double level = sums.mean[as_index(c)], cell = cell_dn_[as_index(c)],
                   of_row = share.row / ((n - 1.0) * kept_);
      const auto own_factor = static_cast<float>((1.0 + share.pattern * others + of_row) / cell),
                 left_factor = static_cast<float>((1.0 - share.pattern) / cell),
                 row_cells = static_cast<float>(of_row * (sums.group[index] - n * level) / cell),
                 mean = static_cast<float>(level), back = static_cast<float>(others),
                 reach = static_cast<float>(share.reach_dn),
                 centre = static_cast<float>(spread_.empty() ? 0 : spread_[as_index(c)].centre_dn);
      for (int col = j; col < geometry_.cols(); col += geometry_.cell_cols()) {
        const float known = pattern(r, col), own = dn(r, col) - known - mean, away = known - centre;
        // Hot, or hit by a value far out in the tail in another frame: no prior holds for it. Its
        // own value in this frame has no part in the choice.
        if (!spread_.empty() && std::abs(away - own * back) > reach) continue;
        const float cells = std::abs(own_factor * own + left_factor * away - row_cells);
        if (cells < static_cast<float>(kDenseCells))
          ++dense[as_index(c)][static_cast<std::size_t>(cells)];
        else
          beyond[as_index(c)].push_back(static_cast<std::int32_t>(std::min(cells, 1e9F)));
      }
    }
  for (std::size_t c = 0; c < channels; ++c) {
    out.residuals.emplace_back(cell_dn_[c]);
    out.residuals.back().assign(dense[c], beyond[c]);
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
