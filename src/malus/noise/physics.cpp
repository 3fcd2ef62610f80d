#include "malus/noise/physics.h"

#include "malus/base/statistics.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {

double read_variance_dn2(const PhysicsChannel& channel) {
  return channel.sigma_tl_dn * channel.sigma_tl_dn * tukey_lambda_variance(channel.lambda);
}

double pixel_variance_dn2(const PhysicsChannel& channel, double signal_dn, double quantization_dn) {
  return channel.gain_dn_per_e * std::max(signal_dn, 0.0) + read_variance_dn2(channel) +
         quantization_dn * quantization_dn / 12.0;
}

double dark_deviation_dn(const PhysicsChannel& channel, double quantization_dn) {
  return std::sqrt(pixel_variance_dn2(channel, 0.0, quantization_dn) +
                   channel.sigma_row_dn * channel.sigma_row_dn);
}

std::vector<double> temporal_sd_dark_dn(const PhysicsNoise& noise) {
  std::vector<double> deviation;
  for (const PhysicsChannel& channel : noise.channels)
    deviation.push_back(dark_deviation_dn(channel, noise.quantization_dn));
  return deviation;
}

std::vector<double> read_noise_dn(const PhysicsCalibration& calibration) {
  std::vector<double> deviation;
  for (std::size_t c = 0; c < calibration.sigma_tl.mean.size(); ++c)
    deviation.push_back(
        tukey_lambda_deviation(calibration.sigma_tl.mean[c], calibration.lambda.mean[c]));
  return deviation;
}

std::vector<double> read_noise_e(const PhysicsCalibration& calibration) {
  if (calibration.K.mean.empty()) return {};
  std::vector<double> electrons = read_noise_dn(calibration);
  for (std::size_t c = 0; c < electrons.size(); ++c) electrons[c] /= calibration.K.mean[c];
  return electrons;
}

std::vector<double> read_noise_stderr_e(const PhysicsCalibration& calibration) {
  constexpr std::size_t kFewestFrames = 20;
  constexpr double kStep = 1e-4;  // of λ, for the slope of ln(sd)
  std::vector<double> errors = read_noise_e(calibration);
  for (std::size_t c = 0; c < errors.size(); ++c) {
    const double scale = calibration.sigma_tl.mean[c], lambda = calibration.lambda.mean[c];
    const double slope =
        0.25 / kStep *
        std::log(tukey_lambda_variance(lambda + kStep) / tukey_lambda_variance(lambda - kStep));
    Moments relative;  // deviation of each frame's read noise, to first order
    const auto& scales = calibration.sigma_tl.per_frame;
    const auto& lambdas = calibration.lambda.per_frame;
    for (std::size_t f = 0; f < std::min(scales.size(), lambdas.size()); ++f) {
      const double deviation = (scales[f][c] - scale) / scale + slope * (lambdas[f][c] - lambda);
      if (std::isfinite(deviation)) relative.add(deviation);
    }
    const auto frames = static_cast<double>(relative.count());
    // N frames about their own mean tell as much as N - 1.
    const double read = frames < kFewestFrames ? std::numeric_limits<double>::quiet_NaN()
                                               : std::sqrt(relative.variance() / (frames - 1.0));
    const auto& K_errors = calibration.K.standard_error;
    const double K_error = K_errors.empty() ? std::numeric_limits<double>::quiet_NaN()
                                            : K_errors[c] / calibration.K.mean[c];
    errors[c] *= std::hypot(read, K_error);
  }
  return errors;
}

}  // namespace malus
