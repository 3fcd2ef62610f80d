#include "malus/calibrate/internal/neighbour_correlation.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/image/window.h"
#include "malus/noise/two_outputs.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

// Takes every channel's row and column means out and scales what is left to variance 1; a channel
// that does not change becomes 0.
void whiten_lines(const MosaicGeometry& geometry, Image& noise) {
  const int cell_rows = geometry.cell_rows(), cell_cols = geometry.cell_cols();
  const std::vector<double> level = channel_means(noise, geometry);
  std::vector<double> rows(as_index(noise.rows()) * as_index(cell_cols), 0.0),
      cols(as_index(noise.cols()) * as_index(cell_rows), 0.0), variance(level.size(), 0.0);
  const auto row_mean = [&](int r, int c) -> double& {
    return rows[as_index(r) * as_index(cell_cols) + as_index(c % cell_cols)];
  };
  const auto col_mean = [&](int r, int c) -> double& {
    return cols[as_index(c) * as_index(cell_rows) + as_index(r % cell_rows)];
  };
  for (int r = 0; r < noise.rows(); ++r)
    for (int c = 0; c < noise.cols(); ++c) {
      const int channel = geometry.channel(r, c);
      row_mean(r, c) += noise(r, c) / static_cast<double>(geometry.channel_cols(channel));
      col_mean(r, c) += noise(r, c) / static_cast<double>(geometry.channel_rows(channel));
    }
  for (int r = 0; r < noise.rows(); ++r)
    for (int c = 0; c < noise.cols(); ++c) {
      const auto channel = as_index(geometry.channel(r, c));
      noise(r, c) -= static_cast<float>(row_mean(r, c) + col_mean(r, c) - level[channel]);
      variance[channel] += double{noise(r, c)} * noise(r, c);
    }
  std::vector<float> scale;
  for (int c = 0; c < geometry.channels(); ++c)
    scale.push_back(
        variance[as_index(c)] > 0
            ? static_cast<float>(std::sqrt(static_cast<double>(geometry.channel_pixels(c)) /
                                           variance[as_index(c)]))
            : 0.0F);
  for (int r = 0; r < noise.rows(); ++r)
    for (int c = 0; c < noise.cols(); ++c) noise(r, c) *= scale[as_index(geometry.channel(r, c))];
}

// What taking a line's mean off n pixels leaves between any two of them, -1 / (n - 1).
double left_by_mean(const MosaicGeometry& geometry, int down, int right, int channel) {
  if (down % geometry.cell_rows() != 0 || right % geometry.cell_cols() != 0) return 0.0;
  const int n = down == 0 ? geometry.channel_cols(channel) : geometry.channel_rows(channel);
  return n > 1 ? -1.0 / (n - 1.0) : 0.0;
}

}  // namespace

NeighbourCorrelation::NeighbourCorrelation(const MosaicGeometry& geometry) : geometry_(geometry) {
  lags_ = {{0, 1, "in a row"}, {1, 0, "in a column"}};
  if (geometry.cell_cols() > 1)
    lags_.push_back({0, geometry.cell_cols(), "in a row of one channel"});
  if (geometry.cell_rows() > 1)
    lags_.push_back({geometry.cell_rows(), 0, "in a column of one channel"});
}

Image NeighbourCorrelation::difference(View<const float> first, View<const float> second,
                                       const std::vector<double>& dark_dn) const {
  constexpr double kMostFlicker = 0.1;
  std::vector<float> scale(as_index(geometry_.channels()), 1.0F), dark(scale.size(), 0.0F);
  if (!dark_dn.empty()) {
    const std::vector<double> a = channel_means(first, geometry_),
                              b = channel_means(second, geometry_);
    for (std::size_t c = 0; c < a.size(); ++c) {
      dark[c] = static_cast<float>(dark_dn[c]);
      if (a[c] > dark_dn[c] && b[c] > dark_dn[c])
        scale[c] = static_cast<float>(std::clamp((a[c] - dark_dn[c]) / (b[c] - dark_dn[c]),
                                                 1.0 - kMostFlicker, 1.0 + kMostFlicker));
    }
  }
  Image out(first.rows(), first.cols());
  for (int r = 0; r < out.rows(); ++r)
    for (int col = 0; col < out.cols(); ++col) {
      const auto c = as_index(geometry_.channel(r, col));
      out(r, col) = first(r, col) - dark[c] - (second(r, col) - dark[c]) * scale[c];
    }
  return out;
}

