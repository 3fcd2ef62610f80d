#include "malus/noise/physics.h"

#include "malus/noise/tukey_lambda.h"

#include <algorithm>

namespace malus {

double read_variance_dn2(const PhysicsChannel& channel) {
  return channel.sigma_tl_dn * channel.sigma_tl_dn * tukey_lambda_variance(channel.lambda);
}

double pixel_variance_dn2(const PhysicsChannel& channel, double signal_dn, double quantization_dn) {
  return channel.gain_dn_per_e * std::max(signal_dn, 0.0) + read_variance_dn2(channel) +
         quantization_dn * quantization_dn / 12.0;
}

}  // namespace malus
