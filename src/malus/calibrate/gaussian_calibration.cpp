#include "malus/calibrate/gaussian_calibration.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

struct Line {
  double slope = 0, slope_stderr = 0, offset = 0, offset_stderr = 0;
};

Line weighted_line(const std::vector<LevelNoise>& levels, const std::vector<double>& weights) {
  std::vector<double> signal, variance;
  for (const LevelNoise& level : levels) {
    signal.push_back(level.signal_dn);
    variance.push_back(level.variance_dn2);
  }
  LineFit fit = fit_line(signal, variance, weights, true);
  if (fit.slope < 0) {  // by chance: no noise falls with the light, and the best line left is level
    const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
    fit.slope = 0;
    fit.intercept =
        std::inner_product(weights.begin(), weights.end(), variance.begin(), 0.0) / total;
    fit.intercept_standard_error = 1.0 / std::sqrt(total);
  }
  double chi2 = 0;
  for (std::size_t i = 0; i < levels.size(); ++i) {
    const double residual = variance[i] - fit.intercept - fit.slope * signal[i];
    chi2 += weights[i] * residual * residual;
  }
  const double scatter =
      std::sqrt(std::max(1.0, chi2 / (static_cast<double>(levels.size()) - 2.0)));
  return {fit.slope, scatter * fit.slope_standard_error, fit.intercept,
          scatter * fit.intercept_standard_error};
}

// Half of the darkest levels' variance: a line that chance leads below zero there would give the
// dark infinite weight.
double least_variance(const std::vector<LevelNoise>& levels) {
  constexpr double kEnough = 200;  // a tenth of the variance
  double square = 0, freedom = 0;
  for (const LevelNoise& level : levels) {
    square += level.freedom * level.variance_dn2;
    freedom += level.freedom;
    if (freedom >= kEnough && square > 0) break;
  }
  return 0.5 * square / freedom;
}

// Weights from the line, not from each level's own variance: a level that came out low by chance
// would weigh more for it. Contract: levels rise, their variances are above zero together.
Line fitted_line(const std::vector<LevelNoise>& levels) {
  constexpr int kPasses = 8;
  const double least = least_variance(levels);
  std::vector<double> weights;
  for (const LevelNoise& level : levels) weights.push_back(level.freedom);
  Line line = weighted_line(levels, weights);
  for (int pass = 0; pass < kPasses; ++pass) {
    for (std::size_t i = 0; i < levels.size(); ++i) {
      const double variance = std::max(line.offset + line.slope * levels[i].signal_dn, least);
      weights[i] = 0.5 * levels[i].freedom / (variance * variance);
    }
    line = weighted_line(levels, weights);
  }
  return line;
}

}  // namespace

GaussianCalibration gaussian_of(const PhysicsCalibration& physics) {
  GaussianCalibration out;
  out.gain = physics.gain;
  out.levels = static_cast<int>(
      std::count_if(physics.transfer.begin(), physics.transfer.end(),
                    [](const PhotonTransferPoint& p) { return p.channel == 0 && p.used; }));
  out.slope_dn = physics.K.mean;
  out.slope_stderr_dn = physics.K.standard_error;
  out.bias_dn = physics.mu.mean;
  for (std::size_t c = 0; c < physics.temporal_sd_dark_dn.size(); ++c) {
    const double sd = physics.temporal_sd_dark_dn[c];
    out.offset_dn2.push_back(sd * sd);
    out.offset_stderr_dn2.push_back(2.0 * sd * physics.temporal_sd_dark_stderr_dn[c]);
  }
  if (!physics.dark_point_dn2.empty()) {
    out.offset_dn2 = physics.dark_point_dn2;
    out.offset_stderr_dn2 = physics.dark_point_stderr_dn2;
  }
  return out;
}

Estimate<GaussianCalibration> gaussian_of(const MeasuredLevels& measured, double highest_dn) {
  GaussianCalibration out;
  // Not the warnings: they are about drawing single levels.
  out.gain = measured.distributions.gain;
  out.bias_dn = measured.bias_dn;
  for (std::size_t c = 0; c < measured.noise.size(); ++c) {
    std::vector<LevelNoise> levels;
    double variance = 0;
    for (const LevelNoise& level : measured.noise[c])
      if (level.signal_dn <= highest_dn) {
        levels.push_back(level);
        variance += level.freedom * level.variance_dn2;
      }
    if (levels.size() < 3)
      return Undecided{
          fmt::format("{} signal levels of channel {}, and a line needs three", levels.size(), c)};
    if (!(variance > 0)) return Undecided{fmt::format("channel {} has no noise", c)};
    out.levels = std::max(out.levels, static_cast<int>(levels.size()));
    const Line line = fitted_line(levels);
    out.slope_dn.push_back(line.slope);
    out.slope_stderr_dn.push_back(line.slope_stderr);
    out.offset_dn2.push_back(line.offset + measured.row_variance_dn2[c]);
    out.offset_stderr_dn2.push_back(
        std::hypot(line.offset_stderr, measured.row_variance_stderr_dn2[c]));
  }
  return out;
}

NoiseModel gaussian_model_of(const DngNoiseProfile& profile, const RawFrame& frame) {
  NoiseModel model;
  model.layout = frame.layout;
  model.black_dn = frame.black_dn;
  model.white_dn = frame.white_dn;
  GaussianCalibration gaussian;
  gaussian.gain = frame.gain;
  for (int c = 0; c < model.layout.channels(); ++c) {
    const double range = frame.white_dn - frame.black_dn[static_cast<std::size_t>(c)];
    if (!(range > 0))
      throw InputError("NoiseProfile", fmt::format("white {} lies not above black", frame.white_dn),
                       "give " + setting("black") + " and " + setting("white"));
    const Color color = model.layout.site(c).color;
    const std::size_t plane = profile.slope.size() < 3 || color == Color::kRed ? 0
                              : color == Color::kBlue                          ? 2
                                                                               : 1;
    gaussian.slope_dn.push_back(profile.slope[plane] * range);
    gaussian.offset_dn2.push_back(profile.offset[plane] * range * range);
  }
  gaussian.bias_dn.assign(gaussian.slope_dn.size(), 0.0);
  model.gaussian = {gaussian};
  return model;
}

}  // namespace malus
