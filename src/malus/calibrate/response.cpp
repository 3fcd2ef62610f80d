#include "malus/calibrate/internal/response.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/line_means.h"
#include "malus/calibrate/internal/pixel_location.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace malus {
namespace {

constexpr int kLargestRadius = 7;

// A small plane needs a small window, or the curve of the light shows in it.
int largest_radius(const MosaicGeometry& geometry, int channel) {
  return std::clamp(std::min(geometry.channel_rows(channel), geometry.channel_cols(channel)) / 8, 1,
                    kLargestRadius);
}

// Windows shrink towards a border so that they stay centred: a slope in the light then cancels.
int window_radius(int at, int length, int largest) {
  return std::min({at, length - 1 - at, largest});
}

double window_width(int at, int length, int largest) {
  return 2.0 * window_radius(at, length, largest) + 1.0;
}

// What is left of white noise when the mean of a window of n pixels, its own among them, is taken
// off: 1 - 1/n. 0 in corners.
double kept_variance(int r, int c, const MosaicGeometry& geometry, int channel) {
  const int largest = largest_radius(geometry, channel);
  return 1.0 - 1.0 / (window_width(r, geometry.channel_rows(channel), largest) *
                      window_width(c, geometry.channel_cols(channel), largest));
}

// The same of what whole lines (rows or columns) have in common, of which a window of w lines holds
// its own w-th part.
double kept_of_line(int at, int length, int largest) {
  return 1.0 - 1.0 / window_width(at, length, largest);
}

// Means over rectangular windows of one channel by sums over rectangles. Pixels that are left out
// (by mosaic row and column) are in no window. One that would hold next to none, as in a corner, is
// a 3x3 one, centred or not.
class WindowMean {
 public:
  template <class LeftOut>
  WindowMean(View<const float> mosaic, const MosaicGeometry& geometry, int channel,
             const LeftOut& left_out)
      : rows_(geometry.channel_rows(channel)),
        cols_(geometry.channel_cols(channel)),
        largest_radius_(largest_radius(geometry, channel)) {
    sums_.assign(as_index(rows_ + 1) * as_index(cols_ + 1), {});
    for_channel(geometry, channel, [&](int r, int c, int row, int col) {
      const bool used = !left_out(row, col);
      Sum& own = sum(r + 1, c + 1);
      own.value = (used ? double{mosaic(row, col)} : 0.0) + sum(r, c + 1).value +
                  sum(r + 1, c).value - sum(r, c).value;
      own.pixels = (used ? 1 : 0) + sum(r, c + 1).pixels + sum(r + 1, c).pixels - sum(r, c).pixels;
    });
  }
  struct Sum {
    double value = 0;
    int pixels = 0;
    double mean() const { return pixels > 0 ? value / pixels : 0.0; }
  };
  Sum around(int r, int c) {
    constexpr int kFewest = 3;
    const int down = window_radius(r, rows_, largest_radius_),
              right = window_radius(c, cols_, largest_radius_);
    const Sum window = within(r, c, down, right);
    return window.pixels >= kFewest ? window : within(r, c, std::max(down, 1), std::max(right, 1));
  }

 private:
  Sum& sum(int r, int c) { return sums_[as_index(r) * as_index(cols_ + 1) + as_index(c)]; }
  Sum within(int r, int c, int down, int right) {
    const int r0 = std::max(r - down, 0), r1 = std::min(r + down + 1, rows_);
    const int c0 = std::max(c - right, 0), c1 = std::min(c + right + 1, cols_);
    const Sum &a = sum(r0, c0), &b = sum(r0, c1), &d = sum(r1, c0), &e = sum(r1, c1);
    return {e.value - b.value - d.value + a.value, e.pixels - b.pixels - d.pixels + a.pixels};
  }
  int rows_, cols_, largest_radius_;
  std::vector<Sum> sums_;
};

// Pixels that a first map shows to be none of the ordinary ones. A defect would be a good part of
// its neighbours' window, at the border a third of it, and most of a channel's variance: such
// pixels are no part of the next map's windows, nor of the variance.
class Outstanding {
 public:
  /// left_out: further such pixels, above 0; may be empty.
  explicit Outstanding(View<const float> left_out) : left_out_(left_out) {}
  bool holds(int row, int col) const {
    if (!left_out_.empty() && left_out_(row, col) > 0) return true;
    return usual_.deviation > 0 &&
           std::abs(before_(row, col) - usual_.centre) > kDefectDeviations * usual_.deviation;
  }
  void find(const Image& map, const MosaicGeometry& geometry, int channel) {
    if (before_.empty()) before_ = Image(map.rows(), map.cols());
    for_channel(geometry, channel,
                [&](int, int, int row, int col) { before_(row, col) = map(row, col); });
    usual_ = location_of(geometry, channel, [&](int r, int c) { return map(r, c); });
  }

