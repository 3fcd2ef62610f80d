// Truth: the definition at places where residuals are chosen, what the law of large numbers says of
// noise alone, and textures known without noise; fixed seeds.
#include "malus/denoise/internal/residual_evidence.h"

#include "malus/base/random.h"
#include "malus/denoise/denoiser.h"
#include "malus/image/pack.h"
#include "malus/noise/model.h"
#include "malus/polar/uncertainty.h"

#include <cmath>
#include <cstdint>
#include <vector>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kReturnedSize = 96;

Image unit_noise_of(std::uint64_t seed) {
  RandomSequence random(seed, 0, Draw::kOther);
  Image noise(kReturnedSize, kReturnedSize);
  for (float& v : noise.values()) v = static_cast<float>(random.normal());
  return noise;
}

// Of an estimate of 0 that states 0.1.
Image stated_of(const Image& samples, const internal::SampleNoise& noise) {
  Image error(samples.rows(), samples.cols(), 0.1f);
  internal::state_residual_evidence(source_of(samples, SensorLayout::named("polar-mono")), noise,
                                    Image(samples.rows(), samples.cols()), error);
  return error;
}

internal::SampleNoise residual_noise_of(float variance = 1, float sure_share = 1,
                                        float uncut = 1e5f, bool hidden = false) {
  return {std::vector<float>(4, uncut), [=](std::size_t, float) { return variance; },
          [=](std::size_t, float) { return hidden; }, sure_share};
}

void expect_everywhere(const Image& error, double stated) {
  for (const float value : error.values()) EXPECT_NEAR(double{value}, stated, 1e-5);
}

TEST(ResidualEvidence, FallsWithTheResidualUpToHalfOfTheNoise) {
  for (const double residual : {0.0, 0.1, 0.3, 0.45}) {
    const Image samples(kReturnedSize, kReturnedSize, static_cast<float>(std::sqrt(residual)));
    expect_everywhere(stated_of(samples, residual_noise_of()),
                      std::max(1.2 * (1 - 2 * residual), 0.1));
    // Of noise that is half as large.
    const Image half(kReturnedSize, kReturnedSize, static_cast<float>(std::sqrt(residual / 2)));
    expect_everywhere(stated_of(half, residual_noise_of(0.5f)),
                      std::max(0.6 * (1 - 2 * residual), 0.1));
  }
}

// The squares of noise alone have a mean of 1; of a neighbourhood of 450 pixels, half of it is
// seven deviations away.
TEST(ResidualEvidence, OfWhatWasFilteredNothingIsStated) {
  expect_everywhere(stated_of(unit_noise_of(4), residual_noise_of()), 0.1);
}

TEST(ResidualEvidence, GrowsWithTheResidualBeyondTheNoise) {
  for (const double residual : {0.9, 1.04, 1.06, 1.3, 2.0}) {
    const Image samples(kReturnedSize, kReturnedSize, static_cast<float>(std::sqrt(residual)));
    const double beyond = residual < 1.05 ? 0 : residual - 1;
    expect_everywhere(stated_of(samples, residual_noise_of()), 0.1 + 1.4 * beyond);
    // Where less is sure than was told, it is what was told that counts; what the frame itself
    // tells holds the texture.
    expect_everywhere(stated_of(samples, residual_noise_of(0.8f, 0.8f)), 0.1 + 1.4 * beyond);
    expect_everywhere(stated_of(samples, residual_noise_of(0.8f, 0)), 0.1);
  }
}

// The wide neighbourhood of column 48 has a residual of 1.1, too; only to the left is it high.
TEST(ResidualEvidence, IsStatedWhereTheResidualIs) {
  Image samples(kReturnedSize, kReturnedSize, 0.9f);
  for (int r = 0; r < kReturnedSize; ++r)
    for (int c = 0; c < 32; ++c) samples(r, c) = 1.4f;
  const Image error = stated_of(samples, residual_noise_of());
  for (int r = 0; r < kReturnedSize; ++r) {
    EXPECT_GT(error(r, 4), 0.5);
    EXPECT_NEAR(error(r, 48), 0.1, 1e-6);
  }
}

