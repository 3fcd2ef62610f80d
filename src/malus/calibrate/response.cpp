#include "malus/calibrate/internal/response.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/light_polynomial.h"
#include "malus/calibrate/internal/light_profile.h"
#include "malus/calibrate/internal/line_response.h"
#include "malus/calibrate/internal/pixel_location.h"
#include "malus/calibrate/internal/response_window.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace malus {
namespace {

// The median of each square of a channel, of 8 by 8 of them at most and 8 lines at least. That of
// all squares where every pixel is left out.
template <class LeftOut>
void light_of_squares(const Image& sum, const MosaicGeometry& geometry, int channel,
                      const LeftOut& left_out, Image& light) {
  static constexpr int kMost = 8, kFewestLines = 8;
  const auto squares = [](int lines) { return std::clamp(lines / kFewestLines, 1, kMost); };
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel);
  const auto square = [=](int r, int c) {
    return as_index(r * squares(rows) / rows * squares(cols) + c * squares(cols) / cols);
  };
  std::vector<std::vector<double>> values(as_index(squares(rows) * squares(cols)));
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    if (!left_out(row, col)) values[square(r, c)].push_back(sum(row, col));
  });
  std::vector<double> medians, seen;
  for (std::vector<double>& of_square : values) {
    medians.push_back(of_square.empty() ? 0 : median_of(of_square));
    if (!of_square.empty()) seen.push_back(medians.back());
  }
  const double of_all = seen.empty() ? 0 : median_of(std::move(seen));
  for (std::size_t i = 0; i < medians.size(); ++i)
    if (values[i].empty()) medians[i] = of_all;
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    light(row, col) = static_cast<float>(medians[square(r, c)]);
  });
}

// Pixels that a first map shows to be none of the ordinary ones. A defect would be a good part of
// its neighbours' window, at the border a third of it, and most of a channel's variance: such
// pixels are no part of the next map's windows, nor of the variance.
class Outstanding {
 public:
  /// left_out: further such pixels, above 0; may be empty.
  explicit Outstanding(View<const float> left_out) : left_out_(left_out) {}
  bool holds(int row, int col) const {
    if (is_left_out(row, col)) return true;
    return usual_.deviation > 0 &&
           std::abs(before_(row, col) - usual_.centre) > kDefectDeviations * usual_.deviation;
  }
  // Before there is a map: those that see less than a third of the light of their square, or far
  // more. A polynomial would follow rows and clusters of them at the border. light: the squares'
  // medians.
  void find_dark(const Image& sum, const MosaicGeometry& geometry, int channel, Image& light) {
    constexpr double kFarOff = 2.0 / 3.0;
    light_of_squares(
        sum, geometry, channel, [this](int row, int col) { return is_left_out(row, col); }, light);
    if (before_.empty()) before_ = Image(sum.rows(), sum.cols());
    for_channel(geometry, channel, [&](int, int, int row, int col) {
      before_(row, col) = light(row, col) > 0 ? sum(row, col) / light(row, col) : 1.0F;
    });
    usual_ = {1.0, kFarOff / kDefectDeviations};
  }
  void find(const Image& map, const MosaicGeometry& geometry, int channel) {
    for_channel(geometry, channel,
                [&](int, int, int row, int col) { before_(row, col) = map(row, col); });
    usual_ = location_of(geometry, channel, [&](int r, int c) { return map(r, c); });
  }

 private:
  bool is_left_out(int row, int col) const { return !left_out_.empty() && left_out_(row, col) > 0; }
  View<const float> left_out_;
  Image before_;
  PixelLocation usual_;
};

