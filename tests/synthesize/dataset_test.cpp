// Samples are functions of seed and number; geometry comes before noise and keeps the layout.
#include "malus/synthesize/dataset.h"

#include "malus/base/error.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

namespace malus {
namespace {

const SensorLayout kLayout = SensorLayout::named("polar-bayer-rggb");

Synthesizer synthesizer_with(double ratio, bool amplify, bool quiet) {
  SynthesisSettings settings;
  settings.ratio = ratio;
  settings.amplify = amplify;
  settings.debias = true;
  settings.parameters = "mean";
  if (quiet)
    settings.shot = settings.read = settings.row = settings.quantization = settings.bias = false;
  return Synthesizer(load_model("builtin:imx250myr-simulated"), settings);
}

DatasetSettings small_settings() {
  DatasetSettings settings;
  settings.patch = 16;
  return settings;
}

TEST(SampleRecipe, IsAFunctionOfSeedAndNumberInsideTheSource) {
  const DatasetSettings settings = small_settings();
  const std::vector<std::pair<int, int>> sizes{{64, 48}, {20, 200}};
  std::set<std::tuple<std::size_t, int, int, int, double>> seen;
  for (std::uint32_t n = 0; n < 300; ++n) {
    const SampleRecipe a = sample_recipe(settings, kLayout, 2, sizes, 5, n);
    const SampleRecipe b = sample_recipe(settings, kLayout, 2, sizes, 5, n);
    EXPECT_EQ(a.row0, b.row0);
    EXPECT_EQ(a.col0, b.col0);
    EXPECT_EQ(a.row0 % 4, 0);
    EXPECT_EQ(a.col0 % 4, 0);
    EXPECT_LE(a.row0 + 20, sizes[a.source].first);
    EXPECT_LE(a.col0 + 20, sizes[a.source].second);
    EXPECT_TRUE(lattice_shift(kLayout, a.symmetry).has_value());
    seen.emplace(a.source, a.row0, a.col0, static_cast<int>(a.symmetry), a.ratio);
  }
  EXPECT_GT(seen.size(), 150u);
}

TEST(SampleRecipe, ImpossiblePatchesAreRefused) {
  DatasetSettings settings = small_settings();
  EXPECT_THROW(sample_recipe(settings, kLayout, 2, {{16, 16}}, 0, 0), InputError);
  settings.symmetries = false;
  EXPECT_NO_THROW(sample_recipe(settings, kLayout, 2, {{16, 16}}, 0, 0));
  settings.patch = 18;
  EXPECT_THROW(sample_recipe(settings, kLayout, 2, {{64, 64}}, 0, 0), InputError);
}

// Every pixel tells its colour and angle by its value: after any symmetry of the recipe the patch
// must read as the layout says, with the angles turned with the picture.
TEST(TrainingPairs, TurnedPatchesKeepTheLayout) {
  DatasetSettings settings = small_settings();
  Image source(64, 64);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) {
      const Site& site = kLayout.site(kLayout.channel_at(r, c));
      const int color = site.color == Color::kGreen2 ? static_cast<int>(Color::kGreen1)
                                                     : static_cast<int>(site.color);
      source(r, c) = static_cast<float>(1000 * color + site.angle_deg.value());
    }
  const Synthesizer quiet = synthesizer_with(10, true, true);
  std::set<Symmetry> used;
  for (std::uint32_t n = 0; n < 40; ++n) {
    SampleRecipe recipe = sample_recipe(settings, kLayout, 2, {{64, 64}}, 1, n);
    recipe.ratio = 10;
    used.insert(recipe.symmetry);
    const TrainingPair pair =
        make_pair_of(recipe, settings, source, quiet, GainSetting{.gain_db = 24.0, .iso = {}}, 1);
    for (int r = 0; r < 16; ++r)
      for (int c = 0; c < 16; ++c) {
        const Site& site = kLayout.site(kLayout.channel_at(r, c));
        const int value = static_cast<int>(pair.clean_dn(r, c) + 0.5f);
        const int color = site.color == Color::kGreen2 ? static_cast<int>(Color::kGreen1)
                                                       : static_cast<int>(site.color);
        ASSERT_EQ(value / 1000, color) << r << ' ' << c;
        ASSERT_EQ(angle_after(recipe.symmetry, value % 1000), site.angle_deg.value());
        ASSERT_NEAR(pair.noisy_dn(r, c), pair.clean_dn(r, c), 1e-3f * pair.clean_dn(r, c) + 1e-3f);
      }
  }
  EXPECT_EQ(used.size(), 2u);  // identity and the anti-transpose
}

TEST(TrainingPairs, DependOnSeedAndNumberAlone) {
  const DatasetSettings settings = small_settings();
  const Image source(64, 64, 800.0f);
  const Synthesizer synthesizer = synthesizer_with(10, false, false);
  const auto draw = [&](std::uint64_t seed, std::uint32_t number) {
    SampleRecipe recipe = sample_recipe(settings, kLayout, 2, {{64, 64}}, seed, number);
    recipe.ratio = 10;
    return make_pair_of(recipe, settings, source, synthesizer, std::nullopt, seed);
  };
  const TrainingPair one = draw(1, 7), again = draw(1, 7), other = draw(1, 8), seeded = draw(2, 7);
  EXPECT_EQ(one.noisy_dn.values(), again.noisy_dn.values());
  EXPECT_NE(one.noisy_dn.values(), other.noisy_dn.values());
  EXPECT_NE(one.noisy_dn.values(), seeded.noisy_dn.values());
  EXPECT_FLOAT_EQ(one.clean_dn(0, 0), 80.0f);  // not amplified: the dim clean signal
}

// A network must not see the same few pixels' fixed patterns in every pair.
TEST(TrainingPairs, OfDarkFramesComeFromAllOverTheSensor) {
  NoiseModel model = load_model("builtin:imx250myr-simulated");
  Image dark(64, 64);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) dark(r, c) = static_cast<float>(64 * r + c);
  model.dark_frames = {{.gain = {.gain_db = 12.0, .iso = {}}, .frames_dn = {dark}}};
  SynthesisSettings synthesis;
  synthesis.kind = "dark-frames";
  synthesis.shot = false;
  const Synthesizer synthesizer(model, synthesis);
  const DatasetSettings settings = small_settings();
  const Image clean(32, 32);
  std::set<float> corners;
  for (std::uint32_t n = 0; n < 100; ++n) {
    const SampleRecipe recipe = sample_recipe(settings, kLayout, 2, {{32, 32}}, 5, n);
    const TrainingPair pair = make_pair_of(recipe, settings, clean, synthesizer,
                                           GainSetting{.gain_db = 12.0, .iso = {}}, 5);
    corners.insert(pair.noisy_dn(0, 0));
    for (int c = 0; c < 16; ++c)  // one place, not two sides of a seam
      ASSERT_EQ(pair.noisy_dn(15, c), pair.noisy_dn(0, 0) + static_cast<float>(15 * 64 + c));
  }
  EXPECT_GT(corners.size(), 50u);  // of 13 x 13 places
}

}  // namespace
}  // namespace malus
