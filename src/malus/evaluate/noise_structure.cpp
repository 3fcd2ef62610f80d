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

// Sum and count of a line's finite pixels.
struct Line {
  double sum = 0;
  int pixels = 0;
  void add(float v) {
    if (!std::isfinite(v)) return;
    sum += double{v};
    ++pixels;
  }
};

// Means of the lines that have pixels, as their spread tells of them.
class LineMeans {
 public:
  explicit LineMeans(const std::vector<Line>& lines) {
    for (const Line& line : lines) {
      if (line.pixels == 0) continue;
      means_.push_back(line.sum / line.pixels);
      pixels_share_ += 1.0 / line.pixels;
    }
    if (means_.size() < 2) return;
    const double sd = standard_deviation_of(means_);
    variance_ = sd * sd;
    pixels_share_ /= static_cast<double>(means_.size());
  }
  bool known() const { return means_.size() > 1; }
  double variance() const { return variance_; }
  // Share of the pixels' own variance that the means hold.
  double pixels_share() const { return known() ? pixels_share_ : 0.0; }
  // Variance beyond the part that independent pixels explain (000, 3.2: σ_b).
  double own_variance(double pixel_variance) const {
    return known() ? variance_ - pixel_variance * pixels_share_ : 0.0;
  }

 private:
  std::vector<double> means_;
  double variance_ = 0, pixels_share_ = 0;
};

// Takes the mean off. Fewer than two finite pixels tell nothing, and none of their plane is left.
std::optional<Spread> centre(Image& plane) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  Moments moments;
  for (float v : plane.values())
    if (std::isfinite(v)) moments.add(v);
  Spread spread;
  if (moments.count() < 2) {
    std::fill(plane.values().begin(), plane.values().end(), kNone);
    return std::nullopt;
  }
  spread.mean = moments.mean();
  spread.variance = moments.variance();
  std::vector<Line> row_lines(static_cast<std::size_t>(plane.rows()));
  std::vector<Line> col_lines(static_cast<std::size_t>(plane.cols()));
  for (int r = 0; r < plane.rows(); ++r)
    for (int c = 0; c < plane.cols(); ++c) {
      float& v = plane(r, c);
      v = std::isfinite(v) ? static_cast<float>(v - spread.mean) : kNone;
      row_lines[static_cast<std::size_t>(r)].add(v);
      col_lines[static_cast<std::size_t>(c)].add(v);
    }
  // The pixel variance about the lines' own means: the lines' part comes off the whole, and with it
  // the share of the pixels' own variance that the lines' means hold.
  const LineMeans rows(row_lines), cols(col_lines);
  const double left = 1.0 - rows.pixels_share() - cols.pixels_share();
  double pixel = std::max(0.0, spread.variance - rows.variance() - cols.variance());
  if (left > 0) pixel /= left;  // a plane of 2 x 2 leaves nothing
  spread.row_variance = rows.own_variance(pixel);
  spread.column_variance = cols.own_variance(pixel);
  return spread;
}

// Means of the mosaic's rows, from planes with mean 0; empty where a row has no finite pixel, for
// a series with gaps has no periodogram.
std::vector<double> row_means(const Planes& planes, const SensorLayout& layout) {
  std::vector<Line> lines(static_cast<std::size_t>(planes.rows() * layout.rows()));
  for (int k = 0; k < planes.channels(); ++k)
    for (int r = 0; r < planes.rows(); ++r) {
      Line& line = lines[static_cast<std::size_t>(r * layout.rows() + k / layout.cols())];
      for (int c = 0; c < planes.cols(); ++c) line.add(planes[k](r, c));
    }
  std::vector<double> means;
  for (const Line& line : lines) {
    if (line.pixels == 0) return {};
    means.push_back(line.sum / line.pixels);
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

// Products of pixels (row, col) of one image and (row + down, col + right) of the other, where both
// are finite.
StructureSums::Products lagged_products(const Image& image, const Image& other, int down,
                                        int right) {
  if (image.rows() <= down || image.cols() <= right) return {};
  return parallel_reduce(
      0, image.rows() - down, kRowsPerTask, StructureSums::Products{},
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        StructureSums::Products part;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
          const float *a = image.row(r), *b = other.row(r + down) + right;
          for (int c = 0; c < image.cols() - right; ++c) {
            const double product = double{a[c]} * double{b[c]};
            const bool known = !std::isnan(product);
            part.sum += known ? product : 0.0;
            part.pairs += known;
          }
        }
        return part;
      },
      std::plus<>());
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
  if (!power.empty()) {
    row_power_.resize(power.size());
    for (std::size_t band = 0; band < power.size(); ++band) row_power_[band] += power[band];
    ++row_power_frames_;
  }
  for (int k = 0; k < planes.channels(); ++k)
    for (float& v : planes[k].values()) v *= scale[static_cast<std::size_t>(k)];
  Image scaled(noise.rows(), noise.cols());
  unpack(planes, layout_, scaled);
  for (int lag = 1; lag <= kLags; ++lag) {
    const auto i = static_cast<std::size_t>(lag - 1);
    along_row_[i] = along_row_[i] + lagged_products(scaled, scaled, 0, lag);
    along_column_[i] = along_column_[i] + lagged_products(scaled, scaled, lag, 0);
  }
  if (!before_.empty()) between_frames_ = between_frames_ + lagged_products(before_, scaled, 0, 0);
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
  structure.between_frames = between_frames_.mean();
  for (const Products& products : along_row_) structure.along_row.push_back(products.mean());
  for (const Products& products : along_column_) structure.along_column.push_back(products.mean());
  for (const double power : row_power_)
    structure.row_power_dn2.push_back(power / row_power_frames_);
  return structure;
}

}  // namespace malus
