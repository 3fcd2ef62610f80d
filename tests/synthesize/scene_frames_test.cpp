#include "malus/synthesize/scene_frames.h"

#include "malus/base/error.h"
#include "malus/noise/tukey_lambda.h"
#include "malus/polar/stokes.h"
#include "malus/synthesize/synthesizer.h"

#include <array>
#include <cmath>

#include "../problem_of.h"
#include "bayer_model.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::bayer_model;
using testing::kGain;

constexpr int kLightSide = 40;

// One value per plane everywhere.
Planes even_light(const std::vector<double>& values) {
  Planes planes(static_cast<int>(values.size()), kLightSide, kLightSide);
  for (std::size_t k = 0; k < values.size(); ++k)
    for (float& v : planes[static_cast<int>(k)].values()) v = static_cast<float>(values[k]);
  return planes;
}

NoiseModel model_of(const char* layout) {
  NoiseModel model = bayer_model();
  model.layout = SensorLayout::named(layout);
  model.black_dn.assign(static_cast<std::size_t>(model.layout.channels()), 95.0);
  return model;
}

// Of red, green and blue.
constexpr std::array<Stokes, 3> kLight = {Stokes{0.8, 0.3, 0.1}, Stokes{0.6, -0.2, 0.2},
                                          Stokes{0.4, 0.1, -0.25}};

std::vector<Planes> light_of_angles() {
  std::vector<Planes> angles;
  for (const double angle_deg : {0.0, 45.0, 90.0, 135.0})
    angles.push_back(
        even_light({intensity_behind(kLight[0], angle_deg), intensity_behind(kLight[1], angle_deg),
                    intensity_behind(kLight[2], angle_deg)}));
  return angles;
}

const Stokes& light_behind(Color color) {
  return kLight[color == Color::kRed ? 0 : color == Color::kBlue ? 2 : 1];
}

TEST(SceneFrames, AMosaicSeesEachColourBehindItsPolarizer) {
  const NoiseModel model = model_of("polar-bayer-rggb");
  const CleanScene scene = clean_scene("even", light_of_angles(), model, 16);
  EXPECT_EQ(scene.name, "even");
  ASSERT_EQ(scene.clean_dn.rows(), 16);
  ASSERT_EQ(scene.clean_dn.cols(), 16);
  for (int r = 0; r < 16; ++r)
    for (int c = 0; c < 16; ++c) {
      const Site& site = model.layout.site(model.layout.channel_at(r, c));
      ASSERT_NEAR(scene.clean_dn(r, c),
                  4000 * intensity_behind(light_behind(site.color), *site.angle_deg), 1e-3)
          << r << ' ' << c;
    }
}

TEST(SceneFrames, ASensorWithoutPolarizersSeesTheMeanOfTheAngles) {
  const NoiseModel model = model_of("bayer-rggb");
  const CleanScene scene = clean_scene("even", light_of_angles(), model, 16);
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) {
      const Site& site = model.layout.site(model.layout.channel_at(r, c));
      EXPECT_NEAR(scene.clean_dn(r, c), 4000 * light_behind(site.color).s0 / 2, 1e-3);
    }
}

// As simulate and training do: it was green alone.
TEST(SceneFrames, ASiteWithoutAColourFilterSeesTheMeanOfTheColours) {
  const double mean = (kLight[0].s0 + kLight[1].s0 + kLight[2].s0) / 3;
  const CleanScene mono = clean_scene("even", light_of_angles(), model_of("mono"), 16);
  EXPECT_NEAR(mono.clean_dn(3, 4), 4000 * mean / 2, 1e-3);
  const CleanScene picture =
      clean_scene("one.png", {even_light({0.1, 0.2, 0.9})}, model_of("mono"), 16);
  EXPECT_NEAR(picture.clean_dn(0, 0), 4000 * 0.4, 1e-3);
  const NoiseModel polar = model_of("polar-mono");
  const CleanScene behind = clean_scene("even", light_of_angles(), polar, 16);
  for (int c = 0; c < 2; ++c) {
    const double angle_deg = *polar.layout.site(polar.layout.channel_at(0, c)).angle_deg;
    double light = 0;
    for (const Stokes& color : kLight) light += intensity_behind(color, angle_deg) / 3;
    EXPECT_NEAR(behind.clean_dn(0, c), 4000 * light, 1e-3) << c;
  }
}

