#include "malus/calibrate/internal/temporal_filter.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/image/window.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::size_t kTriples = 8;
constexpr std::size_t kFlatTriples = 3;  // of each level

// Takes out what the pixels of one channel in a row share, and in a column: row noise, the frame's
// level, light that moves.
void level_lines(const MosaicGeometry& geometry, Image& noise) {
  std::vector<double> mean(as_index(geometry.cell_cols()));
  for (int r = 0; r < noise.rows(); ++r) {
    std::fill(mean.begin(), mean.end(), 0.0);
    for (int c = 0; c < noise.cols(); ++c)
      mean[as_index(c % geometry.cell_cols())] +=
          double{noise(r, c)} / geometry.channel_cols(c % geometry.cell_cols());
    for (int c = 0; c < noise.cols(); ++c)
      noise(r, c) -= static_cast<float>(mean[as_index(c % geometry.cell_cols())]);
  }
  const int cell_rows = geometry.cell_rows();
  for (int phase = 0; phase < cell_rows; ++phase) {
    mean.assign(as_index(noise.cols()), 0.0);
    const double rows = (noise.rows() - phase + cell_rows - 1) / cell_rows;
    for (int r = phase; r < noise.rows(); r += cell_rows)
      for (int c = 0; c < noise.cols(); ++c) mean[as_index(c)] += double{noise(r, c)} / rows;
    for (int r = phase; r < noise.rows(); r += cell_rows)
      for (int c = 0; c < noise.cols(); ++c) noise(r, c) -= static_cast<float>(mean[as_index(c)]);
  }
}

// Of pixels that changed: noise narrower than the converter's step leaves most as they are.
double mean_change(const Image& first, const Image& second) {
  double sum = 0, changed = 0;
  for (std::size_t i = 0; i < first.values().size(); ++i) {
    const double change = std::abs(double{second.values()[i]} - first.values()[i]);
    sum += change;
    changed += change > 0;
  }
  return changed > 0 ? sum / changed : 0.0;
}

// Pixels far out are left out: telegraph noise stays for several frames where it is, and a few such
// pixels would be most of the variance. The bound is an ellipse of independent frames' differences:
// it takes as much of the products as of the squares, whatever the pixels' deviations are.
SuccessiveProducts products_of(const MosaicGeometry& geometry, Image& first, Image& second,
                               View<const float> third) {
  constexpr double kFarOut = 5.0;  // mean changes: four deviations of normal noise
  const double most = kFarOut * mean_change(first, second);
  Image& d1 = first;
  Image& d2 = second;
  SuccessiveProducts sum;
  for (int r = 0; r < d1.rows(); ++r)
    for (int c = 0; c < d1.cols(); ++c) {
      d1(r, c) = second(r, c) - first(r, c);
      d2(r, c) = third(r, c) - second(r, c);
      sum.changed += d1(r, c) != 0 || d2(r, c) != 0;
    }
  level_lines(geometry, d1);
  level_lines(geometry, d2);
  for (int r = 0; r < d1.rows(); ++r)
    for (int c = 0; c < d1.cols(); ++c) {
      const double a = d1(r, c), b = d2(r, c);
      const double product = a * b, square = 0.5 * (a * a + b * b);
      if (2.0 * square + product > 0.75 * most * most) continue;
      sum.products += product;
      sum.squares += square;
      sum.product2 += product * product;
      sum.cross += product * square;
      sum.square2 += square * square;
      sum.pixels += 1.0;
    }
  return sum;
}

}  // namespace

void SuccessiveProducts::merge(const SuccessiveProducts& other) {
  products += other.products;
  squares += other.squares;
  product2 += other.product2;
  cross += other.cross;
  square2 += other.square2;
  pixels += other.pixels;
  changed += other.changed;
}

SuccessiveProducts SuccessiveProducts::scaled(double of_products, double of_squares) const {
  SuccessiveProducts out = *this;
  out.products *= of_products;
  out.squares *= of_squares;
  out.product2 *= of_products * of_products;
  out.cross *= of_products * of_squares;
  out.square2 *= of_squares * of_squares;
  return out;
}

double SuccessiveProducts::correlation() const {
  return squares > 0 ? 1.0 + 2.0 * products / squares : 0.0;
}

