// Coverage by simulation: a polarized scene known without noise, noise from the generative law, and
// how often two stated deviations hold the truth. The level that docs/denoising.md states is the
// one tested here.
#include "malus/denoise/denoiser.h"
#include "malus/image/pack.h"
#include "malus/noise/model.h"
#include "malus/polar/uncertainty.h"
#include "malus/synthesize/exact.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace malus {
namespace {

// Brightness in waves with an edge, DoLP 5 to 25 %, angles turning slowly.
Image polarized_scene(const SensorLayout& layout, int size, double light) {
  Image dn(size, size);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c) {
      const double wave = 120 + 80 * std::sin(0.03 * r) * std::cos(0.04 * c);
      const double edge = r + 2 * c > 2 * size ? 60 : 0;
      const double dolp = 0.15 + 0.1 * std::sin(0.02 * r), aolp = 0.01 * (r + c);
      const double polarizer =
          *layout.site(layout.channel_at(r, c)).angle_deg * std::numbers::pi / 180;
      dn(r, c) =
          static_cast<float>(light * (wave + edge) * (1 + dolp * std::cos(2 * (polarizer - aolp))));
    }
  return dn;
}

struct Share {
  double inside = 0, all = 0;
  void add(double error, double deviation) {
    inside += std::abs(error) <= 2 * deviation;
    ++all;
  }
  double value() const { return inside / all; }
};

struct Coverage {
  Share pixel, s0, s1, s2, dolp, aolp;
};

Coverage measure(const SensorLayout& layout, double light, std::uint64_t seed) {
  PhysicsNoise noise;
  noise.layout = layout;
  noise.row_group = 2;
  noise.quantization_dn = 0;
  noise.channels.assign(static_cast<std::size_t>(layout.channels()),
                        PhysicsChannel{1.5, 0.1, 0, 1.8, 0.3});
  const Image clean = polarized_scene(layout, 288, light);
  RawFrame frame;
  frame.layout = layout;
  frame.black_dn.assign(noise.channels.size(), 0.0);
  frame.white_dn = 4095;
  frame.source = "simulated";
  frame.dn = clean;
  add_noise_exact(noise, clean, frame.dn, DrawAddress{.seed = seed});
  const Denoised result = denoise_frame(frame, profile_of(noise), {}, silent_progress(), true);

  Coverage coverage;
  for (std::size_t i = 0; i < clean.size(); ++i)
    coverage.pixel.add(result.dn_above_black.values()[i] - clean.values()[i],
                       std::sqrt(result.variance_dn2->values()[i]));
  const auto truth = stokes_per_color(pack(clean, layout), layout);
  const auto estimate = stokes_per_color(pack(result.dn_above_black, layout), layout);
  const auto stated = uncertainty_per_color(estimate, pack(*result.variance_dn2, layout), layout);
  for (std::size_t k = 0; k < truth.size(); ++k) {
    const Image true_dolp = dolp_of(truth[k]), dolp = dolp_of(estimate[k]);
    const Image true_aolp = aolp_deg_of(truth[k]), aolp = aolp_deg_of(estimate[k]);
    for (std::size_t i = 0; i < dolp.size(); ++i) {
      const auto add = [&](Share& share, const Image& a, const Image& b, const Image& variance) {
        share.add(a.values()[i] - b.values()[i], std::sqrt(variance.values()[i]));
      };
      add(coverage.s0, truth[k].s0, estimate[k].s0, stated[k].s0_variance);
      add(coverage.s1, truth[k].s1, estimate[k].s1, stated[k].s1_variance);
      add(coverage.s2, truth[k].s2, estimate[k].s2, stated[k].s2_variance);
      const double sd = stated[k].dolp_sd.values()[i];
      coverage.dolp.add(dolp.values()[i] - true_dolp.values()[i], sd);
      // An angle means something where the polarization stands above its noise.
      if (true_dolp.values()[i] > 2 * sd)
        coverage.aolp.add(
            std::remainder(static_cast<double>(aolp.values()[i]) - true_aolp.values()[i], 180.0),
            stated[k].aolp_sd_deg.values()[i]);
    }
  }
  return coverage;
}

TEST(DenoisedUncertainty, TwoDeviationsHoldTheTruthAsOftenAsStated) {
  for (const char* name : {"polar-mono", "polar-bayer-rggb"})
    for (const double light : {1.0, 0.3, 0.1}) {
      const Coverage c = measure(SensorLayout::named(name), light, 11);
      const std::string what = std::string(name) + ", light " + std::to_string(light);
      for (const Share* share : {&c.s1, &c.s2, &c.dolp, &c.aolp}) {
        EXPECT_GT(share->value(), 0.80) << what;
        EXPECT_LT(share->value(), 0.995) << what;
      }
      EXPECT_GT(c.pixel.value(), 0.75) << what;
      EXPECT_GT(c.s0.value(), 0.65) << what;
    }
}

}  // namespace
}  // namespace malus
