#include "malus/calibrate/temporal.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr int kRowsPerPiece = 64;

// Sums of the sites of one mosaic row, one per column of the cell.
std::vector<double> site_sums(const float* row, int cols, int cell_cols) {
  std::vector<double> sums(static_cast<std::size_t>(cell_cols), 0.0);
  int c = 0;
  for (; c + cell_cols <= cols; c += cell_cols)
    for (int j = 0; j < cell_cols; ++j) sums[static_cast<std::size_t>(j)] += row[c + j];
  for (; c < cols; ++c) sums[static_cast<std::size_t>(c % cell_cols)] += row[c];
  return sums;
}

}  // namespace

std::vector<double> channel_means(View<const float> mosaic, const MosaicGeometry& geometry) {
  MALUS_REQUIRE(mosaic.rows() == geometry.rows() && mosaic.cols() == geometry.cols());
  using Sums = std::vector<double>;
  Sums total(static_cast<std::size_t>(geometry.channels()), 0.0);
  total = parallel_reduce(
      0, mosaic.rows(), kRowsPerPiece, total,
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        Sums part(total.size(), 0.0);
        for (auto r = static_cast<int>(first); r < last; ++r) {
          const auto sums = site_sums(mosaic.row(r), mosaic.cols(), geometry.cell_cols());
          for (int j = 0; j < geometry.cell_cols(); ++j)
            part[static_cast<std::size_t>(geometry.channel(r, j))] +=
                sums[static_cast<std::size_t>(j)];
        }
        return part;
      },
      [](Sums a, const Sums& b) {
        for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
        return a;
      });
  for (int c = 0; c < geometry.channels(); ++c)
    total[static_cast<std::size_t>(c)] /= static_cast<double>(geometry.channel_pixels(c));
  return total;
}

std::vector<float> some_pixels(View<const float> dn, const MosaicGeometry& geometry, int channel) {
  constexpr std::int64_t kMost = 1 << 17;
  const std::int64_t step = 1 + geometry.channel_pixels(channel) / kMost;
  std::vector<float> pixels;
  std::int64_t index = 0;
  for_channel(geometry, channel, [&](int, int, int row, int col) {
    if (index++ % step == 0) pixels.push_back(dn(row, col));
  });
  return pixels;
}

TemporalAccumulator::TemporalAccumulator(const MosaicGeometry& geometry,
                                         std::vector<double> dark_dn, FrameAlignment alignment)
    : geometry_(geometry),
      dark_dn_(std::move(dark_dn)),
      alignment_(alignment),
      mean_(geometry.rows(), geometry.cols()),
      m2_(geometry.rows(), geometry.cols()) {
  MALUS_REQUIRE(static_cast<int>(dark_dn_.size()) == geometry.channels());
}

void TemporalAccumulator::add(View<const float> dn) {
  MALUS_REQUIRE(!mean_.empty());
  std::vector<double> means = channel_means(dn, geometry_);
  for (std::size_t c = 0; c < means.size(); ++c) means[c] -= dark_dn_[c];
  frame_means_.push_back(means);
  ++frames_;
  // aligned = (dn - offset) * scale, per column of the cell in each of its rows
  const auto align = [&](int channel) {
    const auto c = static_cast<std::size_t>(channel);
    const double first = frame_means_.front()[c], now = means[c];
    if (alignment_ == FrameAlignment::kMultiplicative && now > 0 && first > 0)
      return std::pair(dark_dn_[c], first / now);
    return std::pair(dark_dn_[c] + now - first, 1.0);
  };
  const int cols = geometry_.cols();
  const auto weight = static_cast<float>(1.0 / frames_);
  parallel_for(0, geometry_.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    std::vector<float> offset(static_cast<std::size_t>(cols)), scale(offset.size());
    for (int phase = 0; phase < geometry_.cell_rows(); ++phase) {
      for (int c = 0; c < cols; ++c) {
        const auto [o, s] = align(geometry_.channel(phase, c));
        offset[static_cast<std::size_t>(c)] = static_cast<float>(o);
        scale[static_cast<std::size_t>(c)] = static_cast<float>(s);
      }
      for (auto r = static_cast<int>(begin); r < end; ++r) {
        if (r % geometry_.cell_rows() != phase) continue;
        const float* x = dn.row(r);
        float* mean = mean_.row(r);
        float* m2 = m2_.row(r);
        for (int c = 0; c < cols; ++c) {
          const float y =
              (x[c] - offset[static_cast<std::size_t>(c)]) * scale[static_cast<std::size_t>(c)];
          const float delta = y - mean[c];
          mean[c] += delta * weight;
          m2[c] += delta * (y - mean[c]);
        }
      }
    }
  });
}

std::vector<double> TemporalAccumulator::mean_dn() const {
  std::vector<double> mean(dark_dn_.size(), 0.0);
  for (const auto& frame : frame_means_)
    for (std::size_t c = 0; c < mean.size(); ++c)
      mean[c] += frame[c] / static_cast<double>(frames_);
  return mean;
}