double SuccessiveProducts::standard_error() const {
  if (!(squares > 0)) return 0.0;
  const double ratio = products / squares;
  const double scatter = product2 - 2.0 * ratio * cross + ratio * ratio * square2;
  return 2.0 * std::sqrt(std::max(scatter, 0.0)) / squares;
}

bool SuccessiveFrames::tells() const {
  constexpr double kFewest = 100;
  return sum_.changed >= kFewest;
}

double SuccessiveFrames::middle_correlation() const {
  if (of_triple_.empty()) return 0.0;
  std::vector<double> sorted = of_triple_;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>((sorted.size() - 1) / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  return *middle;
}

void SuccessiveFrames::add(View<const float> dn) {
  if (of_triple_.size() >= kTriples) return;
  if (first_.empty()) {
    first_ = copy_of(dn);
  } else if (second_.empty()) {
    second_ = copy_of(dn);
  } else {
    const SuccessiveProducts triple = products_of(geometry_, first_, second_, dn);
    sum_.merge(triple);
    of_triple_.push_back(triple.correlation());
    first_ = second_ = Image();
  }
}

void SuccessiveFlats::add(View<const float> dn, const std::vector<double>& light_dn) {
  if (first_light_dn_.empty()) first_light_dn_ = light_dn;
  lit_ = lit_ && std::all_of(light_dn.begin(), light_dn.end(), [](double v) { return v > 0; });
  if (!lit_ || triples_.size() >= kFlatTriples) return;
  Image scaled(geometry_.rows(), geometry_.cols());
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const auto channel = as_index(geometry_.channel(r, c));
      scaled(r, c) = static_cast<float>((double{dn(r, c)} - dark_dn_[channel] - shading_dn_(r, c)) *
                                        (first_light_dn_[channel] / light_dn[channel]));
    }
  waiting_.push_back(std::move(scaled));
  scales_.push_back(mean_of(first_light_dn_) / mean_of(light_dn));
  if (waiting_.size() < 3) return;
  triples_.push_back({products_of(geometry_, waiting_[0], waiting_[1], waiting_[2]), scales_});
  waiting_.clear();
  scales_.clear();
}

// Of independent frames' variances v, the product's mean is -v2 and the squares' (v1 + 2 v2 +
// v3)/2.
SuccessiveProducts SuccessiveFlats::products(double shot_share) const {
  SuccessiveProducts sum;
  for (const Triple& triple : triples_) {
    if (!(triple.sum.squares > 0)) continue;
    const auto variance = [&](std::size_t frame) {
      const double scale = triple.scale[frame];
      return scale * (shot_share + (1.0 - shot_share) * scale);
    };
    const double unit = triple.sum.pixels / triple.sum.squares;
    sum.merge(triple.sum.scaled(
        unit * (variance(0) + 2.0 * variance(1) + variance(2)) / (4.0 * variance(1)), unit));
  }
  return sum;
}

bool mixes_frames(const SuccessiveFrames& dark) {
  constexpr double kLeast = 0.1, kErrors = 8.0;
  return dark.tells() && dark.middle_correlation() > kLeast &&
         dark.correlation() > std::max(kLeast, kErrors * dark.standard_error());
}

// No mixture of frames correlates by more than 1: where the measure says so, a difference tells the
// next one.
void warn_of_temporal_filter(const SuccessiveFrames& dark, PhysicsCalibration& out) {
  constexpr double kErrors = 8.0;
  if (dark.tells() &&
      std::min(dark.correlation(), dark.middle_correlation()) - kErrors * dark.standard_error() >
          1.0)
    out.warnings.push_back(
        "what a pixel changes by from one dark frame to the next it goes on changing by: that is a "
        "drift and no noise, and K and the noise are not the sensor's; let the camera warm up, and "
        "keep light out");
  else if (mixes_frames(dark))
    out.warnings.push_back(fmt::format(
        "a pixel's noise in a dark frame correlates by {:.2f} ± {:.2g} with that in the frame "
        "before: the camera mixes frames, and K and the noise are not the sensor's; turn off its "
        "temporal noise reduction",
        dark.correlation(), dark.standard_error()));
}

}  // namespace malus