// Writes one channel's response relative to the light, and the light, of which the polynomial is
// taken out first and then what is left in the window around each pixel. light: that of the round
// before.
LightPolynomial relate(const Image& sum, const MosaicGeometry& geometry, int channel,
                       LightDegree degree, const Outstanding& outstanding, Image& map,
                       Image& light) {
  constexpr double kLeastLight = 0.01;  // of the channel's mean: a polynomial may cross zero
  const auto left_out = [&](int row, int col) { return outstanding.holds(row, col); };
  double mean = 0;
  for_channel(geometry, channel, [&](int, int, int row, int col) {
    if (!left_out(row, col)) light(row, col) = sum(row, col);
    mean += double{light(row, col)} / static_cast<double>(geometry.channel_pixels(channel));
  });
  LightPolynomial polynomial = fit_light(geometry, channel, degree, light);
  for_channel(geometry, channel, [&](int, int, int row, int col) {
    float& own = light(row, col);
    own = std::max(own, static_cast<float>(kLeastLight * mean));
    map(row, col) = own > 0 ? sum(row, col) / own : 1.0F;
  });
  WindowMean window(map, geometry, channel, left_out);
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    // 1 of a window without pixels, beside a dead corner: the polynomial is all that is known.
    const WindowMean::Sum near = window.around(r, c);
    const auto around = near.pixels > 0 ? static_cast<float>(near.mean()) : 1.0F;
    light(row, col) = around > 0 ? light(row, col) * around : 0.0F;
    map(row, col) = around > 0 ? map(row, col) / around : 1.0F;
  });
  return polynomial;
}

// Two rounds find the defects: neighbours of one stand out of the first map themselves. Only then
// terms of a high degree are asked for, and a round more where there are such, without which
// pixels may have stood out that do not.
LightPolynomial relate_in_rounds(const Image& sum, const MosaicGeometry& geometry, int channel,
                                 Outstanding& outstanding, Image& map, Image& light) {
  constexpr int kRounds = 4, kLowRounds = 2;
  LightPolynomial polynomial;
  outstanding.find_dark(sum, geometry, channel, light);
  for (int round = 0; round < kRounds; ++round) {
    if (round > 0) outstanding.find(map, geometry, channel);
    const LightDegree degree = round < kLowRounds ? LightDegree::kLow : LightDegree::kHigh;
    polynomial = relate(sum, geometry, channel, degree, outstanding, map, light);
    if (degree == LightDegree::kHigh && !polynomial.has_high()) break;
  }
  return polynomial;
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
    weighted_mean_dn_ = weighted_s_per_dn_ = per_row_noise_ = weight_;
  }
  if (left_out_.empty() && !left_out.empty()) left_out_ = Image(geometry_.rows(), geometry_.cols());
  for (const auto& [row, col] : left_out) left_out_(row, col) = 1.0F;
  const std::vector<double> mean = flat.mean_dn(left_out, dark.shading_dn),
                            variance = flat.variance_dn2(left_out),
                            squares = channel_means(flat.sum_of_squares(), geometry_);
  SharedDark& shared = darks_[dark.set];
  shared.error_dn2 = dark.error_dn2;
  shared.doubt_dn2 = dark.doubt_dn2;
  shared.frames = dark.frames;
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
    per_row_noise_[c] += scale[c] * scale[c] / flat.frames();
    weight_[c] += weight;
    weighted_mean_dn_[c] += weight * mean[c];
    weighted_s_per_dn_[c] += scale[c] * dark.darkless_s;
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

// Square of the response that is taken off too much: all of the rows' noise is, as if every row had
// its own, of which a window leaves as much as LineResponse gives back. Of rows that are alike it
// has taken more.
double ResponseAccumulator::row_noise_left_over(int channel, const Image& light,
                                                const FrameRowNoise& rows) const {
  const auto i = as_index(channel);
  double per_row_noise = per_row_noise_[i];
  for (const auto& [set, shared] : darks_)
    per_row_noise += shared.scale[i] * shared.scale[i] / shared.frames;
  const int lines = geometry_.channel_rows(channel), largest = largest_radius(geometry_, channel);
  std::vector<double> left_over;
  for (int r = 0; r < lines; ++r) {
    const double kept = kept_of_line(r, lines, largest);
    left_over.push_back(kept > 0 ? 1.0 - kept_of_row_noise(r, geometry_, channel, rows.drift) / kept
                                 : 0.0);
  }
  Moments squares;
  for_channel(geometry_, channel, [&](int r, int, int row, int col) {
    const double own = light(row, col);
    if (own > 0) squares.add(left_over[as_index(r)] / (own * own));
  });
  return squares.mean() * per_row_noise * rows.sigma_dn[i] * rows.sigma_dn[i];
}

