#include "malus/noise/fixed_pattern.h"

#include "malus/base/error.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>

namespace malus {
namespace {

double distance_db(const GainSetting& a, const GainSetting& b) {
  const auto x = a.decibel(), y = b.decibel();
  return x && y ? std::abs(*x - *y) : std::numeric_limits<double>::infinity();
}

// Beyond so many deviations of a map an outlier has little sampling error for its size.
constexpr double kOutlier = 4.0;

// Variance of a channel's values about the middle, without outliers: each pass leaves out what is
// one to the variance of the pass before.
std::vector<double> ordinary_variances(const Image& map, const SensorLayout& layout,
                                       double middle) {
  constexpr int kPasses = 3;
  const auto channels = static_cast<std::size_t>(layout.channels());
  std::vector<double> variance(channels, std::numeric_limits<double>::infinity());
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<double> sum(channels, 0.0), count(channels, 0.0);
    for (int row = 0; row < map.rows(); ++row)
      for (int col = 0; col < map.cols(); ++col) {
        const auto c = static_cast<std::size_t>(layout.channel_at(row, col));
        const double square = (map(row, col) - middle) * (map(row, col) - middle);
        if (square > kOutlier * kOutlier * variance[c]) continue;
        sum[c] += square;
        ++count[c];
      }
    for (std::size_t c = 0; c < channels; ++c) variance[c] = count[c] > 0 ? sum[c] / count[c] : 0;
  }
  return variance;
}

// A map holds the sampling error of the frames that it was made of. It is drawn towards its middle
// by that error's share of the variance, as a Wiener filter would, but outliers by less: a column
// of weak response is as weak as it looks. Without that one share of the whole map fits either the
// many pixels or the outliers, and two parts of a frame contradict each other.
void take_sampling_error_out(Image& map, const SensorLayout& layout, double middle,
                             const std::vector<double>& pattern_sd) {
  if (map.empty() || pattern_sd.size() != static_cast<std::size_t>(layout.channels())) return;
  const std::vector<double> variance = ordinary_variances(map, layout, middle);
  for (int row = 0; row < map.rows(); ++row)
    for (int col = 0; col < map.cols(); ++col) {
      const auto c = static_cast<std::size_t>(layout.channel_at(row, col));
      const double error = variance[c] - pattern_sd[c] * pattern_sd[c];
      if (!(error > 0)) continue;
      const double off = map(row, col) - middle,
                   scale = std::max(variance[c], off * off / (kOutlier * kOutlier));
      map(row, col) = static_cast<float>(middle + off * (1 - error / scale));
    }
}

// A copy in which defects, which are told by their place, count as ordinary pixels.
Image nearest_map(const NoiseModel& model, const GainSetting& gain, Image PhysicsCalibration::*map,
                  std::vector<double> PhysicsCalibration::*pattern_sd, float ordinary) {
  const PhysicsCalibration* nearest = nullptr;
  for (const PhysicsCalibration& p : model.physics)
    if (!(p.*map).empty() &&
        (!nearest || distance_db(p.gain, gain) < distance_db(nearest->gain, gain)))
      nearest = &p;
  if (!nearest) return {};
  Image copy = nearest->*map;
  for (const DefectPixel& defect : model.defects) {
    MALUS_REQUIRE(defect.row < copy.rows() && defect.col < copy.cols());  // see contradiction_in
    copy(defect.row, defect.col) = ordinary;
  }
  take_sampling_error_out(copy, model.layout, ordinary, nearest->*pattern_sd);
  return copy;
}

}  // namespace

std::shared_ptr<const FixedPattern> fixed_pattern_at(const NoiseModel& model,
                                                     const GainSetting& gain) {
  FixedPattern pattern{
      nearest_map(model, gain, &PhysicsCalibration::dark_shading_dn, &PhysicsCalibration::dsnu_dn,
                  0),
      nearest_map(model, gain, &PhysicsCalibration::prnu_map, &PhysicsCalibration::prnu, 1)};
  if (pattern.dark_dn.empty() && pattern.response.empty()) return nullptr;
  return std::make_shared<const FixedPattern>(std::move(pattern));
}

double map_values(const NoiseModel& model) {
  double values = 0;
  for (const PhysicsCalibration& p : model.physics)
    values += static_cast<double>(p.dark_shading_dn.size() + p.prnu_map.size());
  return values;
}

void drop_maps(NoiseModel& model) {
  for (PhysicsCalibration& p : model.physics) p.dark_shading_dn = p.prnu_map = Image();
}

}  // namespace malus
