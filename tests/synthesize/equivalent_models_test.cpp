// Truth: the physics model's own closed forms, and frames drawn from it.
#include "malus/synthesize/equivalent_models.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/synthesize/synthesizer.h"

#include <cmath>

#include "sample_moments.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::moments_of;

const GainSetting kFrom{{}, 1600.0}, kTo{{}, 3200.0};

NoiseModel camera() { return load_model("nikon-d850"); }

TEST(EquivalentModels, HaveTheMomentsOfThePhysics) {
  const NoiseModel model = with_equivalents(camera(), {kFrom, kTo});
  EXPECT_EQ(contradiction_in(model), "");
  EXPECT_EQ(model.kinds().size(), 3u);
  const PhysicsNoise noise = model.physics_at(kTo);
  const GaussianCalibration gaussian = model.gaussian_at(kTo);
  const NonparametricCalibration measured = model.nonparametric_at(kTo);
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    const PhysicsChannel& channel = noise.channels[c];
    const double row = channel.sigma_row_dn * channel.sigma_row_dn;
    for (std::size_t l = 0; l < measured.channels[c].level_dn.size(); ++l) {
      const double level = measured.channels[c].level_dn[l];
      const double variance = pixel_variance_dn2(channel, level, noise.quantization_dn);
      EXPECT_NEAR(gaussian.slope_dn[c] * level + gaussian.offset_dn2[c], variance + row,
                  1e-9 * variance);
      const LevelMoments pmf = level_moments(measured.channels[c], l);
      EXPECT_NEAR(pmf.mean_dn, channel.mu_dn, 0.02 * std::sqrt(variance));
      // Counting into bins adds a twelfth of their width squared, spreading inside them again; the
      // bins' probabilities are exact to 1e-5.
      const double width =
          measured.channels[c].bin_edges_dn[1] - measured.channels[c].bin_edges_dn[0];
      EXPECT_NEAR(pmf.variance_dn2, variance + width * width / 6, 4e-3 * variance) << level;
    }
  }
}

// Bins a part of the dark noise wide would be without number: it came out as three.
TEST(EquivalentModels, TellNoiseThatIsNoneInTheDark) {
  PhysicsNoise noise = camera().physics_at(kTo);
  noise.quantization_dn = 0;
  for (PhysicsChannel& channel : noise.channels) channel.sigma_tl_dn = 0;
  const NonparametricCalibration measured = nonparametric_equivalent(noise, kTo, 15000, 4);
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    EXPECT_EQ(measured.channels[c].bin_edges_dn.size(), std::size_t{kMostEquivalentBins});
    const double variance = pixel_variance_dn2(noise.channels[c], 15000, 0);
    EXPECT_NEAR(level_moments(measured.channels[c], 3).variance_dn2, variance, 0.01 * variance);
  }
}

TEST(EquivalentModels, LeaveWhatWasMeasured) {
  NoiseModel model = camera();
  GaussianCalibration measured;
  measured.gain = kFrom;
  measured.levels = 3;
  measured.slope_dn = {1, 2, 3, 4};
  measured.offset_dn2 = {5, 6, 7, 8};
  model.gaussian = {measured};
  const NoiseModel more = with_equivalents(model, {kFrom});
  EXPECT_EQ(more.gaussian, model.gaussian);
  EXPECT_EQ(more.nonparametric.size(), 1u);
  EXPECT_EQ(gaussian_of(model, kFrom), model.gaussian.front());
  EXPECT_EQ(gaussian_of(camera(), kFrom).levels, 0);
  model.physics.clear();
  model.joint.reset();
  EXPECT_EQ(with_equivalents(model, {kFrom}), model);
}

// Frames of the lower gain and the difference on top have the higher gain's variance.
TEST(GaussianDifference, AddsWhatTheNoisierGainHasMore) {
  const NoiseModel model = camera();
  Image clean(512, 512);
  for (float& v : clean.values()) v = 900;
  SynthesisSettings settings;
  settings.parameters = "mean";
  settings.row = false;
  settings.bias = false;
  const Image noisy = Synthesizer(model, settings).draw(clean, kFrom, {.seed = 3}).dn;
  GaussianCalibration from = gaussian_of(model, kFrom), to = gaussian_of(model, kTo);
  const CompiledNoise added = gaussian_difference(model.layout, from, to, 0);
  const Image sum = gaussian_on_noise(added, noisy, clean, {.seed = 4});
  const double row_from = std::pow(model.physics_at(kFrom).channels[0].sigma_row_dn, 2);
  const double wanted = to.slope_dn[0] * 900 + to.offset_dn2[0] - row_from;
  // Five standard errors of a variance of 262,144 samples: 5 sqrt(2 / n) = 1.4 %.
  EXPECT_NEAR(moments_of(sum).variance(), wanted, 0.014 * wanted);
  // 900 DN and the difference of the mean biases; five standard errors: 5 sd / 512.
  double bias = 0;
  for (std::size_t c = 0; c < 4; ++c) bias += (to.bias_dn[c] - from.bias_dn[c]) / 4;
  EXPECT_NEAR(moments_of(sum).mean(), 900 + bias, 5 * std::sqrt(wanted) / 512);
}

// The same of physics noise with its rows. A picture from which detail was lost says how much noise
// there is, and the detail stays.
TEST(GaussianDifference, OfPhysicsNoiseHasRowsOfItsOwnAndKeepsTheDetail) {
  PhysicsNoise from, to;
  from.layout = to.layout = SensorLayout::named("mono");
  from.channels = {{.gain_dn_per_e = 0.2, .lambda = 0.14, .sigma_tl_dn = 1}};
  to.channels = {{.gain_dn_per_e = 0.6, .lambda = 0.14, .mu_dn = 2, .sigma_tl_dn = 3}};
  from.channels[0].sigma_row_dn = 3;
  to.channels[0].sigma_row_dn = 5;
  from.quantization_dn = to.quantization_dn = 20;
  const Image noisy(512, 512, 910), guide(512, 512, 900);
  const CompiledNoise added = gaussian_difference(from, to);
  const Image sum = gaussian_on_noise(added, noisy, guide, {.seed = 4});
  const double pixel = 0.4 * 900 + read_variance_dn2(to.channels[0]) -
                       read_variance_dn2(from.channels[0]) - 400 / 12.0;
  Moments rows, pixels;
  for (int r = 0; r < sum.rows(); ++r) {
    Moments row;
    for (int c = 0; c < sum.cols(); ++c) row.add(sum(r, c));
    rows.add(row.mean());
    pixels.add(row.variance());
  }
  // Five standard errors: of 262,144 pixels, and of 512 rows of sqrt(5² - 3²) DN.
  EXPECT_NEAR(pixels.mean(), pixel, 0.014 * pixel);
  EXPECT_NEAR(rows.variance(), 16 + pixel / 512, 5 * std::sqrt(2.0 / 512) * 16.7);
  EXPECT_NEAR(rows.mean(), 912, 5 * 4.1 / std::sqrt(512));
}

}  // namespace
}  // namespace malus
