#include "malus/noise/column_noise.h"

#include "malus/base/statistics.h"
#include "malus/noise/physics.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kErrors = 5.0;
// Of smooth light the filter leaves a thousandth of the noise's variance: narrower columns hide
// in it.
constexpr double kOfReadNoise = 0.03;
// What is left for the pixels is the difference of two measured variances.
constexpr double kMostOfVariance = 0.95;

}  // namespace

std::vector<double> column_noise_shares(const PhysicsCalibration& calibration) {
  const std::vector<double> read = read_noise_dn(calibration),
                            &column = calibration.sigma_column.mean,
                            &error = calibration.sigma_column.standard_error;
  std::vector<double> shares(read.size(), 0.0);
  if (read.empty() || column.size() != read.size() || error.size() != read.size()) return shares;
  // Not so either where one of them is not a number.
  if (!(mean_of(column) > kErrors * mean_of(error)) ||
      !(mean_of(column) > kOfReadNoise * mean_of(read)))
    return shares;
  for (std::size_t c = 0; c < shares.size(); ++c)
    if (read[c] > 0) shares[c] = std::min(std::pow(column[c] / read[c], 2), kMostOfVariance);
  return shares;
}

std::vector<double> column_noise_shares_at(const NoiseModel& model, const GainSetting& gain) {
  const auto& gains = model.physics;
  if (gains.size() < 2) return column_noise_shares(gains.front());
  const auto decibel = [](const PhysicsCalibration& p) { return *p.gain.decibel(); };
  const double db = *gain.decibel();
  const auto above = std::find_if(gains.begin(), gains.end(),
                                  [&](const PhysicsCalibration& p) { return decibel(p) >= db; });
  if (above == gains.end()) return column_noise_shares(gains.back());
  std::vector<double> shares = column_noise_shares(*above);
  if (above == gains.begin()) return shares;
  const std::vector<double> below = column_noise_shares(*(above - 1));
  const double t = (db - decibel(*(above - 1))) / (decibel(*above) - decibel(*(above - 1)));
  for (std::size_t c = 0; c < shares.size(); ++c) shares[c] = (1 - t) * below[c] + t * shares[c];
  return shares;
}

}  // namespace malus