// Sampling variance is taken off pixel by pixel: it is larger relative to dim light than to that of
// the channel's mean, and a noisy pixel that is left out takes its own along.
Response ResponseAccumulator::response(const FrameRowNoise& rows) const {
  MALUS_REQUIRE(channels_without().empty());
  Response out;
  out.map = Image(geometry_.rows(), geometry_.cols(), 1.0F);
  Image light(geometry_.rows(), geometry_.cols());
  const Image left_out = with_unlit_lines();
  for (int channel = 0; channel < geometry_.channels(); ++channel) {
    const auto i = as_index(channel);
    Outstanding outstanding(left_out);
    const LightPolynomial polynomial =
        relate_in_rounds(sum_, geometry_, channel, outstanding, out.map, light);
    const KeptByLight kept_by_light = kept_by(polynomial, geometry_, channel);
    double dark = 0, doubt = 0;
    for (const auto& [set, shared] : darks_) {
      dark += shared.error_dn2[i] * shared.scale[i] * shared.scale[i];
      doubt += shared.doubt_dn2[i] * shared.scale[i] * shared.scale[i];
    }
    const int largest = largest_radius(geometry_, channel);
    LineResponse of_rows(geometry_.channel_rows(channel), largest, kept_by_light.of_rows),
        of_cols(geometry_.channel_cols(channel), largest, kept_by_light.of_cols);
    Moments square, of_map, doubts;
    for_channel(geometry_, channel, [&](int r, int c, int row, int col) {
      const double own = light(row, col),
                   kept = kept_by_light.of_pixels * kept_variance(r, c, geometry_, channel);
      if (!(own > 0 && kept > 0) || outstanding.holds(row, col)) return;
      const double difference = out.map(row, col) - 1.0;
      square.add(difference * difference / kept - (error_(row, col) + dark) / (own * own));
      of_map.add(difference * difference / kept);
      doubts.add(doubt / (own * own));
      of_rows.add(r, difference, kept);
      of_cols.add(c, difference, kept);
    });
    double variance = square.count() > 0 ? square.mean() : 0.0;
    double error2 =
        square.variance() / static_cast<double>(square.count()) + doubts.mean() * doubts.mean();
    for (const LineResponse* lines : {&of_rows, &of_cols}) {
      const double of_lines = lines->variance(of_map.mean());
      variance += of_lines * lines->lost();
      error2 += lines->error2(of_lines);
    }
    variance = std::max(variance + row_noise_left_over(channel, light, rows), 0.0);
    const double error = std::sqrt(error2);
    out.prnu.push_back(std::sqrt(variance));
    out.prnu_stderr.push_back(root_standard_error(variance, error));
    const double weight = weight_[i] > 0 ? weight_[i] : 1.0;
    out.level_dn.push_back(weighted_mean_dn_[i] / weight);
    out.darkless_s_per_dn.push_back(weighted_s_per_dn_[i] / weight);
  }
  return out;
}

// A polynomial would follow masked lines, and their squares have no other light.
Image ResponseAccumulator::with_unlit_lines() const {
  const UnlitLines unlit = unlit_lines();
  Image out = left_out_;
  if (out.empty() && !(unlit.rows.empty() && unlit.cols.empty()))
    out = Image(sum_.rows(), sum_.cols());
  for (const int r : unlit.rows)
    for (int c = 0; c < out.cols(); ++c) out(r, c) = 1.0F;
  for (const int c : unlit.cols)
    for (int r = 0; r < out.rows(); ++r) out(r, c) = 1.0F;
  return out;
}

UnlitLines ResponseAccumulator::unlit_lines() const {
  MALUS_REQUIRE(channels_without().empty());
  const std::vector<double> mean = channel_means(sum_, geometry_);
  if (std::ranges::any_of(mean, [](double light) { return !(light > 0); })) return {};
  std::vector<double> of_row(as_index(sum_.rows()), 0.0), of_col(as_index(sum_.cols()), 0.0);
  for (int r = 0; r < sum_.rows(); ++r)
    for (int c = 0; c < sum_.cols(); ++c) {
      const double light = sum_(r, c) / mean[as_index(geometry_.channel(r, c))];
      of_row[as_index(r)] += light / sum_.cols();
      of_col[as_index(c)] += light / sum_.rows();
    }
  UnlitLines unlit;
  for (int r = 0; r < sum_.rows(); ++r)
    if (of_row[as_index(r)] < kUnlitShare) unlit.rows.push_back(r);
  for (int c = 0; c < sum_.cols(); ++c)
    if (of_col[as_index(c)] < kUnlitShare) unlit.cols.push_back(c);
  return unlit;
}

}  // namespace malus
