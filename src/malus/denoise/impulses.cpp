#include "malus/denoise/internal/impulses.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/denoise/internal/noise_tails.h"

#include <algorithm>
#include <cmath>
#include <span>

namespace malus {
namespace {

constexpr double kThresholds[] = {6, 8, 12, 20};  // deviations
// Of the pixels beside an impulse. The picture's own points are spread over more than one pixel.
constexpr float kBesideLess = 3;
constexpr double kExplained = 0.5;  // of the pixels beyond a threshold, by the read noise's law
constexpr int kLeastNeighbours = 5;
constexpr int kBandRows = 32;

// In place, of a few values, for every pixel: median_of copies.
float median(std::span<float> values) {
  const auto middle = values.begin() + std::ssize(values) / 2;
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// How far a pixel lies from its surroundings, in deviations of the noise or of their own spread,
// whichever is larger.
float deviation_of(const PreparedFrame& frame, const NoiseProfile& profile, int row, int col) {
  float near[8];
  std::size_t count = 0;
  for (int i = -1; i <= 1; ++i)
    for (int k = -1; k <= 1; ++k) {
      const int r = row + i * frame.layout.rows(), c = col + k * frame.layout.cols();
      if ((i || k) && r >= 0 && c >= 0 && r < frame.dn.rows() && c < frame.dn.cols())
        near[count++] = frame.dn(r, c);
    }
  if (count < kLeastNeighbours) return 0;
  const std::span<float> values(near, count);
  const float middle = median(values);
  for (float& value : values) value = std::abs(value - middle);
  const float spread = median(values) / static_cast<float>(kMedianOfNormal);
  const auto& channel =
      profile.channels[static_cast<std::size_t>(frame.layout.channel_at(row, col))];
  const auto noise = static_cast<float>(std::sqrt(std::max(channel.variance(middle), 0.0)));
  return (frame.dn(row, col) - middle) / std::max({noise, spread, 1e-20f});
}

struct Impulse {
  DefectList::Place place;
  float deviation;
};

// Of rows [begin, end), beyond the least threshold.
std::vector<Impulse> impulses_in(const PreparedFrame& frame, const NoiseProfile& profile, int begin,
                                 int end) {
  const int cols = frame.dn.cols(), first = std::max(begin - 1, 0),
            last = std::min(end + 1, frame.dn.rows());
  Image deviation(last - first, cols);
  for (int r = first; r < last; ++r)
    for (int c = 0; c < cols; ++c)
      deviation(r - first, c) = std::abs(deviation_of(frame, profile, r, c));
  std::vector<Impulse> found;
  for (int r = begin; r < end; ++r)
    for (int c = 0; c < cols; ++c) {
      const float own = deviation(r - first, c);
      if (own < kThresholds[0] || frame.saturated(r, c)) continue;
      bool alone = true;
      for (int i = std::max(r - 1, first); i < std::min(r + 2, last); ++i)
        for (int k = std::max(c - 1, 0); k < std::min(c + 2, cols); ++k)
          alone &= (i == r && k == c) || deviation(i - first, k) < kBesideLess;
      if (alone) found.push_back({{r, c}, own});
    }
  return found;
}

}  // namespace

std::vector<DefectList::Place> find_impulses(const PreparedFrame& frame,
                                             const NoiseProfile& profile) {
  const std::vector<double> expected = internal::expected_beyond(frame, profile, kThresholds);
  if (expected.front() < kExplained) return {};
  const int bands = (frame.dn.rows() + kBandRows - 1) / kBandRows;
  std::vector<std::vector<Impulse>> of_band(static_cast<std::size_t>(bands));
  parallel_for(0, bands, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int b = static_cast<int>(begin); b < static_cast<int>(end); ++b)
      of_band[static_cast<std::size_t>(b)] = impulses_in(
          frame, profile, b * kBandRows, std::min((b + 1) * kBandRows, frame.dn.rows()));
  });
  for (std::size_t t = 0; t < expected.size(); ++t) {
    std::vector<DefectList::Place> places;
    for (const std::vector<Impulse>& band : of_band)
      for (const Impulse& impulse : band)
        if (impulse.deviation >= kThresholds[t]) places.push_back(impulse.place);
    if (expected[t] >= kExplained * static_cast<double>(places.size())) return places;
  }
  return {};
}

}  // namespace malus
