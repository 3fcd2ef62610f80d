// Stated variances against a truth: how often two deviations hold it, and how large the error is.
#pragma once

#include "malus/evaluate/image_metrics.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <cstdint>

namespace malus {

/// One quantity's errors against its stated deviations.
struct Coverage {
  std::int64_t inside = 0, all = 0;
  double squared_error = 0, stated = 0;  ///< sums over all, in the quantity's unit squared

  /// Leaves out what is not a number.
  void add(double error, double deviation);
  /// How often two deviations hold the truth; 0.954 of Gaussian errors.
  double share() const { return static_cast<double>(inside) / static_cast<double>(all); }
  /// Squared error over what was stated of it: 1 is honest.
  double error_over_stated() const { return squared_error / stated; }
};

/// Errors of DoLP, held to [0, 1] on both sides, where the truth has any.
struct DolpError {
  double sum = 0;
  SquaredError squared;

  void add(double dolp, double truth);
  double mean() const { return sum / static_cast<double>(squared.count); }
};

/// Sums over pixels and over frames that are added to one another; NaN shares where nothing was
/// counted (DoLP and all after it without angles).
struct UncertaintyCheck {
  Coverage pixel, s0, s1, s2, dolp;
  Coverage aolp;  ///< where the true DoLP is above two of its deviations: else no angle is meant
  DolpError as_it_is, corrected;  ///< DoLP, and what polar/uncertainty.h makes of it
};

/// Mosaics of one layout and size, DN above black; variance in DN². Stokes parameters of every
/// colour at one per cell, variances propagated as polar/uncertainty.h does.
void add_uncertainty(UncertaintyCheck& check, View<const float> truth, View<const float> estimate,
                     View<const float> variance, const SensorLayout& layout);

}  // namespace malus
