#include "malus/calibrate/fixed_pattern.h"

#include "malus/base/index.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace malus {
namespace {

constexpr int kLargestRadius = 7;

// Means over square windows of one channel by sums over rectangles. The window shrinks towards the
// border so that it stays centred (a slope in the light then cancels), but not below 3x3. Pixels
// that are left out (by mosaic row and column) are in no window.
class WindowMean {
 public:
  template <class LeftOut>
  WindowMean(View<const float> mosaic, const MosaicGeometry& geometry, int channel,
             const LeftOut& left_out)
      : rows_(geometry.channel_rows(channel)),
        cols_(geometry.channel_cols(channel)),
        // A small plane needs a small window, or the curve of the light shows in it.
        largest_radius_(std::clamp(std::min(rows_, cols_) / 8, 1, kLargestRadius)) {
    sums_.assign(as_index(rows_ + 1) * as_index(cols_ + 1), {});
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < cols_; ++c) {
        const int row = channel / geometry.cell_cols() + r * geometry.cell_rows(),
                  col = channel % geometry.cell_cols() + c * geometry.cell_cols();
        const bool used = !left_out(row, col);
        Sum& own = sum(r + 1, c + 1);
        own.value = (used ? double{mosaic(row, col)} : 0.0) + sum(r, c + 1).value +
                    sum(r + 1, c).value - sum(r, c).value;
        own.pixels =
            (used ? 1 : 0) + sum(r, c + 1).pixels + sum(r + 1, c).pixels - sum(r, c).pixels;
      }
  }
  struct Window {
    double mean;  ///< 0 without pixels
    int pixels;
  };
  Window around(int r, int c) {
    const int room = std::min({r, c, rows_ - 1 - r, cols_ - 1 - c});
    const int radius = std::clamp(room, 1, largest_radius_);
    const int r0 = std::max(r - radius, 0), r1 = std::min(r + radius + 1, rows_);
    const int c0 = std::max(c - radius, 0), c1 = std::min(c + radius + 1, cols_);
    const Sum &a = sum(r0, c0), &b = sum(r0, c1), &d = sum(r1, c0), &e = sum(r1, c1);
    const int pixels = e.pixels - b.pixels - d.pixels + a.pixels;
    return {pixels > 0 ? (e.value - b.value - d.value + a.value) / pixels : 0.0, pixels};
  }

 private:
  struct Sum {
    double value = 0;
    int pixels = 0;
  };
  Sum& sum(int r, int c) { return sums_[as_index(r) * as_index(cols_ + 1) + as_index(c)]; }
  int rows_, cols_, largest_radius_;
  std::vector<Sum> sums_;
};

// The least that a median shows of values on a lattice.
double least_deviation(double step_dn) { return 0.5 * step_dn / kMedianOfNormal; }

// Median and robust deviation of a function of the pixels of one channel; every k-th pixel of a
// large channel says as much as all. k shares no divisor with the number of columns, so that pixels
// of all columns are among them.
struct Location {
  double centre = 0, deviation = 0;
};

template <class Value>
Location location_of(const MosaicGeometry& geometry, int channel, const Value& value) {
  constexpr std::int64_t kEnough = 100000;
  auto step = static_cast<int>(1 + geometry.channel_pixels(channel) / kEnough);
  while (std::gcd(step, geometry.channel_cols(channel)) > 1) ++step;
  std::vector<double> values;
  int index = 0;
  for (int r = channel / geometry.cell_cols(); r < geometry.rows(); r += geometry.cell_rows())
    for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols())
      if (index++ % step == 0) values.push_back(value(r, c));
  return {median_of(values), robust_deviation_of(values)};
}

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
                               const std::vector<DefectPixel>& listed) {
  OrdinaryPixels out;
  auto next = listed.begin();
  const auto is_listed = [&](int r, int c) {
    const bool is = next != listed.end() && next->row == r && next->col == c;
    if (is) ++next;
    return is;
  };
  const double least = least_deviation(quantization_dn);
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const Location level =
        location_of(geometry, channel, [&](int r, int c) { return mosaic(r, c); });
    const double deviation = std::max(level.deviation, least);
    const double bound =
        deviation > 0 ? kDefectDeviations * deviation : std::numeric_limits<double>::infinity();
    Moments moments;
    for (int r = channel / geometry.cell_cols(); r < geometry.rows(); r += geometry.cell_rows())
      for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols())
        if (!is_listed(r, c) && std::abs(mosaic(r, c) - level.centre) <= bound)
          moments.add(mosaic(r, c));
    out.mean_dn.push_back(moments.mean());
    out.variance_dn2.push_back(moments.variance());
  }
  return out;
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

