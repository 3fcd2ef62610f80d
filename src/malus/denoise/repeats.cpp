#include "malus/denoise/internal/repeats.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/mosaic_filter.h"

#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include <unsupported/Eigen/FFT>

namespace malus::internal {
namespace {

constexpr int kSide = Repeats::kRegionCells;
// Steps that are looked for: nearer ones every search finds [cells].
constexpr int kNearest = 8, kFarthest = 40;
// Detail is what differs from the mean of so many cells.
constexpr int kSmoothCells = 5;
// A step is one where this part of a region's detail comes again: repeating structure has 0.95 and
// more of it, photographs and pages of print at most 0.45 (docs/repeating-structure.md).
constexpr float kLeastShare = 0.6f;
// Of several, those that have this part of the largest share, as far as noise tells: copies that
// are off by a pixel are none where others are true.
constexpr float kLeastOfBest = 0.95f, kDoubtDeviations = 2;
// And more than noise makes of nothing [standard deviations]; of two parts of the region that
// overlap by this much of it at least.
constexpr float kLeastDeviations = 6, kLeastOverlap = 0.05f;

// Around a step, at this distance [cells], no other has more than this part of its share.
constexpr int kRing = 3;
constexpr float kMostAround = 0.8f;

using Complex = std::complex<float>;
using Square = std::vector<Complex>;  ///< kSide x kSide

std::size_t place(int row, int col) {
  const int r = (row + kSide) % kSide, c = (col + kSide) % kSide;
  return static_cast<std::size_t>(r * kSide + c);
}

// Along rows, then along columns.
class Transform {
 public:
  void forward(Square& values) {
    run(values, [&](Complex* to, const Complex* from) { fft_.fwd(to, from, kSide); });
  }
  void inverse(Square& values) {
    run(values, [&](Complex* to, const Complex* from) { fft_.inv(to, from, kSide); });
  }

 private:
  template <class Line>
  void run(Square& values, const Line& line) {
    std::array<Complex, kSide> transformed;
    for (int axis = 0; axis < 2; ++axis) {
      for (int r = 0; r < kSide; ++r) {
        line(transformed.data(), &values[place(r, 0)]);
        for (int c = 0; c < kSide; ++c)
          turned_[place(c, r)] = transformed[static_cast<std::size_t>(c)];
      }
      std::swap(values, turned_);
    }
  }
  Eigen::FFT<float> fft_;
  Square turned_ = Square(static_cast<std::size_t>(kSide * kSide));
};

// Falls to 0 at both ends: a region's borders are no detail, and steps wrap around to nothing.
std::vector<float> taper(int size) {
  std::vector<float> weights;
  for (int i = 0; i < size; ++i) {
    const double wave = std::sin(std::numbers::pi * (i + 1) / (size + 1));
    weights.push_back(static_cast<float>(wave * wave));
  }
  return weights;
}

// Of the power of every frequency, what is detail.
std::vector<float> detail_shares() {
  std::vector<float> mean(kSide, 1.0f), shares;
  for (int k = 1; k < kSide; ++k) {
    const double angle = std::numbers::pi * k / kSide;
    mean[static_cast<std::size_t>(k)] =
        static_cast<float>(std::sin(kSmoothCells * angle) / (kSmoothCells * std::sin(angle)));
  }
  for (const float down : mean)
    for (const float across : mean) shares.push_back((1 - down * across) * (1 - down * across));
  return shares;
}

// A region of the frame, in cells.
struct Region {
  int row, col, rows, cols;
};

class RegionCovariance {
 public:
  RegionCovariance(const FrameSource& frame, const Region& region)
      : detail_(kSide * kSide), overlap_(kSide * kSide) {
    const std::vector<float> down = taper(region.rows), across = taper(region.cols);
    double squares = 0, fourths = 0;
    for (int r = 0; r < region.rows; ++r)
      for (int c = 0; c < region.cols; ++c) {
        const float weight =
            down[static_cast<std::size_t>(r)] * across[static_cast<std::size_t>(c)];
        overlap_[place(r, c)] = weight;
        squares += weight * weight;
        fourths += std::pow(weight, 4);
      }
    std::vector<float> power(detail_.size());
    // Two values of the cells at once, as real and imaginary part: their covariances add up.
    for (int value = 0; value < kLanes; value += 2) add_power(frame, region, value, power);
    static const std::vector<float> shares = detail_shares();
    double noise = 0;
    for (std::size_t i = 0; i < power.size(); ++i) {
      detail_[i] = shares[i] * power[i];
      noise += shares[i];
    }
    noise *= kLanes * squares / static_cast<double>(power.size());
    transform_.inverse(detail_);
    square(overlap_);
    signal_ = detail_[0].real() - static_cast<float>(noise);
    deviation_ = static_cast<float>(std::sqrt(kLanes * fourths));
  }