TEST(SceneFrames, LightEndsAtTheCamerasWhite) {
  const CleanScene scene = clean_scene("bright", {even_light({1.7})}, model_of("mono"), 16);
  EXPECT_FLOAT_EQ(scene.clean_dn(3, 5), 4000.0f);
}

TEST(SceneFrames, RefusesOnePictureForPolarizersAndLessThanACell) {
  EXPECT_THROW((void)clean_scene("one.png", {even_light({0.5})}, model_of("polar-mono"), 16),
               InputError);
  const Planes pixel(1, 1, 1);
  EXPECT_THROW((void)clean_scene("tiny.png", {pixel}, model_of("bayer-rggb"), 16), InputError);
}

TEST(SceneFrames, ANoisyFrameIsTheSynthesizersOfThatLight) {
  const auto camera = std::make_shared<const NoiseModel>(bayer_model());
  const CleanScene scene = clean_scene("even", {even_light({0.5, 0.4, 0.3})}, *camera, 32);
  const RawFrame frame = noisy_frame(scene, {.gain = 12, .ratio = 10}, camera, 7);
  EXPECT_EQ(frame.source, "even");
  EXPECT_TRUE(frame.gain == kGain);
  SynthesisSettings settings;
  settings.ratio = 10;
  const RawFrame expected =
      Synthesizer(camera, settings)
          .draw_raw(scene.clean_dn, kGain, {.seed = 7}, camera->black_dn, camera->white_dn);
  EXPECT_EQ(frame.dn.values(), expected.dn.values());
}

// Whatever row noise the model had before.
TEST(SceneFrames, DrawnRowNoiseIsTheShareOfTheReadNoiseThatWasAskedFor) {
  constexpr double kDeviations = 2.5;
  constexpr int kRows = 4000;
  NoiseModel before = bayer_model();
  PhysicsCalibration& physics = before.physics.front();
  physics.sigma_row.spread = {3, 3, 3, 3};
  physics.sigma_row.per_frame = {{9, 9, 9, 9}};
  physics.row_drift = {{0.9, 30.0}, 0.02, 0.4};
  SynthesisSettings rows_alone;
  rows_alone.shot = rows_alone.read = rows_alone.quantization = rows_alone.bias = false;
  const Image dn = Synthesizer(with_row_noise(before, kDeviations), rows_alone)
                       .draw(Image(kRows, 2), kGain, {.seed = 3})
                       .dn;
  for (int channel = 0; channel < 4; ++channel) {
    const auto k = static_cast<std::size_t>(channel);
    double sum = 0, products = 0;
    for (int r = channel / 2; r < kRows; r += 2) {
      sum += std::pow(double{dn(r, channel % 2)}, 2);
      if (r >= 2) products += double{dn(r, channel % 2)} * dn(r - 2, channel % 2);
    }
    const double groups = kRows / 2, deviation = std::sqrt(sum / groups);
    const double expected =
        kDeviations * tukey_lambda_deviation(physics.sigma_tl.mean[k], physics.lambda.mean[k]);
    EXPECT_NEAR(deviation / expected, 1, 4 / std::sqrt(2 * groups)) << channel;
    EXPECT_NEAR(products / sum, 0, 4 / std::sqrt(groups)) << channel;
  }
}

TEST(SceneFrames, RowNoiseIsSetInAPhysicsPartAlone) {
  NoiseModel model = bayer_model();
  model.physics.clear();
  model.sensor = "";  // messages name the model then
  EXPECT_EQ(testing::problem_of([&] { (void)with_row_noise(model, 1); }),
            "noise model: has no physics part whose row noise could be set; leave row_noise out");
}

}  // namespace
}  // namespace malus
