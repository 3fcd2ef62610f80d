#include "malus/evaluate/polarization_metrics.h"

#include "malus/base/parallel.h"
#include "malus/evaluate/image_metrics.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

bool finite(const Stokes& s) {
  return std::isfinite(s.s0) && std::isfinite(s.s1) && std::isfinite(s.s2);
}

double held_dolp(const Stokes& s) { return s.s0 > 0 ? std::min(dolp_of(s), 1.0) : 0.0; }

// AoLP by the direction of (S1, S2) alone; 0 where there is none.
double direction_deg(const Stokes& s) {
  const double angle = aolp_deg_of({1, s.s1, s.s2});
  return std::isnan(angle) ? 0 : angle;
}

void add_pixel(PolarizationError& error, const Stokes& reference, const Stokes& test) {
  if (!finite(reference) || !finite(test) || !(reference.s0 > 0)) return;
  const double dolp = held_dolp(reference), dolp_error = held_dolp(test) - dolp;
  error.dolp_squared_sum += dolp_error * dolp_error;
  ++error.dolp_count;
  const double angle = aolp_deg_of(reference);
  if (std::isnan(angle)) return;
  const double test_angle = direction_deg(test), linear = (test_angle - angle) / 180;
  error.aolp_squared_sum += linear * linear;
  ++error.aolp_count;
  const double circular = axis_distance_deg(test_angle, angle);
  error.circular_squared_sum_deg2 += dolp * circular * circular;
  error.circular_weight += dolp;
}

PolarizationError error_of_color(const StokesPlanes& reference, const StokesPlanes& test) {
  const int rows = reference.s0.rows(), cols = reference.s0.cols();
  MALUS_REQUIRE(test.s0.rows() == rows && test.s0.cols() == cols);
  return parallel_reduce(
      0, rows, kRowsPerTask, PolarizationError{},
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        PolarizationError part;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
          for (int c = 0; c < cols; ++c)
            add_pixel(part, {reference.s0(r, c), reference.s1(r, c), reference.s2(r, c)},
                      {test.s0(r, c), test.s1(r, c), test.s2(r, c)});
        return part;
      },
      sum_of);
}

}  // namespace

PolarizationError sum_of(const PolarizationError& a, const PolarizationError& b) {
  return {a.dolp_squared_sum + b.dolp_squared_sum,
          a.dolp_count + b.dolp_count,
          a.aolp_squared_sum + b.aolp_squared_sum,
          a.aolp_count + b.aolp_count,
          a.circular_squared_sum_deg2 + b.circular_squared_sum_deg2,
          a.circular_weight + b.circular_weight};
}

double axis_distance_deg(double a_deg, double b_deg) {
  return std::abs(std::remainder(a_deg - b_deg, 180.0));
}

PolarizationError polarization_error(std::span<const StokesPlanes> reference,
                                     std::span<const StokesPlanes> test) {
  MALUS_REQUIRE(reference.size() == test.size());
  PolarizationError total;
  for (std::size_t i = 0; i < reference.size(); ++i)
    total = sum_of(total, error_of_color(reference[i], test[i]));
  return total;
}

Estimate<double> dolp_psnr_db(const PolarizationError& error) {
  if (error.dolp_count == 0) return Undecided{"the reference has no pixel with S0 > 0"};
  return psnr_db(SquaredError{error.dolp_squared_sum, error.dolp_count}, 1.0);
}

Estimate<double> aolp_psnr_db(const PolarizationError& error) {
  if (error.aolp_count == 0) return Undecided{"the reference has no polarized pixel"};
  return psnr_db(SquaredError{error.aolp_squared_sum, error.aolp_count}, 1.0);
}

Estimate<double> aolp_circular_deg(const PolarizationError& error) {
  if (!(error.circular_weight > 0)) return Undecided{"the reference has no polarized pixel"};
  return std::sqrt(error.circular_squared_sum_deg2 / error.circular_weight);
}

}  // namespace malus
