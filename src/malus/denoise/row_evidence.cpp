#include "malus/denoise/internal/row_evidence.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

constexpr int kSegments = 16;          // a row's own spread is judged between this many parts of it
constexpr double kInfluenceEnd = 3.0;  // deviations at which a pixel's influence ends to grow
constexpr int kReweightingsOfRow = 4;
constexpr std::size_t kBegunFrom = 512;  // pixels
constexpr double kLeastSlope = 0.1;      // of a row whose pixels lie in two places, say

struct PixelDifference {
  double value;          // in units of the offsets' deviation
  double per_deviation;  // of its noise, in the same units
  int part;
  double weight() const { return per_deviation * per_deviation; }
};

std::vector<PixelDifference> differences_along(View<const float> dn, const NoiseProfile& profile,
                                               const std::vector<float>& saturated_dn, int row,
                                               int distance) {
  const float *above = dn.row(row - distance), *here = dn.row(row), *below = dn.row(row + distance);
  std::vector<PixelDifference> out;
  out.reserve(static_cast<std::size_t>(dn.cols()));
  for (int c = 0; c < dn.cols(); ++c) {
    const auto k = static_cast<std::size_t>(profile.layout.channel_at(row, c));
    const ChannelProfile& channel = profile.channels[k];
    const double sigma = channel.sigma_row_dn;
    const float top = std::max({above[c], here[c], below[c]});
    if (!(sigma > 0) || !(top < saturated_dn[k]) || !std::isfinite(above[c] + here[c] + below[c]))
      continue;
    const double mean = (static_cast<double>(above[c]) + here[c] + below[c]) / 3.0;
    const double variance = 1.5 * (channel.variance(mean) + sigma * sigma);
    const double difference = here[c] - 0.5 * (static_cast<double>(above[c]) + below[c]);
    out.push_back({difference / sigma, sigma / std::sqrt(variance),
                   static_cast<int>(static_cast<std::ptrdiff_t>(c) * kSegments / dn.cols())});
  }
  return out;
}

// Nothing where such rows lie outside of the frame.
std::vector<PixelDifference> differences_of(View<const float> dn, const NoiseProfile& profile,
                                            const std::vector<float>& saturated_dn, int row,
                                            int distance) {
  if (row - distance < 0 || row + distance >= dn.rows()) return {};
  return differences_along(dn, profile, saturated_dn, row, distance);
}

RowEvidence evidence_for(int row, int distance, int group, double value, double by_noise,
                         double between) {
  const double variance = std::max(by_noise, between);
  return {row / group, (row - distance) / group, (row + distance) / group, value,
          variance,    variance - by_noise};
}

// Weighted sums over one part of a row.
struct SegmentSum {
  double weighted = 0, weight = 0;
};

// Tukey's biweight (Beaton, Tukey, Technometrics 16, 1974): the square of how far off a pixel is, 1
// where it has no influence any more.
double squared_distance_from(double most, double reach, const PixelDifference& p) {
  const double distance = (p.value - most) * p.per_deviation / reach;
  return std::min(distance * distance, 1.0);
}

// By reweighting from the median on; of a wide row that of some pixels will do.
double place_of_most(const std::vector<PixelDifference>& pixels, double reach) {
  const std::size_t count = std::min(pixels.size(), kBegunFrom);
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(pixels[i * pixels.size() / count].value);
  double most = median_of(std::move(values));
  for (int pass = 0; pass < kReweightingsOfRow; ++pass) {
    double weighted = 0, weight = 0;
    for (const PixelDifference& p : pixels) {
      const double keep = 1 - squared_distance_from(most, reach, p), w = p.weight() * keep * keep;
      weighted += w * p.value;
      weight += w;
    }
    if (!(weight > 0)) break;
    most = weighted / weight;
  }
  return most;
}

}  // namespace

std::optional<RowEvidence> row_evidence(View<const float> dn, const NoiseProfile& profile,
                                        const std::vector<float>& saturated_dn, int row,
                                        int periods) {
  const int distance = periods * profile.layout.rows();
  const std::vector<PixelDifference> pixels =
      differences_of(dn, profile, saturated_dn, row, distance);
  if (pixels.empty()) return std::nullopt;
  SegmentSum parts[kSegments];
  double weighted = 0, weight = 0;
  for (const PixelDifference& p : pixels) {
    const double bound = kInfluenceEnd / p.per_deviation;
    SegmentSum& part = parts[p.part];
    part.weighted += p.weight() * std::clamp(p.value, -bound, bound);
    part.weight += p.weight();
  }
  int used = 0;
  for (const SegmentSum& part : parts)
    if (part.weight > 0) {
      weighted += part.weighted;
      weight += part.weight;
      ++used;
    }
  const double value = weighted / weight;
  double spread = 0;
  for (const SegmentSum& part : parts)
    if (part.weight > 0)
      spread += part.weight * part.weight * std::pow(part.weighted / part.weight - value, 2);
  // The pixel noise alone explains 1/weight; texture makes the parts of the row differ by more.
  const double between = used > 1 ? spread / (weight * weight) * used / (used - 1) : 0;
  return evidence_for(row, distance, profile.row_group, value, 1.0 / weight, between);
}

// The variance is that of an estimate that solves an equation (Huber, Ronchetti, Robust Statistics,
// 2009, 3.2): of the sum of the influences over the square of its slope.
std::optional<RowEvidence> evidence_of_most(View<const float> dn, const NoiseProfile& profile,
                                            const std::vector<float>& saturated_dn, int row,
                                            int periods, double reach) {
  const int distance = periods * profile.layout.rows();
  const std::vector<PixelDifference> pixels =
      differences_of(dn, profile, saturated_dn, row, distance);
  if (pixels.empty()) return std::nullopt;
  const double most = place_of_most(pixels, reach);
  double influence[kSegments] = {}, squares = 0, slope = 0, weight = 0;
  for (const PixelDifference& p : pixels) {
    const double off = squared_distance_from(most, reach, p), keep = 1 - off,
                 own = p.weight() * keep * keep * (p.value - most);
    influence[p.part] += own;
    squares += own * own;
    slope += p.weight() * keep * (1 - 5 * off);
    weight += p.weight();
  }
  double of_parts = 0;
  for (const double sum : influence) of_parts += sum * sum;
  const double slope2 = std::pow(std::max(slope, kLeastSlope * weight), 2);
  return evidence_for(row, distance, profile.row_group, most,
                      std::max(squares / slope2, 1.0 / weight),
                      of_parts / slope2 * kSegments / (kSegments - 1));
}

}  // namespace malus