std::vector<double> TemporalAccumulator::mean_dn(const PixelPlaces& left_out,
                                                 View<const float> shading_dn) const {
  std::vector<double> mean = mean_dn();
  if (left_out.empty()) return mean;
  const std::vector<double> with = channel_means(mean_, geometry_),
                            shading = channel_means(shading_dn, geometry_);
  std::vector<double> sum(mean.size(), 0.0), count = sum;
  for (const auto& [row, col] : left_out) {
    const auto c = static_cast<std::size_t>(geometry_.channel(row, col));
    sum[c] += double{mean_(row, col)} - shading_dn(row, col) - (with[c] - shading[c]);
    count[c] += 1.0;
  }
  for (std::size_t c = 0; c < mean.size(); ++c) {
    const double first = frame_means_.front()[c],
                 kept =
                     static_cast<double>(geometry_.channel_pixels(static_cast<int>(c))) - count[c];
    if (!(kept > 0)) continue;
    const bool scaled = alignment_ == FrameAlignment::kMultiplicative && first > 0;
    mean[c] -= sum[c] / kept * (scaled ? mean[c] / first : 1.0);
  }
  return mean;
}

std::vector<double> TemporalAccumulator::frame_deviation_dn() const {
  std::vector<double> deviation(dark_dn_.size(), 0.0);
  if (frames_ < 2) return deviation;
  for (std::size_t c = 0; c < deviation.size(); ++c) {
    Moments moments;
    for (const auto& frame : frame_means_) moments.add(frame[c]);
    deviation[c] = std::sqrt(moments.variance());
  }
  return deviation;
}

std::vector<std::vector<double>> TemporalAccumulator::frame_drifts_dn() const {
  std::vector<std::vector<double>> drifts = frame_means_;
  const std::vector<double> mean = mean_dn();
  for (std::vector<double>& drift : drifts)
    for (std::size_t c = 0; c < drift.size(); ++c) drift[c] -= mean[c];
  return drifts;
}

std::vector<double> TemporalAccumulator::variance_dn2(const PixelPlaces& left_out) const {
  MALUS_REQUIRE(frames_ >= 2);
  std::vector<double> variance = channel_means(m2_, geometry_), count(variance.size(), 0.0);
  for (int c = 0; c < geometry_.channels(); ++c)
    variance[static_cast<std::size_t>(c)] *= static_cast<double>(geometry_.channel_pixels(c));
  for (const auto& [row, col] : left_out) {
    const auto c = static_cast<std::size_t>(geometry_.channel(row, col));
    variance[c] -= m2_(row, col);
    count[c] += 1.0;
  }
  const std::vector<double> mean = mean_dn();
  for (int i = 0; i < geometry_.channels(); ++i) {
    const auto c = static_cast<std::size_t>(i);
    const double pixels = static_cast<double>(geometry_.channel_pixels(i)) - count[c];
    // Aligning a frame costs one degree of freedom per frame and channel.
    variance[c] /= (pixels - 1.0) * (frames_ - 1.0);
    // Multiplicative alignment scaled everything to the first frame; the mean frame is meant.
    const double first = frame_means_.front()[c];
    if (alignment_ == FrameAlignment::kMultiplicative && first > 0)
      variance[c] *= mean[c] * mean[c] / (first * first);
  }
  return variance;
}

Image TemporalAccumulator::release_mean_frame_dn() {
  Image out = std::move(mean_);
  mean_ = Image();
  const std::vector<double> mean = mean_dn();
  for (int r = 0; r < out.rows(); ++r)
    for (int col = 0; col < out.cols(); ++col) {
      const auto c = static_cast<std::size_t>(geometry_.channel(r, col));
      const double first = frame_means_.front()[c];
      if (alignment_ == FrameAlignment::kMultiplicative && first > 0)
        out(r, col) *= static_cast<float>(mean[c] / first);
      else
        out(r, col) += static_cast<float>(mean[c] - first);
    }
  return out;
}

RowLagAccumulator::RowLagAccumulator(const MosaicGeometry& geometry)
    : geometry_(geometry), sum_(static_cast<std::size_t>(geometry.rows()), 0.0) {
  for (auto& product : product_) product.assign(sum_.size(), 0.0);
}

void RowLagAccumulator::add(View<const float> dn, const std::vector<double>& channel_means_dn) {
  std::vector<double> offset(sum_.size());
  for (int r = 0; r < geometry_.rows(); ++r) {
    const auto sums = site_sums(dn.row(r), dn.cols(), geometry_.cell_cols());
    double total = 0.0;
    for (int j = 0; j < geometry_.cell_cols(); ++j) {
      const int c = geometry_.channel(r, j);
      total += sums[static_cast<std::size_t>(j)] -
               geometry_.channel_cols(j) * channel_means_dn[static_cast<std::size_t>(c)];
    }
    offset[static_cast<std::size_t>(r)] = total / dn.cols();
  }
  ++frames_;
  for (std::size_t r = 0; r < offset.size(); ++r) {
    sum_[r] += offset[r];
    for (std::size_t lag = 0; lag < kLags && r + lag < offset.size(); ++lag)
      product_[lag][r] += offset[r] * offset[r + lag];
  }
}

double RowLagAccumulator::covariance_dn2(int row, int lag) const {
  MALUS_REQUIRE(frames_ >= 2 && lag >= 0 && lag < kLags && row >= 0 && row + lag < rows());
  const auto r = static_cast<std::size_t>(row), l = static_cast<std::size_t>(lag);
  return (product_[l][r] - sum_[r] * sum_[r + l] / frames_) / (frames_ - 1.0);
}

}  // namespace malus
