#include "malus/denoise/row_evidence.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr int kSegments = 16;          // a row's own spread is judged between so many parts of it
constexpr double kInfluenceEnd = 3.0;  // deviations at which a pixel's influence ends to grow
// Deviations at which a pixel has none on where most of the row lies.
constexpr double kNoInfluence = 3.5;
constexpr int kReweightingsOfRow = 4;

struct PixelDifference {
  double value, weight, deviation;  // in units of the offsets' deviation
  int part;
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
    out.push_back({difference / sigma, sigma * sigma / variance, std::sqrt(variance) / sigma,
                   static_cast<int>(static_cast<std::ptrdiff_t>(c) * kSegments / dn.cols())});
  }
  return out;
}

// Weighted sums over one part of a row.
struct SegmentSum {
  double weighted = 0, weight = 0;
};

}  // namespace

std::optional<RowEvidence> row_evidence(View<const float> dn, const NoiseProfile& profile,
                                        const std::vector<float>& saturated_dn, int row,
                                        int periods) {
  const int distance = periods * profile.layout.rows();
  if (row - distance < 0 || row + distance >= dn.rows()) return std::nullopt;
  const std::vector<PixelDifference> pixels =
      differences_along(dn, profile, saturated_dn, row, distance);
  if (pixels.empty()) return std::nullopt;
  SegmentSum parts[kSegments];
  double weighted = 0, weight = 0;
  for (const PixelDifference& p : pixels) {
    const double bound = kInfluenceEnd * p.deviation;
    SegmentSum& part = parts[p.part];
    part.weighted += p.weight * std::clamp(p.value, -bound, bound);
    part.weight += p.weight;
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
  const double variance = std::max(1.0 / weight, between);
  const int group = profile.row_group;
  return RowEvidence{row / group, (row - distance) / group, (row + distance) / group, value,
                     variance,    variance - 1.0 / weight};
}

// Tukey's biweight (Beaton, Tukey, Technometrics 16, 1974), by reweighting from the mean on.
double most_of_row(View<const float> dn, const NoiseProfile& profile,
                   const std::vector<float>& saturated_dn, int row, int periods, double mean) {
  const std::vector<PixelDifference> pixels =
      differences_along(dn, profile, saturated_dn, row, periods * profile.layout.rows());
  double most = mean;
  for (int pass = 0; pass < kReweightingsOfRow; ++pass) {
    double weighted = 0, weight = 0;
    for (const PixelDifference& p : pixels) {
      const double u = (p.value - most) / (kNoInfluence * p.deviation);
      const double keep = std::max(1 - u * u, 0.0), w = p.weight * keep * keep;
      weighted += w * p.value;
      weight += w;
    }
    if (!(weight > 0)) return mean;
    most = weighted / weight;
  }
  return most;
}

}  // namespace malus
