#include "malus/synthesize/equivalent_models.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/noise/level_noise.h"
#include "malus/synthesize/renoise.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kReach = 7.0;         // of the brightest level's deviation, to either side
constexpr double kBinPerSigma = 0.25;  // of the dark deviation

double at(const std::vector<double>& values, std::size_t channel) {
  return values.empty() ? 0.0 : values[channel];
}

}  // namespace

GaussianCalibration gaussian_equivalent(const PhysicsNoise& noise, const GainSetting& gain) {
  GaussianCalibration g;
  g.gain = gain;
  for (const PhysicsChannel& channel : noise.channels) {
    g.slope_dn.push_back(channel.gain_dn_per_e);
    g.offset_dn2.push_back(pixel_variance_dn2(channel, 0.0, noise.quantization_dn) +
                           channel.sigma_row_dn * channel.sigma_row_dn);
    g.bias_dn.push_back(channel.mu_dn);
  }
  return g;
}

NonparametricCalibration nonparametric_equivalent(const PhysicsNoise& noise,
                                                  const GainSetting& gain, double white_dn,
                                                  int levels) {
  NonparametricCalibration n;
  n.gain = gain;
  n.channels.resize(noise.channels.size());
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    const PhysicsChannel& channel = noise.channels[c];
    const auto sigma = [&](double signal_dn) {
      return std::sqrt(pixel_variance_dn2(channel, signal_dn, noise.quantization_dn));
    };
    const double reach = kReach * sigma(white_dn) + std::abs(channel.mu_dn);
    constexpr double kMostHalf = (kMostEquivalentBins - 1) / 2;
    const int half = static_cast<int>(  // without noise in the dark there is no end of them
        std::clamp(std::ceil(reach / (kBinPerSigma * sigma(0))), 1.0, kMostHalf));
    const int bins = 2 * half + 1;
    const double width = 2 * reach / bins;
    NonparametricChannel& measured = n.channels[c];
    for (int b = 0; b <= bins; ++b) measured.bin_edges_dn.push_back(width * (b - 0.5 * bins));
    for (int l = 0; l < levels; ++l) {
      const double share = static_cast<double>(l) / (levels - 1);
      measured.level_dn.push_back(white_dn * share * share);
    }
    measured.pmf.resize(measured.level_dn.size());
    PhysicsNoise unrounded = noise;
    unrounded.quantization_dn = 0;
    const PixelBins pixel(noise, static_cast<int>(c)), dark(unrounded, static_cast<int>(c));
    parallel_for(0, levels, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (auto l = static_cast<std::size_t>(begin); l < static_cast<std::size_t>(end); ++l) {
        const bool rounded = !before_rounding(measured, l, noise.quantization_dn);
        auto& pmf = measured.pmf[l] =
            (rounded ? pixel : dark).probabilities(measured.level_dn[l], width, bins);
        double sum = 0;
        for (const double p : pmf) sum += p;
        for (double& p : pmf) p /= sum;
      }
    });
    n.sigma_row_dn.push_back(channel.sigma_row_dn);
    n.K.push_back(channel.gain_dn_per_e);
  }
  return n;
}

NoiseModel with_equivalents(NoiseModel model, const std::vector<GainSetting>& gains) {
  if (model.physics.empty()) return model;
  const bool gaussian = model.gaussian.empty(), nonparametric = model.nonparametric.empty();
  const double white = white_above_black(model.white_dn, model.black_dn);
  for (const GainSetting& gain : gains) {
    const PhysicsNoise noise = model.physics_at(gain);
    if (gaussian) model.gaussian.push_back(gaussian_equivalent(noise, gain));
    if (nonparametric) model.nonparametric.push_back(nonparametric_equivalent(noise, gain, white));
  }
  return model;
}

GaussianCalibration gaussian_of(const NoiseModel& model, const GainSetting& gain) {
  return model.gaussian.empty() ? gaussian_equivalent(model.physics_at(gain), gain)
                                : model.gaussian_at(gain);
}

CompiledNoise gaussian_difference(const SensorLayout& layout, const GaussianCalibration& from,
                                  const GaussianCalibration& to, double quantization_dn) {
  std::vector<GaussianChannel> channels;
  for (std::size_t c = 0; c < to.slope_dn.size(); ++c)
    channels.push_back({.slope_dn = to.slope_dn[c] - from.slope_dn[c],
                        .offset_dn2 = to.offset_dn2[c] - from.offset_dn2[c] -
                                      quantization_dn * quantization_dn / 12.0,
                        .mu_dn = at(to.bias_dn, c) - at(from.bias_dn, c)});
  return CompiledNoise::gaussian(layout, channels, 1);
}

CompiledNoise gaussian_difference(const PhysicsNoise& from, const PhysicsNoise& to) {
  std::vector<GaussianChannel> channels;
  const double rounding = from.quantization_dn * from.quantization_dn / 12.0;
  for (std::size_t c = 0; c < to.channels.size(); ++c) {
    const PhysicsChannel &one = from.channels[c], &two = to.channels[c];
    channels.push_back(
        {.slope_dn = two.gain_dn_per_e - one.gain_dn_per_e,
         .offset_dn2 = read_variance_dn2(two) - read_variance_dn2(one) - rounding,
         .sigma_row_dn = std::sqrt(std::max(
             two.sigma_row_dn * two.sigma_row_dn - one.sigma_row_dn * one.sigma_row_dn, 0.0)),
         .mu_dn = two.mu_dn - one.mu_dn});
  }
  return CompiledNoise::gaussian(to.layout, channels, to.row_group);
}

Image gaussian_on_noise(const CompiledNoise& difference, View<const float> noisy_dn,
                        View<const float> guide_dn, const DrawAddress& address) {
  MALUS_REQUIRE(noisy_dn.rows() == guide_dn.rows() && noisy_dn.cols() == guide_dn.cols());
  Image dn(guide_dn.rows(), guide_dn.cols());
  difference.apply(guide_dn, dn, second_noise(address));
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) dn(r, c) += noisy_dn(r, c) - guide_dn(r, c);
  return dn;
}

}  // namespace malus