  /// The part of the region's detail that comes again a step further; 0 where it may be chance.
  float share_at(int rows, int cols) const {
    const std::size_t at = place(rows, cols);
    const float covariance = detail_[at].real(), overlap = overlap_[at].real() / overlap_[0].real();
    if (covariance < kLeastDeviations * deviation_ || overlap < kLeastOverlap) return 0;
    return covariance / (overlap * signal_);
  }
  /// What noise makes of it, standard deviation.
  float deviation_at(int rows, int cols) const {
    return deviation_ / (overlap_[place(rows, cols)].real() / overlap_[0].real() * signal_);
  }

 private:
  void add_power(const FrameSource& frame, const Region& region, int value,
                 std::vector<float>& power) {
    Square cells(power.size());
    const int row0 = region.row * kCell + value / kCell, col0 = region.col * kCell + value % kCell;
    Complex sum = 0;
    for (int r = 0; r < region.rows; ++r)
      for (int c = 0; c < region.cols; ++c) {
        const int row = row0 + r * kCell, col = col0 + c * kCell;
        const Complex pair(frame.pixel(row, col), frame.pixel(row, col + 1));
        cells[place(r, c)] = pair;
        sum += pair;
      }
    const Complex mean = sum / static_cast<float>(region.rows * region.cols);
    for (int r = 0; r < region.rows; ++r)
      for (int c = 0; c < region.cols; ++c)
        cells[place(r, c)] = (cells[place(r, c)] - mean) * overlap_[place(r, c)];
    transform_.forward(cells);
    for (std::size_t i = 0; i < power.size(); ++i) power[i] += std::norm(cells[i]);
  }

  // The autocovariance of real values.
  void square(Square& values) {
    transform_.forward(values);
    for (Complex& value : values) value = std::norm(value);
    transform_.inverse(values);
  }

  Transform transform_;
  Square detail_, overlap_;
  float signal_ = 0, deviation_ = 0;
};

// Whether none next to a step has a larger share, and none around it nearly as large a one: along a
// straight edge every step is alike, and the near search finds enough of them.
bool is_peak(const RegionCovariance& covariance, int rows, int cols, float share) {
  for (int r = -kRing; r <= kRing; ++r)
    for (int c = -kRing; c <= kRing; ++c) {
      const int distance = std::max(std::abs(r), std::abs(c));
      if (distance > 1 && distance < kRing) continue;
      const float most = distance == kRing ? kMostAround * share : share;
      if (covariance.share_at(rows + r, cols + c) > most) return false;
    }
  return true;
}

std::vector<RepeatStep> steps_of(const RegionCovariance& covariance) {
  struct Peak {
    int rows, cols;
    float share;
    int squared() const { return rows * rows + cols * cols; }
  };
  std::vector<Peak> peaks;
  float best = 0;
  for (int rows = 0; rows <= kFarthest; ++rows)
    for (int cols = rows == 0 ? 1 : -kFarthest; cols <= kFarthest; ++cols) {
      if (rows <= kNearest && std::abs(cols) <= kNearest) continue;
      const float share = covariance.share_at(rows, cols);
      if (share < kLeastShare || !is_peak(covariance, rows, cols, share)) continue;
      peaks.push_back({rows, cols, share});
      best = std::max(best, share);
    }
  std::erase_if(peaks, [&](const Peak& peak) {
    const float doubt = kDoubtDeviations * covariance.deviation_at(peak.rows, peak.cols);
    return peak.share + doubt < kLeastOfBest * best;
  });
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Peak& a, const Peak& b) { return a.squared() < b.squared(); });
  peaks.resize(std::min(peaks.size(), static_cast<std::size_t>(kMostRepeatSteps / 2)));
  std::vector<RepeatStep> steps;
  for (const Peak& peak : peaks)
    for (const int way : {1, -1})
      steps.push_back({way * peak.rows * kCell, way * peak.cols * kCell});
  return steps;
}

}  // namespace

Repeats find_repeats(const FrameSource& frame) {
  const int rows = frame.rows / kCell, cols = frame.cols / kCell;
  if (std::min(rows, cols) <= 2 * kNearest) return {};
  const auto regions = [](int cells) { return std::max((cells + kSide / 2) / kSide, 1); };
  Repeats repeats(regions(rows), regions(cols));
  parallel_for(0, repeats.down() * repeats.across(), 1,
               [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                 for (int n = static_cast<int>(begin); n < static_cast<int>(end); ++n) {
                   const int i = n / repeats.across(), k = n % repeats.across();
                   // The last ones overlap what is before them.
                   const int row = std::clamp(rows - kSide, 0, i * kSide),
                             col = std::clamp(cols - kSide, 0, k * kSide);
                   const Region region{row, col, std::min(kSide, rows), std::min(kSide, cols)};
                   repeats.of_region(i, k) = steps_of(RegionCovariance(frame, region));
                 }
               });
  return repeats;
}

}  // namespace malus::internal
