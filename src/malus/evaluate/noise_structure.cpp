#include "malus/evaluate/noise_structure.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace malus {
namespace {

struct Spread {
  double mean = 0, variance = 0, row_variance = 0, column_variance = 0;
};

// Variance of line means beyond the part that independent pixels explain (000, 3.2: σ_b).
double line_variance(const std::vector<double>& means, double pixel_variance, int pixels_per_line) {
  if (means.size() < 2) return 0;
  const double sd = standard_deviation_of(means);
  return sd * sd - pixel_variance / pixels_per_line;
}

// Replaces broken pixels by the mean so that the sums below need no case for them. Fewer than two
// sound ones tell nothing, and their plane is even.
std::optional<Spread> centre(Image& plane) {
  Moments moments;
  for (float v : plane.values())
    if (std::isfinite(v)) moments.add(v);
  Spread spread;
  if (moments.count() < 2) {
    std::fill(plane.values().begin(), plane.values().end(), 0.0f);
    return std::nullopt;
  }
  spread.mean = moments.mean();
  spread.variance = moments.variance();
  std::vector<double> rows(static_cast<std::size_t>(plane.rows()));
  std::vector<double> cols(static_cast<std::size_t>(plane.cols()));
  for (int r = 0; r < plane.rows(); ++r)
    for (int c = 0; c < plane.cols(); ++c) {
      float& v = plane(r, c);
      v = std::isfinite(v) ? static_cast<float>(v - spread.mean) : 0.0f;
      rows[static_cast<std::size_t>(r)] += double{v} / plane.cols();
      cols[static_cast<std::size_t>(c)] += double{v} / plane.rows();
    }
  // The pixel variance about the lines' own means: the lines' part comes off the whole, and with it
  // the share 1 / length of the pixels' own variance that the lines' means hold.
  const double row_part = standard_deviation_of(rows), col_part = standard_deviation_of(cols);
  const double left = (rows.size() > 1 ? 1.0 - 1.0 / plane.cols() : 1.0) -
                      (cols.size() > 1 ? 1.0 / plane.rows() : 0.0);
  double pixel = std::max(0.0, spread.variance - (rows.size() > 1 ? row_part * row_part : 0) -
                                   (cols.size() > 1 ? col_part * col_part : 0));
  if (left > 0) pixel /= left;  // a plane of 2 x 2 leaves nothing
  spread.row_variance = line_variance(rows, pixel, plane.cols());
  spread.column_variance = line_variance(cols, pixel, plane.rows());
  return spread;
}

// Means of the mosaic's rows, from planes with mean 0.
std::vector<double> row_means(const Planes& planes, const SensorLayout& layout) {
  std::vector<double> means(static_cast<std::size_t>(planes.rows() * layout.rows()), 0.0);
  for (int k = 0; k < planes.channels(); ++k)
    for (int r = 0; r < planes.rows(); ++r) {
      double& mean = means[static_cast<std::size_t>(r * layout.rows() + k / layout.cols())];
      for (int c = 0; c < planes.cols(); ++c)
        mean += double{planes[k](r, c)} / (planes.cols() * layout.cols());
    }
  return means;
}

// Periodogram from the lowest frequency above 0 to half a cycle per row, averaged in kRowBands
// bands that differ by one frequency at most.
std::vector<double> row_power(const std::vector<double>& means) {
  const std::size_t n = means.size(), frequencies = n / 2;
  constexpr std::size_t kBands = kRowBands;
  if (frequencies < kBands) return {};
  std::vector<std::complex<double>> turn(n);
  for (std::size_t i = 0; i < n; ++i)
    turn[i] =
        std::polar(1.0, 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n));
  std::vector<double> power(kBands, 0.0);
  std::size_t first = 1;
  for (std::size_t band = 0; band < kBands; ++band) {
    const std::size_t count = frequencies / kBands + (band < frequencies % kBands);
    for (std::size_t j = first; j < first + count; ++j) {
      std::complex<double> sum;
      for (std::size_t r = 0; r < n; ++r) sum += means[r] * turn[j * r % n];
      power[band] += std::norm(sum) / static_cast<double>(n * count);
    }
    first += count;
  }
  return power;
}

