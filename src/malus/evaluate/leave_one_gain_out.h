// How well does a noise model predict a gain that was not measured? Every measured gain is left out
// once, predicted from the others, and compared with what was measured there.
#pragma once

#include "malus/noise/model.h"

#include <string>
#include <vector>

namespace malus {

/// One gain left out. Errors are relative (predicted / measured - 1), of the channel that is worst.
struct LeftOutGain {
  GainSetting gain;
  std::string why_not;  ///< why it cannot be predicted (an end of a range); empty when it can
  double K_error = 0, read_error = 0, row_error = 0;  ///< physics: K, read noise sd, sigma_row
  double mu_error_dn = 0;  ///< physics: predicted - measured, for a bias may be 0
  /// Base 2, worst channel. Physics: the read noise of the two Tukey-lambda laws in steps of the
  /// converter. Non-parametric: all levels of the left-out gain together, each with equal weight,
  /// in its own bins.
  double sqrt_jsd = 0;
  /// The same if the nearest measured gain were taken as it is: what interpolation is worth.
  double sqrt_jsd_nearest = 0;
};

/// Physics gains (those with K). Empty when the model has fewer than three.
std::vector<LeftOutGain> leave_one_gain_out_physics(const NoiseModel& model);

/// Non-parametric gains; K_error and read_error stay 0. Empty when there are fewer than three.
std::vector<LeftOutGain> leave_one_gain_out_nonparametric(const NoiseModel& model);

}  // namespace malus