ResponseAccumulator::ResponseAccumulator(const MosaicGeometry& geometry,
                                         View<const float> shading_dn,
                                         std::vector<double> shading_error_dn2)
    : geometry_(geometry),
      shading_dn_(shading_dn),
      shading_error_dn2_(std::move(shading_error_dn2)) {}

void ResponseAccumulator::add(TemporalAccumulator& flat) {
  if (weight_.empty()) {
    sum_ = Image(geometry_.rows(), geometry_.cols());
    weight_.assign(as_index(geometry_.channels()), 0.0);
    scale_ = weighted_error_ = weight_;
  }
  const std::vector<double> mean = flat.mean_dn(), variance = flat.variance_dn2();
  std::vector<double> scale(mean.size());
  for (std::size_t c = 0; c < mean.size(); ++c) {
    const double relative_error = variance[c] / (flat.frames() * mean[c] * mean[c]);
    const double weight = mean[c] > 0 && relative_error > 0 ? 1.0 / relative_error : 0.0;
    scale[c] = weight > 0 ? weight / mean[c] : 0.0;
    weight_[c] += weight;
    scale_[c] += scale[c];
    weighted_error_[c] += weight > 0 ? weight * weight * relative_error : 0.0;
  }
  const Image frame = flat.release_mean_frame_dn();
  for (int r = 0; r < sum_.rows(); ++r)
    for (int col = 0; col < sum_.cols(); ++col) {
      const double dark = shading_dn_.empty() ? 0.0 : shading_dn_(r, col);
      sum_(r, col) +=
          static_cast<float>((frame(r, col) - dark) * scale[as_index(geometry_.channel(r, col))]);
    }
}

// Writes one channel's relative response into the map and returns its mean square about one. A
// defect would be a good part of its neighbours' window, at the border a ninth of it, and most of a
// channel's variance: pixels that stand out of the map so far are no part of the next one's
// windows, nor of the square. Two rounds: neighbours of a defect stand out of the first map
// themselves.
double ResponseAccumulator::relate(int channel, Image& map) const {
  constexpr int kRounds = 2;
  const auto for_pixels = [&](auto&& use) {
    for (int r = 0; r < geometry_.channel_rows(channel); ++r)
      for (int c = 0; c < geometry_.channel_cols(channel); ++c)
        use(r, c, channel / geometry_.cell_cols() + r * geometry_.cell_rows(),
            channel % geometry_.cell_cols() + c * geometry_.cell_cols());
  };
  Image before(map.rows(), map.cols(), 1.0F);  // of the round before
  Location usual{1.0, 0.0};
  const auto stands_out = [&](int row, int col) {
    return usual.deviation > 0 &&
           std::abs(before(row, col) - usual.centre) > kDefectDeviations * usual.deviation;
  };
  Moments square;
  for (int round = 0; round <= kRounds; ++round) {
    WindowMean ordinary(sum_, geometry_, channel, stands_out);
    square = Moments();
    for_pixels([&](int r, int c, int row, int col) {
      const auto window = ordinary.around(r, c);
      if (!(window.mean > 0)) return;
      const double relative = sum_(row, col) / window.mean;
      map(row, col) = static_cast<float>(relative);
      // The window holds the pixel itself: the difference keeps 1 - 1/n of the variance.
      if (!stands_out(row, col) && window.pixels > 1)
        square.add((relative - 1.0) * (relative - 1.0) / (1.0 - 1.0 / window.pixels));
    });
    if (round == kRounds) break;
    for_pixels([&](int, int, int row, int col) { before(row, col) = map(row, col); });
    usual = location_of(geometry_, channel, [&](int r, int c) { return map(r, c); });
  }
  return square.mean();
}

Response ResponseAccumulator::response() const {
  MALUS_REQUIRE(!empty());
  Response out{Image(geometry_.rows(), geometry_.cols(), 1.0F), {}};
  for (int channel = 0; channel < geometry_.channels(); ++channel) {
    const auto i = as_index(channel);
    const double square = relate(channel, out.map);
    const double dark = shading_dn_.empty() ? 0.0 : shading_error_dn2_[i] * scale_[i] * scale_[i];
    const double sampling =
        weight_[i] > 0 ? (weighted_error_[i] + dark) / (weight_[i] * weight_[i]) : 0.0;
    out.prnu.push_back(std::sqrt(std::max(square - sampling, 0.0)));
  }
  return out;
}

namespace {

// What a channel's ordinary pixels show in the dark.
struct UsualPixel {
  Location level;
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
    for (int r = channel / geometry.cell_cols(); r < geometry.rows(); r += geometry.cell_rows())
      for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols()) {
        if (defects.size() >= kMostDefects) return defects;
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
      }
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
