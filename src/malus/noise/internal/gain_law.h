// The fits behind the joint model over gain: one parameter against the system gain.
#pragma once

#include "malus/noise/joint_gain.h"

#include <vector>

namespace malus::internal {

/// One parameter over the knots: values, and standard errors (0 where unknown).
struct Series {
  std::vector<double> value, error;
};

/// y = slope x + intercept where the mask is set; the other knots take no part and have no
/// residual.
LogLinear fit_line_law(const std::vector<double>& x, const std::vector<double>& y,
                       const std::vector<double>& error, const std::vector<bool>& usable);

/// Values that are zero or negative have no logarithm.
enum class Logarithm {
  kOfPositive,  ///< the others are left out: variances, where they are sampling error
  kOfAll,       ///< Contract: all are positive
  kNone         ///< the parameter itself is fitted
};

/// Eq. 7 of paper 000 for one parameter.
LogLinear fit_law(const std::vector<double>& log_K, const Series& series, Logarithm logarithm);

/// Whether a bias is a power of K, as Eq. 7 has it: above zero at every gain by more than its error
/// explains, and no nearer to a line in K than to the power. A bias that is the converter's offset
/// plus what the amplifier makes of the pixel's is such a line, and the logarithm of what is nearly
/// zero at one gain would turn the law for all of them.
bool is_power_of_K(const std::vector<double>& log_K, const Series& minus_mu);

}  // namespace malus::internal