 private:
  View<const float> left_out_;
  Image before_;
  PixelLocation usual_;
};

// Polynomials of degree 0, 1, ... that are orthonormal over 0 ... length - 1: [degree][at].
std::vector<std::vector<double>> orthonormal_polynomials(int length, int degree) {
  std::vector<std::vector<double>> basis;
  for (int d = 0; d <= degree; ++d) {
    std::vector<double> next(as_index(length));
    for (int i = 0; i < length; ++i)
      next[as_index(i)] = std::pow(2.0 * i / std::max(length - 1, 1) - 1.0, d);
    const auto product = [&](const std::vector<double>& other) {
      return std::inner_product(next.begin(), next.end(), other.begin(), 0.0);
    };
    for (const std::vector<double>& lower : basis) {
      const double part = product(lower);
      for (std::size_t i = 0; i < next.size(); ++i) next[i] -= part * lower[i];
    }
    const double norm = std::sqrt(product(next));
    for (double& value : next) value /= norm;
    basis.push_back(std::move(next));
  }
  return basis;
}

// A channel's light as a polynomial of the place, of degree 4 in all on planes that are large
// enough: vignetting, a lamp to one side. Where light curves, a window's mean is not the light in
// its middle. Fitted by least squares; value(row, col) of the mosaic.
template <class Value>
void fit_light(const MosaicGeometry& geometry, int channel, const Value& value, Image& light) {
  constexpr int kDegree = 4, kPixelsPerDegree = 8;
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel);
  const int degree = std::min(std::min(rows, cols) / kPixelsPerDegree, kDegree);
  const auto down = orthonormal_polynomials(rows, degree),
             right = orthonormal_polynomials(cols, degree);
  const std::size_t n = down.size();
  std::vector<double> coefficients(n * n, 0.0);  // [down][right]
  std::vector<double> of_row(as_index(rows) * n, 0.0);
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    for (std::size_t j = 0; j < n; ++j)
      of_row[as_index(r) * n + j] += double{value(row, col)} * right[j][as_index(c)];
  });
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; i + j < n; ++j)
        coefficients[i * n + j] += of_row[as_index(r) * n + j] * down[i][as_index(r)];
  std::fill(of_row.begin(), of_row.end(), 0.0);
  for (int r = 0; r < rows; ++r)
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t j = 0; i + j < n; ++j)
        of_row[as_index(r) * n + j] += coefficients[i * n + j] * down[i][as_index(r)];
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    double sum = 0;
    for (std::size_t j = 0; j < n; ++j) sum += of_row[as_index(r) * n + j] * right[j][as_index(c)];
    light(row, col) = static_cast<float>(sum);
  });
}

// Writes one channel's response relative to the light, and the light, of which the polynomial is
// taken out first and then what is left in the window around each pixel. light: that of the round
// before, or 0.
void relate(const Image& sum, const MosaicGeometry& geometry, int channel,
            const Outstanding& outstanding, Image& map, Image& light) {
  constexpr double kLeastLight = 0.01;  // of the channel's mean: a polynomial may cross zero
  const auto left_out = [&](int row, int col) { return outstanding.holds(row, col); };
  double mean = 0;
  fit_light(
      geometry, channel,
      [&](int row, int col) {
        const float value = left_out(row, col) ? light(row, col) : sum(row, col);
        mean += double{value} / static_cast<double>(geometry.channel_pixels(channel));
        return value;
      },
      light);
  for_channel(geometry, channel, [&](int, int, int row, int col) {
    float& own = light(row, col);
    own = std::max(own, static_cast<float>(kLeastLight * mean));
    map(row, col) = own > 0 ? sum(row, col) / own : 1.0F;
  });
  WindowMean window(map, geometry, channel, left_out);
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    const auto around = static_cast<float>(window.around(r, c).mean());
    light(row, col) = around > 0 ? light(row, col) * around : 0.0F;
    map(row, col) = around > 0 ? map(row, col) / around : 1.0F;
  });
}

