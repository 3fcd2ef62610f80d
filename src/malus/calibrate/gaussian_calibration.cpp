#include "malus/calibrate/gaussian_calibration.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

struct Line {
  double slope = 0, slope_stderr = 0, offset = 0, offset_stderr = 0;
};

struct LevelPoint {
  double signal, variance, weight;
};

// Weighted least squares about the weighted mean of the signals.
Line fitted_line(const std::vector<LevelPoint>& points) {
  double weight = 0, signal = 0, variance = 0;
  for (const LevelPoint& p : points) {
    weight += p.weight;
    signal += p.weight * p.signal;
    variance += p.weight * p.variance;
  }
  signal /= weight;
  variance /= weight;
  double spread = 0, product = 0;
  for (const LevelPoint& p : points) {
    spread += p.weight * (p.signal - signal) * (p.signal - signal);
    product += p.weight * (p.signal - signal) * (p.variance - variance);
  }
  Line line;
  line.slope = product / spread;
  line.offset = variance - line.slope * signal;
  double chi2 = 0;
  for (const LevelPoint& p : points) {
    const double residual = p.variance - line.offset - line.slope * p.signal;
    chi2 += p.weight * residual * residual;
  }
  const double scatter =
      std::sqrt(std::max(1.0, chi2 / (static_cast<double>(points.size()) - 2.0)));
  line.slope_stderr = scatter / std::sqrt(spread);
  line.offset_stderr = scatter * std::sqrt(1.0 / weight + signal * signal / spread);
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
  return out;
}

Estimate<GaussianCalibration> gaussian_of(const NonparametricCalibration& levels,
                                          double highest_dn) {
  GaussianCalibration out;
  // Not the warnings: they are about drawing single levels.
  out.gain = levels.gain;
  for (std::size_t c = 0; c < levels.channels.size(); ++c) {
    const NonparametricChannel& channel = levels.channels[c];
    std::vector<LevelPoint> points;
    double bias = 0, samples = 0;
    for (std::size_t l = 0; l < channel.level_dn.size(); ++l) {
      if (channel.level_dn[l] > highest_dn) continue;
      const LevelMoments moments = level_moments(channel, l);
      const auto n = static_cast<double>(channel.samples[l]);
      const double error = moments.variance_dn2 * std::sqrt(2.0 / n);
      points.push_back({channel.level_dn[l], moments.variance_dn2, 1.0 / (error * error)});
      bias += n * moments.mean_dn;
      samples += n;
    }
    if (points.size() < 3)
      return Undecided{
          fmt::format("{} signal levels of channel {}, and a line needs three", points.size(), c)};
    out.levels = std::max(out.levels, static_cast<int>(points.size()));
    const Line line = fitted_line(points);
    const double sigma_row = levels.sigma_row_dn.empty() ? 0.0 : levels.sigma_row_dn[c];
    const double row_error =
        levels.sigma_row_stderr_dn.empty() ? 0.0 : 2.0 * sigma_row * levels.sigma_row_stderr_dn[c];
    out.slope_dn.push_back(line.slope);
    out.slope_stderr_dn.push_back(line.slope_stderr);
    out.offset_dn2.push_back(line.offset + sigma_row * sigma_row);
    out.offset_stderr_dn2.push_back(std::hypot(line.offset_stderr, row_error));
    out.bias_dn.push_back(bias / samples);
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
                       "give --black and --white");
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
