#include "malus/evaluate/uncertainty_check.h"

#include "malus/image/pack.h"
#include "malus/polar/uncertainty.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

void add_variances(Coverage& coverage, const Image& truth, const Image& estimate,
                   const Image& variance) {
  for (std::size_t i = 0; i < truth.size(); ++i)
    coverage.add(double{estimate.values()[i]} - truth.values()[i],
                 std::sqrt(double{variance.values()[i]}));
}

void add_polarization(UncertaintyCheck& check, const StokesPlanes& truth,
                      const StokesPlanes& estimate, const StokesUncertainty& stated) {
  const Image true_dolp = dolp_of(truth), dolp = dolp_of(estimate);
  const Image true_aolp_deg = aolp_deg_of(truth), aolp_deg = aolp_deg_of(estimate);
  for (std::size_t i = 0; i < dolp.size(); ++i) {
    const double deviation = stated.dolp_sd.values()[i];
    check.as_it_is.add(dolp.values()[i], true_dolp.values()[i]);
    check.corrected.add(stated.dolp_corrected.values()[i], true_dolp.values()[i]);
    check.dolp.add(double{dolp.values()[i]} - true_dolp.values()[i], deviation);
    if (true_dolp.values()[i] > 2 * deviation)
      check.aolp.add(
          std::remainder(double{aolp_deg.values()[i]} - true_aolp_deg.values()[i], 180.0),
          stated.aolp_sd_deg.values()[i]);
  }
}

}  // namespace

void Coverage::add(double error, double deviation) {
  if (!std::isfinite(error) || !std::isfinite(deviation)) return;
  inside += std::abs(error) <= 2 * deviation;
  squared_error += error * error;
  stated += deviation * deviation;
  ++all;
}

void DolpError::add(double dolp, double truth) {
  if (std::isnan(truth) || std::isnan(dolp)) return;
  const double error = std::min(dolp, 1.0) - std::min(truth, 1.0);
  sum += error;
  squared.sum += error * error;
  ++squared.count;
}

void add_uncertainty(UncertaintyCheck& check, View<const float> truth, View<const float> estimate,
                     View<const float> variance, const SensorLayout& layout) {
  MALUS_REQUIRE(truth.rows() == estimate.rows() && truth.cols() == estimate.cols() &&
                truth.rows() == variance.rows() && truth.cols() == variance.cols());
  for (int r = 0; r < truth.rows(); ++r)
    for (int c = 0; c < truth.cols(); ++c) {
      const double error = double{estimate(r, c)} - truth(r, c);
      check.pixel.add(error, std::sqrt(double{variance(r, c)}));
    }
  if (!layout.polarized()) return;
  const auto true_stokes = stokes_per_color(pack(truth, layout), layout);
  const auto stokes = stokes_per_color(pack(estimate, layout), layout);
  const auto stated =
      uncertainty_per_color(stokes, pack(variance, layout), layout, Intensities::kDenoised);
  for (std::size_t k = 0; k < stokes.size(); ++k) {
    add_variances(check.s0, true_stokes[k].s0, stokes[k].s0, stated[k].s0_variance);
    add_variances(check.s1, true_stokes[k].s1, stokes[k].s1, stated[k].s1_variance);
    add_variances(check.s2, true_stokes[k].s2, stokes[k].s2, stated[k].s2_variance);
    add_polarization(check, true_stokes[k], stokes[k], stated[k]);
  }
}

}  // namespace malus