// Of disjoint pairs of next pixels in a row, which have the same light; defects left out.
// error_per_square: per channel, sampling variance of a mean over its sum of squares.
LevelResponse neighbour_response(const Image& frame, const TemporalAccumulator& flat,
                                 const DarkReference& dark, const MosaicGeometry& geometry,
                                 const std::vector<double>& error_per_square,
                                 const std::vector<bool>& used) {
  const std::vector<double> mean = flat.mean_dn();
  const View<const float> squares = flat.sum_of_squares();
  const int step = geometry.cell_cols();
  Moments variance;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const auto i = as_index(channel);
    if (!used.empty() && !used[i]) continue;
    const auto difference = [&](int row, int col) {
      if (col + step >= frame.cols()) return 0.0;
      return (double{frame(row, col)} - dark.shading_dn(row, col) - frame(row, col + step) +
              dark.shading_dn(row, col + step)) /
             mean[i];
    };
    const double bound = kDefectDeviations * location_of(geometry, channel, difference).deviation;
    for_channel(geometry, channel, [&](int, int c, int row, int col) {
      if (c % 2 != 0 || col + step >= frame.cols()) return;
      const double d = difference(row, col);
      if (std::abs(d) > bound) return;
      const double sampling =
          0.5 * error_per_square[i] * (double{squares(row, col)} + squares(row, col + step)) +
          dark.error_dn2[i];
      variance.add(0.5 * d * d - sampling / (mean[i] * mean[i]));
    });
  }
  return {variance.mean(),
          std::sqrt(variance.variance() /
                    static_cast<double>(std::max<std::int64_t>(variance.count(), 1)))};
}

// Gains that whole rows or columns have in common: windows take more of them than of a pixel's own.
class LineResponse {
 public:
  LineResponse(int lines, int largest_radius) : means_(lines), largest_(largest_radius) {}
  /// kept: share of the variance of the pixel's own response in this one.
  void add(int line, double response, double kept) {
    means_.add(line, response);
    lost_.add(1.0 - kept_of_line(line, means_.lines(), largest_) / kept);
  }
  /// Variance of the lines' gains; of_pixels: of the pixels, what their lines share among it.
  double variance(double of_pixels) const {
    double squares = 0, kept = 0;
    for (int i = 0; i < means_.lines(); ++i) {
      squares += means_.mean(i) * means_.mean(i);
      kept += kept_of_line(i, means_.lines(), largest_);
    }
    const double chance = means_.lines() / static_cast<double>(std::max<std::int64_t>(
                                               lost_.count(), 2 * means_.lines()));
    return kept > 0 ? (squares / kept - of_pixels * chance) / (1.0 - chance) : 0.0;
  }
  /// Of it, what the mean square of the pixels lacks.
  double lost() const { return lost_.mean(); }
  /// Sampling variance of that variance: lines are fewer than pixels.
  double error2(double variance) const {
    return 2.0 * variance * variance / std::max(means_.lines() - 1, 1);
  }

 private:
  LineMeans means_;
  int largest_;
  Moments lost_;
};

}  // namespace

ResponseAccumulator::ResponseAccumulator(const MosaicGeometry& geometry)
    : geometry_(geometry), seen_(as_index(geometry.channels()), false) {}

std::vector<int> ResponseAccumulator::channels_without() const {
  std::vector<int> out;
  for (int c = 0; c < geometry_.channels(); ++c)
    if (!seen_[as_index(c)]) out.push_back(c);
  return out;
}

LevelResponse ResponseAccumulator::add(TemporalAccumulator& flat, const DarkReference& dark,
                                       const PixelPlaces& left_out, const std::vector<bool>& used) {
  MALUS_REQUIRE(flat.frames() >= 2);
  if (sum_.empty()) {
    sum_ = Image(geometry_.rows(), geometry_.cols());
    error_ = Image(geometry_.rows(), geometry_.cols());
    weight_.assign(as_index(geometry_.channels()), 0.0);
    weighted_mean_dn_ = weight_;
  }
  if (left_out_.empty() && !left_out.empty()) left_out_ = Image(geometry_.rows(), geometry_.cols());
  for (const auto& [row, col] : left_out) left_out_(row, col) = 1.0F;
  const std::vector<double> mean = flat.mean_dn(left_out, dark.shading_dn),
                            variance = flat.variance_dn2(left_out),
                            squares = channel_means(flat.sum_of_squares(), geometry_);
  SharedDark& shared = darks_[dark.set];
  shared.error_dn2 = dark.error_dn2;
  shared.doubt_dn2 = dark.doubt_dn2;
  shared.scale.resize(mean.size(), 0.0);
  std::vector<double> scale(mean.size()), of_squares(mean.size()), per_square(mean.size());
  for (std::size_t c = 0; c < mean.size(); ++c) {
    if (!used.empty() && !used[c]) continue;
    seen_[c] = true;
    const double error_dn2 = variance[c] / flat.frames();
    const double weight = mean[c] > 0 && error_dn2 > 0 ? mean[c] * mean[c] / error_dn2 : 0.0;
    scale[c] = weight > 0 ? weight / mean[c] : 0.0;
    per_square[c] = squares[c] > 0 ? error_dn2 / squares[c] : 0.0;
    of_squares[c] = scale[c] * scale[c] * per_square[c];
    shared.scale[c] += scale[c];
    weight_[c] += weight;
    weighted_mean_dn_[c] += weight * mean[c];
  }
  const Image frame = flat.release_mean_frame_dn();
  for (int r = 0; r < sum_.rows(); ++r)
    for (int col = 0; col < sum_.cols(); ++col) {
      const auto c = as_index(geometry_.channel(r, col));
      sum_(r, col) += static_cast<float>((frame(r, col) - dark.shading_dn(r, col)) * scale[c]);
      error_(r, col) += static_cast<float>(flat.sum_of_squares()(r, col) * of_squares[c]);
    }
  return neighbour_response(frame, flat, dark, geometry_, per_square, used);
}

