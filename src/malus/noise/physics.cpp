#include "malus/noise/physics.h"

#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>

namespace malus {

double read_variance_dn2(const PhysicsChannel& channel) {
  return channel.sigma_tl_dn * channel.sigma_tl_dn * tukey_lambda_variance(channel.lambda);
}

double pixel_variance_dn2(const PhysicsChannel& channel, double signal_dn, double quantization_dn) {
  return channel.gain_dn_per_e * std::max(signal_dn, 0.0) + read_variance_dn2(channel) +
         quantization_dn * quantization_dn / 12.0;
}

std::vector<double> temporal_sd_dark_dn(const PhysicsNoise& noise) {
  std::vector<double> deviation;
  for (const PhysicsChannel& channel : noise.channels)
    deviation.push_back(std::sqrt(pixel_variance_dn2(channel, 0.0, noise.quantization_dn) +
                                  channel.sigma_row_dn * channel.sigma_row_dn));
  return deviation;
}

std::vector<double> read_noise_dn(const PhysicsCalibration& calibration) {
  std::vector<double> deviation;
  for (std::size_t c = 0; c < calibration.sigma_tl.mean.size(); ++c)
    deviation.push_back(calibration.sigma_tl.mean[c] *
                        std::sqrt(tukey_lambda_variance(calibration.lambda.mean[c])));
  return deviation;
}

std::vector<double> read_noise_e(const PhysicsCalibration& calibration) {
  if (calibration.K.mean.empty()) return {};
  std::vector<double> electrons = read_noise_dn(calibration);
  for (std::size_t c = 0; c < electrons.size(); ++c) electrons[c] /= calibration.K.mean[c];
  return electrons;
}

}  // namespace malus