TEST(ResidualEvidence, WhereNoiseIsCutOffOrHiddenNothingIsConcluded) {
  const Image samples(kReturnedSize, kReturnedSize);
  expect_everywhere(stated_of(samples, residual_noise_of(1, 1, -0.1f)), 0.1);
  expect_everywhere(stated_of(samples, residual_noise_of(1, 1, 1e5f, true)), 0.1);
}

// White texture of half of the noise's deviation, a quarter of its variance: of 128x128 pixels that
// is known to a ninth. Before, a fourth of the squared error was stated.
TEST(ResidualEvidence, TextureThatDrownsIsStated) {
  const PhysicsNoise noise = equal_channels("mono", {0.5, 0.1, 0.0, 1.2, 0.0});
  Image clean(128, 128);
  RandomSequence random(8, 0, Draw::kOther);
  for (float& v : clean.values())
    v = 1500 + 13.7F * static_cast<float>(random.normal());  // the noise has 27.4 DN
  const Denoised result = denoise_frame(drawn_frame(clean, noise, {.white_dn = 4000}, 11),
                                        profile_of(noise), {}, silent_progress(), true);
  double squares = 0, stated = 0;
  for (std::size_t i = 0; i < clean.size(); ++i) {
    squares += std::pow(double{result.dn_above_black.values()[i]} - clean.values()[i], 2);
    stated += double{result.variance_dn2->values()[i]};
  }
  EXPECT_NEAR(squares / stated, 0.9, 0.3);
}

// White texture of ten deviations of the noise: the filter returns the frame. Before, 0.73 of the
// squared error was stated, of S1 and S2 half.
class ReturnedTexture : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Methods, ReturnedTexture, ::testing::Values("nl-ridge", "bm3d"));

TEST_P(ReturnedTexture, IsStatedWithItsNoise) {
  const PhysicsNoise noise = equal_channels("polar-mono", {0.5, 0.1, 0.0, 1.2, 0.0});
  Image clean(kReturnedSize, kReturnedSize);
  const Image texture = unit_noise_of(8);
  for (std::size_t i = 0; i < clean.size(); ++i)
    clean.values()[i] = 1500 + 270 * texture.values()[i];  // the noise has 27 DN
  const Denoised result =
      denoise_frame(drawn_frame(clean, noise, {.white_dn = 4000}, 11), profile_of(noise),
                    {.method = GetParam()}, silent_progress(), true);
  const SensorLayout layout = SensorLayout::named("polar-mono");
  const auto stokes = [&](const Image& dn) {
    return stokes_per_color(pack(dn.view(), layout), layout);
  };
  const auto shown = stokes(result.dn_above_black), truth = stokes(clean);
  const StokesUncertainty u = uncertainty_per_color(
      shown, pack(result.variance_dn2->view(), layout), layout, Intensities::kDenoised)[0];
  const auto squares_over_stated = [](const Image& a, const Image& b, const Image& variance) {
    double squares = 0, stated = 0;
    for (std::size_t i = 0; i < a.size(); ++i) {
      squares += std::pow(double{a.values()[i]} - double{b.values()[i]}, 2);
      stated += double{variance.values()[i]};
    }
    return squares / stated;
  };
  // 9216 pixels: five standard errors are 7 %, of 2304 values of S1 and S2 15 %.
  EXPECT_NEAR(squares_over_stated(result.dn_above_black, clean, *result.variance_dn2), 0.86, 0.07);
  EXPECT_NEAR(squares_over_stated(shown[0].s1, truth[0].s1, u.s1_variance), 1.28, 0.15);
  EXPECT_NEAR(squares_over_stated(shown[0].s2, truth[0].s2, u.s2_variance), 1.28, 0.15);
}

}  // namespace
}  // namespace malus