void NeighbourCorrelation::add(View<const float> first, View<const float> second,
                               const std::vector<double>& dark_dn) {
  Image noise = difference(first, second, dark_dn);
  whiten_lines(geometry_, noise);
  for (int r = 0; r < noise.rows(); ++r) quarters_.add(noise.view().row_span(r));
  for (Lag& lag : lags_)
    for (int r = 0; r + lag.down < noise.rows(); ++r)
      for (int c = 0; c + lag.right < noise.cols(); ++c) {
        const double product = double{noise(r, c)} * noise(r + lag.down, c + lag.right);
        lag.products +=
            product - left_by_mean(geometry_, lag.down, lag.right, geometry_.channel(r, c));
        lag.squares += product * product;
        lag.count += 1.0;
      }
}

void NeighbourCorrelation::merge(const NeighbourCorrelation& other) {
  dark_ += other.dark_;
  quarters_.add(other.quarters_);
  for (std::size_t i = 0; i < lags_.size(); ++i) {
    lags_[i].products += other.lags_[i].products;
    lags_[i].squares += other.lags_[i].squares;
    lags_[i].count += other.lags_[i].count;
  }
}

std::vector<NeighbourLikeness> NeighbourCorrelation::likeness() const {
  std::vector<NeighbourLikeness> out;
  for (const Lag& lag : lags_) {
    const double count = std::max(lag.count, 1.0);
    const double of_halves = lag.down == 0 ? shared_by_halves() : 0;
    out.push_back({lag.where, lag.products / count - of_halves, std::sqrt(lag.squares) / count});
  }
  return out;
}

void NeighbourCorrelation::Quarters::add(std::span<const float> row) {
  std::array<double, 4> mean{};
  const std::size_t width = row.size() / mean.size();
  if (width == 0) return;
  for (std::size_t q = 0; q < mean.size(); ++q)
    for (std::size_t c = q * width; c < (q + 1) * width; ++c)
      mean[q] += double{row[c]} / static_cast<double>(width);
  const double in_halves = 0.5 * (mean[0] * mean[1] + mean[2] * mean[3]),
               beside_middle = mean[1] * mean[2];
  within += in_halves;
  middle += beside_middle;
  outer += mean[0] * mean[3];
  squares += (in_halves - beside_middle) * (in_halves - beside_middle);
  rows += 1;
}

void NeighbourCorrelation::Quarters::add(const Quarters& other) {
  within += other.within;
  middle += other.middle;
  outer += other.outer;
  squares += other.squares;
  rows += other.rows;
}

// Offsets of +d and -d in the halves: products of d² within a half and -d² across, whatever lies
// between. What is the same all along the row, as filters and hum are, makes no difference beside
// the middle and elsewhere; what grows evenly along it makes outer quarters most unlike.
double NeighbourCorrelation::shared_by_halves() const {
  constexpr double kErrors = 8.0, kLeast = 1e-3, kMostOuter = 3.0;
  const Quarters& q = quarters_;
  if (!(q.rows > 0)) return 0;
  const double shared = 0.5 * (q.within - q.middle) / q.rows,
               error = 0.5 * std::sqrt(q.squares) / q.rows;
  const bool is_step = q.middle < 0 && q.outer > kMostOuter * q.middle;
  return is_step && shared > std::max(kLeast, kErrors * error) ? shared : 0;
}

void FramePairs::add(View<const float> dn) {
  if (left_ <= 0) return;
  if (waiting_.empty()) {
    waiting_ = copy_of(dn);
    return;
  }
  correlation_.add(waiting_, dn, dark_dn_);
  waiting_ = Image();
  --left_;
}