// Sampling variance is taken off pixel by pixel: it is larger relative to dim light than to that of
// the channel's mean, and a noisy pixel that is left out takes its own along. Two rounds find the
// defects: neighbours of one stand out of the first map themselves.
Response ResponseAccumulator::response() const {
  MALUS_REQUIRE(channels_without().empty());
  constexpr int kRounds = 2;
  Response out{Image(geometry_.rows(), geometry_.cols(), 1.0F), {}, {}, {}};
  Image light(geometry_.rows(), geometry_.cols());
  for (int channel = 0; channel < geometry_.channels(); ++channel) {
    const auto i = as_index(channel);
    Outstanding outstanding(left_out_);
    relate(sum_, geometry_, channel, outstanding, out.map, light);
    for (int round = 0; round < kRounds; ++round) {
      outstanding.find(out.map, geometry_, channel);
      relate(sum_, geometry_, channel, outstanding, out.map, light);
    }
    double dark = 0, doubt = 0;
    for (const auto& [set, shared] : darks_) {
      dark += shared.error_dn2[i] * shared.scale[i] * shared.scale[i];
      doubt += shared.doubt_dn2[i] * shared.scale[i] * shared.scale[i];
    }
    const int largest = largest_radius(geometry_, channel);
    LineResponse rows(geometry_.channel_rows(channel), largest),
        cols(geometry_.channel_cols(channel), largest);
    Moments square, of_map, doubts;
    for_channel(geometry_, channel, [&](int r, int c, int row, int col) {
      const double own = light(row, col), kept = kept_variance(r, c, geometry_, channel);
      if (!(own > 0 && kept > 0) || outstanding.holds(row, col)) return;
      const double difference = out.map(row, col) - 1.0;
      square.add(difference * difference / kept - (error_(row, col) + dark) / (own * own));
      of_map.add(difference * difference / kept);
      doubts.add(doubt / (own * own));
      rows.add(r, difference, kept);
      cols.add(c, difference, kept);
    });
    double variance = square.count() > 0 ? square.mean() : 0.0;
    double error2 =
        square.variance() / static_cast<double>(square.count()) + doubts.mean() * doubts.mean();
    for (const LineResponse* lines : {&rows, &cols}) {
      const double of_lines = lines->variance(of_map.mean());
      variance += of_lines * lines->lost();
      error2 += lines->error2(of_lines);
    }
    variance = std::max(variance, 0.0);
    const double error = std::sqrt(error2);
    out.prnu.push_back(std::sqrt(variance));
    out.prnu_stderr.push_back(root_standard_error(variance, error));
    out.level_dn.push_back(weight_[i] > 0 ? weighted_mean_dn_[i] / weight_[i] : 0.0);
  }
  return out;
}

UnlitLines ResponseAccumulator::unlit_lines() const {
  MALUS_REQUIRE(channels_without().empty());
  constexpr double kOfLight = 0.05;
  const std::vector<double> mean = channel_means(sum_, geometry_);
  std::vector<double> of_row(as_index(sum_.rows()), 0.0), of_col(as_index(sum_.cols()), 0.0);
  for (int r = 0; r < sum_.rows(); ++r)
    for (int c = 0; c < sum_.cols(); ++c) {
      const double light = sum_(r, c) / mean[as_index(geometry_.channel(r, c))];
      of_row[as_index(r)] += light / sum_.cols();
      of_col[as_index(c)] += light / sum_.rows();
    }
  UnlitLines unlit;
  for (int r = 0; r < sum_.rows(); ++r)
    if (of_row[as_index(r)] < kOfLight) unlit.rows.push_back(r);
  for (int c = 0; c < sum_.cols(); ++c)
    if (of_col[as_index(c)] < kOfLight) unlit.cols.push_back(c);
  return unlit;
}

}  // namespace malus