// Mean product of pixels (row, col) of one image and (row + down, col + right) of the other.
double lagged_product(const Image& image, const Image& other, int down, int right) {
  if (image.rows() <= down || image.cols() <= right) return 0;
  const double sum = parallel_reduce(
      0, image.rows() - down, kRowsPerTask, 0.0,
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        double part = 0;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
          const float *a = image.row(r), *b = other.row(r + down) + right;
          for (int c = 0; c < image.cols() - right; ++c) part += double{a[c]} * double{b[c]};
        }
        return part;
      },
      std::plus<>());
  return sum / (static_cast<double>(image.rows() - down) * (image.cols() - right));
}

}  // namespace

StructureSums::StructureSums(const SensorLayout& layout)
    : layout_(layout),
      channels_(static_cast<std::size_t>(layout.channels())),
      along_row_(kLags),
      along_column_(kLags) {}

void StructureSums::add(const Image& noise) {
  Planes planes = pack(noise, layout_);
  std::vector<float> scale;  // to variance 1
  for (int k = 0; k < planes.channels(); ++k) {
    const std::optional<Spread> spread = centre(planes[k]);
    const double variance = spread ? spread->variance : 0.0;
    scale.push_back(static_cast<float>(variance > 0 ? 1 / std::sqrt(variance) : 0));
    if (!spread) continue;
    ChannelSums& sums = channels_[static_cast<std::size_t>(k)];
    sums.mean += spread->mean;
    sums.variance += spread->variance;
    sums.row_variance += spread->row_variance;
    sums.column_variance += spread->column_variance;
    ++sums.frames;
  }
  const std::vector<double> power = row_power(row_means(planes, layout_));
  row_power_.resize(power.size());
  for (std::size_t band = 0; band < power.size(); ++band) row_power_[band] += power[band];
  for (int k = 0; k < planes.channels(); ++k)
    for (float& v : planes[k].values()) v *= scale[static_cast<std::size_t>(k)];
  Image scaled(noise.rows(), noise.cols());
  unpack(planes, layout_, scaled);
  for (int lag = 1; lag <= kLags; ++lag) {
    along_row_[static_cast<std::size_t>(lag - 1)] += lagged_product(scaled, scaled, 0, lag);
    along_column_[static_cast<std::size_t>(lag - 1)] += lagged_product(scaled, scaled, lag, 0);
  }
  if (!before_.empty()) between_frames_ += lagged_product(before_, scaled, 0, 0);
  before_ = std::move(scaled);
  ++frames_;
}

NoiseStructure StructureSums::result() const {
  MALUS_REQUIRE(frames_ > 0);
  NoiseStructure structure;
  for (const ChannelSums& sums : channels_) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    const auto deviation = [&](double variance_sum) {
      return sums.frames > 0 ? std::sqrt(std::max(0.0, variance_sum / sums.frames)) : kUnknown;
    };
    structure.mean_dn.push_back(sums.frames > 0 ? sums.mean / sums.frames : kUnknown);
    structure.sd_dn.push_back(deviation(sums.variance));
    structure.row_sd_dn.push_back(deviation(sums.row_variance));
    structure.column_sd_dn.push_back(deviation(sums.column_variance));
  }
  structure.between_frames = between_frames_ / std::max(frames_ - 1, 1);
  structure.along_row = along_row_;
  structure.along_column = along_column_;
  structure.row_power_dn2 = row_power_;
  for (auto* list : {&structure.along_row, &structure.along_column, &structure.row_power_dn2})
    for (double& v : *list) v /= frames_;
  return structure;
}

}  // namespace malus
