// Tables of published calibrations, from which builtin_models.cpp makes noise models.
#pragma once

#include <array>
#include <vector>

namespace malus::internal {

struct PublishedGain {
  double iso, K, lambda, sigma_tl_dn, sigma_tl_sd_dn, sigma_row_dn, sigma_row_sd_dn, bias_sd_dn;
};
const std::vector<PublishedGain>& sony_a7s2_gains();

/// log x = slope log K + bias, sd sigma about it.
struct PublishedLaw {
  double slope, bias, sigma;
};

struct PublishedCamera {
  const char* name;
  const char* sensor;
  double K_min, lambda;  ///< K at the lowest ISO; the source's laws reach to 64 times that
  PublishedLaw sigma_tl, sigma_row;
  std::array<double, 4> bias_dn;
  std::array<double, 16> bias_covariance_dn2;
};
const std::vector<PublishedCamera>& eld_cameras();

}  // namespace malus::internal