namespace {

// What light makes of them, without the share of the dark noise.
std::vector<NeighbourLikeness> likeness_of_light(const NeighbourCorrelation& dark,
                                                 const NeighbourCorrelation& flat) {
  const double share = std::min(flat.dark_share(), 0.99);
  std::vector<NeighbourLikeness> out = flat.likeness();
  const std::vector<NeighbourLikeness> of_dark = dark.likeness();
  for (std::size_t i = 0; i < out.size(); ++i) {
    NeighbourLikeness& one = out[i];
    one.correlation = (one.correlation - share * of_dark[i].correlation) / (1 - share);
    one.standard_error =
        std::hypot(one.standard_error, share * of_dark[i].standard_error) / (1 - share);
  }
  return out;
}

// Few per cent of a pixel's signal in its neighbours. A filter whose weights have the sum 1 leaves
// of white noise 1 / (1 + 2 Σ ρ), over one of each two opposite neighbours.
void warn_of_shared_light(const NeighbourCorrelation& dark, const NeighbourCorrelation& flat,
                          PhysicsCalibration& out) {
  constexpr double kLeast = 0.008, kErrors = 5.0;
  double sum = 0;
  NeighbourLikeness most;
  for (const NeighbourLikeness& one : likeness_of_light(dark, flat)) {
    sum += one.correlation;
    if (one.correlation > std::max({kLeast, kErrors * one.standard_error, most.correlation}))
      most = one;
  }
  if (!(most.correlation > 0 && sum > 0) || out.K.mean.empty()) return;
  out.warnings.push_back(fmt::format(
      "the noise of pixels next to each other {} correlates by {:.3f} ± {:.1g} in the flat frames: "
      "pixels share signal (inter-pixel capacitance, cross-talk of charge), or the camera smooths "
      "its pictures a little. K is about {:.2g} % too small, and values in electrons are too "
      "large; turn off what filters in the camera, or correct K by that",
      most.where, most.correlation, most.standard_error, 100 * (1 - 1 / (1 + 2 * sum))));
}

void warn_of_halves(const NeighbourCorrelation& dark, PhysicsCalibration& out) {
  const double shared = dark.shared_by_halves();
  if (!(shared > 0)) return;
  const double all = mean_of(out.temporal_sd_dark_dn), rows = mean_of(out.sigma_row.mean),
               without_rows = std::sqrt(std::max(all * all - rows * rows, 0.0));
  out.warnings.push_back(fmt::format(
      "{}, {:.2g} DN about the row's: two outputs read them. The model has one offset for a whole "
      "row (of {:.2g} DN), and "
      "denoising leaves the rest in; cut all frames into halves, and calibrate and denoise each as "
      "a sensor of its own",
      kTwoOutputsFinding, std::sqrt(shared) * without_rows, rows));
}

}  // namespace

void warn_of_alike_neighbours(const NeighbourCorrelation& dark, const NeighbourCorrelation& flat,
                              PhysicsCalibration& out) {
  constexpr double kLeastDark = 0.1, kLeastFlat = 0.03, kErrors = 5.0;
  const char* frames = nullptr;
  NeighbourLikeness most;
  const auto judge = [&](const char* name, const NeighbourCorrelation& set, double least) {
    for (NeighbourLikeness& one : set.likeness()) {
      const double size = std::abs(one.correlation);
      if (!(size > std::max(least, kErrors * one.standard_error)) ||
          !(size > std::abs(most.correlation)))
        continue;
      frames = name;
      most = std::move(one);
    }
  };
  warn_of_halves(dark, out);
  judge("dark", dark, kLeastDark);
  judge("flat", flat, kLeastFlat);
  if (!frames)
    warn_of_shared_light(dark, flat, out);
  else
    out.warnings.push_back(fmt::format(
        "the noise of pixels next to each other {} correlates by {:.2f} ± {:.2g} in the {} frames: "
        "the camera smooths, sharpens or compresses its pictures, and K and the noise are not the "
        "sensor's; turn off noise reduction, sharpening, demosaicking and lossy compression, and "
        "take raw frames",
        most.where, most.correlation, most.standard_error, frames));
}

}  // namespace malus
