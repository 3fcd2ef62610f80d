#include "malus/denoise/internal/variance_lines.h"

#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cmath>
#include <vector>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// 8 DN/e-, the read noise estimated as none, steps of 1 DN.
VarianceCurve shot_noise_alone() {
  internal::VarianceLines lines;
  lines.rounding_dn2 = 1.0 / 12;
  std::vector<internal::VarianceLevel> levels;
  for (const double signal : {5.0, 10.0, 20.0, 40.0}) levels.push_back({signal, 8 * signal, 0.01});
  lines.add(levels, true);
  lines.settle();
  return lines.curves(1.0).front();
}

TEST(VarianceLines, ThatBeginBelowRoundingStayLines) {
  const VarianceCurve curve = shot_noise_alone();
  ASSERT_TRUE(curve.is_affine());
  EXPECT_NEAR(curve.slope_dn(), 8, 1e-3);
  EXPECT_NEAR(curve.offset_dn2(), 1.0 / 12, 1e-9);
}

// A third of the pixels has no electron, and read noise takes half of them below black.
TEST(VarianceLines, KeepTheBrightnessOfOneElectron) {
  const PhysicsNoise noise = equal_channels("mono", {8.0, 0.14, 0, 0.8, 0});
  RawFrame frame = drawn_frame(Image(192, 192, 8.0f), noise, {.black_dn = 200}, 3);
  for (float& v : frame.dn.values()) v = std::round(v);
  NoiseProfile profile = profile_of(noise);
  profile.estimated_from_picture = true;
  profile.channels = {{.variance = shot_noise_alone()}};
  const Image result = denoise_frame(frame, profile, {}).dn_above_black;
  double mean = 0;
  for (const float v : result.values()) mean += double{v} / static_cast<double>(result.size());
  EXPECT_NEAR(mean, 8.0, 0.8);
}

// Four channels of 0.4 DN/e-, the first multiplied by 2 after the conversion: settled together it
// had half of its slope, or more where its own error allowed it.
TEST(VarianceLines, ShareTheirGainButForTheDigitalOne) {
  const std::vector<double> gains = {2, 1, 1, 1};
  const auto lines = [&](double first) {
    internal::VarianceLines out;
    for (std::size_t k = 0; k < gains.size(); ++k) {
      const double gain = k == 0 ? first : 1.0;
      std::vector<internal::VarianceLevel> levels;
      for (const double signal : {100.0, 200.0, 400.0, 800.0})
        levels.push_back({gain * signal, gain * gain * (0.4 * signal + 1), 0.2});
      out.add(levels, true);
    }
    return out;
  };
  internal::VarianceLines multiplied = lines(2);
  EXPECT_TRUE(multiplied.agree_without(gains));
  multiplied.gains = gains;
  multiplied.settle();
  for (const double kept : {1.0, 0.0}) {
    const std::vector<VarianceCurve> curves = multiplied.curves(kept);
    for (std::size_t k = 0; k < gains.size(); ++k)
      EXPECT_NEAR(curves[k](500) / (gains[k] * 200 + gains[k] * gains[k]), 1, 0.01) << k;
  }
  EXPECT_FALSE(lines(1).agree_without(gains));  // what codes tell may be a camera's curve
}

}  // namespace
}  // namespace malus
