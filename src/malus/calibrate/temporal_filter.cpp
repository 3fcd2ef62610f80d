#include "malus/calibrate/temporal_filter.h"

#include "malus/base/index.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kTriples = 8;

Image copy_of(View<const float> dn) {
  Image out(dn.rows(), dn.cols());
  for (int r = 0; r < dn.rows(); ++r) std::copy_n(dn.row(r), dn.cols(), out.row(r));
  return out;
}

// Takes out what the pixels of one channel in a row share: row noise and the frame's level.
void level_rows(const MosaicGeometry& geometry, Image& noise) {
  std::vector<double> mean(as_index(geometry.cell_cols()));
  for (int r = 0; r < noise.rows(); ++r) {
    std::fill(mean.begin(), mean.end(), 0.0);
    for (int c = 0; c < noise.cols(); ++c)
      mean[as_index(c % geometry.cell_cols())] +=
          double{noise(r, c)} / geometry.channel_cols(c % geometry.cell_cols());
    for (int c = 0; c < noise.cols(); ++c)
      noise(r, c) -= static_cast<float>(mean[as_index(c % geometry.cell_cols())]);
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

}  // namespace

void SuccessiveFrames::add(View<const float> dn) {
  if (triples_ >= kTriples) return;
  if (first_.empty()) {
    first_ = copy_of(dn);
  } else if (second_.empty()) {
    second_ = copy_of(dn);
  } else {
    use(dn);
    first_ = second_ = Image();
    ++triples_;
  }
}

// Pixels far out are left out: telegraph noise stays for several frames where it is, and a few such
// pixels would be most of the variance.
void SuccessiveFrames::use(View<const float> third) {
  constexpr double kFarOut = 5.0;  // mean changes: four deviations of normal noise
  const double most = kFarOut * mean_change(first_, second_);
  Image& d1 = first_;
  Image& d2 = second_;
  for (int r = 0; r < d1.rows(); ++r)
    for (int c = 0; c < d1.cols(); ++c) {
      d1(r, c) = second_(r, c) - first_(r, c);
      d2(r, c) = third(r, c) - second_(r, c);
    }
  level_rows(geometry_, d1);
  level_rows(geometry_, d2);
  for (int r = 0; r < d1.rows(); ++r)
    for (int c = 0; c < d1.cols(); ++c) {
      const double a = d1(r, c), b = d2(r, c);
      if (std::max(std::abs(a), std::abs(b)) > most) continue;
      const double product = a * b, square = 0.5 * (a * a + b * b);
      products_ += product;
      squares_ += square;
      product2_ += product * product;
      cross_ += product * square;
      square2_ += square * square;
    }
}

double SuccessiveFrames::correlation() const {
  return squares_ > 0 ? 1.0 + 2.0 * products_ / squares_ : 0.0;
}

double SuccessiveFrames::standard_error() const {
  if (!(squares_ > 0)) return 0.0;
  const double ratio = products_ / squares_;
  const double scatter = product2_ - 2.0 * ratio * cross_ + ratio * ratio * square2_;
  return 2.0 * std::sqrt(std::max(scatter, 0.0)) / squares_;
}

void warn_of_temporal_filter(const SuccessiveFrames& dark, PhysicsCalibration& out) {
  constexpr double kLeast = 0.1, kErrors = 8.0;
  const double correlation = dark.correlation(), error = dark.standard_error();
  if (correlation > std::max(kLeast, kErrors * error))
    out.warnings.push_back(fmt::format(
        "a pixel's noise in a dark frame correlates by {:.2f} ± {:.2g} with that in the frame "
        "before: the camera mixes frames, and K and the noise are not the sensor's; turn off its "
        "temporal noise reduction",
        correlation, error));
}

}  // namespace malus
