#include "malus/polar/internal/angle_error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace malus::internal {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kHalfRadianDeg = 90.0 / kPi;  // AoLP is half the phase

// Density of the true phase about the seen one, but for a factor.
double phase_density(double signal, double phase, Intensities intensities) {
  const double along = signal * std::cos(phase), across = signal * std::sin(phase);
  const double lengths = std::sqrt(kPi / 2) * std::exp(-0.5 * across * across) *
                         std::erfc(-along / std::numbers::sqrt2);
  if (intensities == Intensities::kMeasured) return lengths;
  return along * lengths + std::exp(-0.5 * signal * signal);
}

double integrated_error_deg2(double signal, Intensities intensities) {
  constexpr int kSteps = 400;
  double sum = 0, squares = 0;
  for (int i = 0; i <= kSteps; ++i) {
    const double phase = kPi * i / kSteps;
    const double weight = phase_density(signal, phase, intensities) *
                          (i == 0 || i == kSteps ? 0.5 : 1.0);  // trapezoids
    sum += weight;
    squares += weight * phase * phase;
  }
  return kHalfRadianDeg * kHalfRadianDeg * squares / sum;
}

// Above it the series of second order is within 0.1 %.
constexpr double kTabulatedSignal = 12, kTableStep = 0.05;
constexpr int kTableSize = static_cast<int>(kTabulatedSignal / kTableStep) + 2;
using ErrorTable = std::array<double, kTableSize>;

ErrorTable error_table(Intensities intensities) {
  ErrorTable table;
  for (int i = 0; i < kTableSize; ++i)
    table[static_cast<std::size_t>(i)] = integrated_error_deg2(i * kTableStep, intensities);
  return table;
}

}  // namespace

double aolp_error_deg2(double signal, Intensities intensities) {
  const bool measured = intensities == Intensities::kMeasured;
  if (!(signal < kTabulatedSignal)) {  // NaN stays one
    const double inverse2 = 1 / (signal * signal);
    return kHalfRadianDeg * kHalfRadianDeg * inverse2 * (1 + (measured ? 2 : 1) * inverse2);
  }
  static const std::array tables = {error_table(Intensities::kMeasured),
                                    error_table(Intensities::kDenoised)};
  const ErrorTable& table = tables[measured ? 0 : 1];
  const double at = signal / kTableStep;
  const auto below = static_cast<std::size_t>(at);
  return std::lerp(table[below], table[below + 1], at - static_cast<double>(below));
}

}  // namespace malus::internal
