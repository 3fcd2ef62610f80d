// Truth: NetworkInference, on the frame that the validation draws.
#include "malus/neural/internal/validation.h"

#include "malus/image/middle.h"
#include "malus/neural/inference.h"
#include "malus/neural/internal/clean_scenes.h"
#include "malus/synthesize/scene.h"

#include <algorithm>

#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kSeed = 5;
constexpr int kSide = 48;

TrainingConfig guided_config(const testing::AngleScene& scene) {
  TrainingConfig config = testing::scene_config(scene);
  config.package.settings.guide = "nl-ridge";
  config.package.network =
      fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
  config.validation_scenes = {scene.path};
  config.cases = {{12, 10}};
  config.validation.crop = kSide;
  return config;
}

RawFrame first_frame(const TrainingConfig& config) {
  const NoiseModel camera = load_model(config.models.front());
  SynthesisSettings settings = config.synthesis;
  settings.ratio = config.cases.front().ratio;
  const Synthesizer synthesizer(camera, settings);
  Image clean =
      middle_of(mosaic_of(load_angle_scene(config.validation_scenes.front()), camera.layout),
                camera.layout, kSide);
  const double white = white_above_black(camera.white_dn, camera.black_dn);
  for (float& dn : clean.values()) dn *= static_cast<float>(white);
  return synthesizer.draw_raw(clean, GainSetting{12.0, {}},
                              synthesizer.somewhere(kSide, kSide, kSeed, std::uint32_t{0}),
                              camera.black_dn, camera.white_dn);
}

// Weights at random, whose corrections are far too large; and light of which some is brighter than
// that of training.
TEST(Validation, ScoresWhatDenoisingGives) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  const TrainingConfig config = guided_config(scene);
  const NoiseProfile profile =
      load_model(config.models.front()).profile_at({12.0, {}}, GainRange::kCalibratedOnly);
  Validation validation(config, kSeed, silent_progress());
  for (const double brightest : {1e6, 8.0, 1e-3}) {
    NetworkPackage package = config.package;
    package.brightest = brightest;
    torch::manual_seed(1);
    const auto network = make_network(package.network);
    {
      const torch::NoGradGuard no_gradients;
      for (torch::Tensor& weights : network->parameters()) weights.normal_(0, 0.3);
    }
    network->eval();
    save_tensor_file(package_file(package, *network), folder / "w.safetensors");
    Image denoised = NetworkInference(folder / "w.safetensors", {})
                         .denoise(first_frame(config), profile, {}, silent_progress())
                         .dn_above_black;
    validation.save_sample(*network, package, folder / "sample");
    const Image sample = load_picture(folder / "sample" / "network.npy").planes[0];
    const Image guide = load_picture(folder / "sample" / "guide.npy").planes[0];
    ASSERT_EQ(sample.size(), denoised.size());
    float largest = 0, correction = 0;
    for (int r = 0; r < kSide; ++r)
      for (int c = 0; c < kSide; ++c) {
        largest = std::max(largest, std::abs(sample(r, c) - 10 * denoised(r, c)));
        correction = std::max(correction, std::abs(sample(r, c) - guide(r, c)));
      }
    EXPECT_LT(largest, 0.05) << brightest;
    if (brightest < 1)
      EXPECT_LT(correction, 0.05);
    else
      EXPECT_GT(correction, 5);
    const ValidationScore score = validation.score(*network, package, silent_progress());
    EXPECT_NEAR(score.image_psnr_db, validation.guide_score().image_psnr_db,
                brightest < 1 ? 1e-4 : 3.0)
        << brightest;
  }
}

// The frame that the validation draws, as the sample shows it: "noisy" or "clean", in the clean
// scene's light.
Image sample_of(const TrainingConfig& config, const testing::TemporaryFolder& folder,
                const std::string& name) {
  const Validation validation(config, kSeed, silent_progress());
  const auto network = make_network(config.package.network);
  validation.save_sample(*network, config.package, folder / "sample");
  return load_picture(folder / "sample" / (name + ".npy")).planes[0];
}

// A picture's light is polarized as in training, alike in every run; else DoLP and AoLP would tell
// nothing of a network.
TEST(Validation, LightOfAPictureIsPolarized) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = guided_config(scene);
  config.validation_scenes = {folder / "grey.exr"};
  save_picture(config.validation_scenes.front(), Image(64, 64, 0.4F));
  const Image clean = sample_of(config, folder, "clean");
  const auto [least, most] = std::ranges::minmax(clean.values());
  EXPECT_GT(most, 1.1F * least);
  EXPECT_TRUE(std::ranges::equal(clean.values(), sample_of(config, folder, "clean").values()));
  EXPECT_TRUE(Validation(config, kSeed + 1, silent_progress()).noisy_score().aolp_circular_deg);
}

// Behind every polarizer half the light of a picture is left that is not polarized.
TEST(Validation, LightOfAPictureIsUnpolarizedWhereTrainingsIs) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = guided_config(scene);
  config.data.polarized = false;
  config.validation_scenes = {folder / "grey.exr"};
  save_picture(config.validation_scenes.front(), Image(64, 64, 0.5F));
  const NoiseModel camera = load_model(config.models.front());
  const double white = white_above_black(camera.white_dn, camera.black_dn);
  const Image clean = sample_of(config, folder, "clean");
  ASSERT_EQ(clean.size(), std::size_t{kSide} * kSide);
  for (const float dn : clean.values()) ASSERT_NEAR(dn, 0.25 * white, 0.1);
}

// Highlights above white, of which no frame shows more than white: the light of training is held
// to it as well. A frame in full light then differs from its reference by noise alone.
TEST(Validation, CleanLightIsHeldToWhite) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  const NoiseModel camera = load_model("nikon-d850");
  const double white = white_above_black(camera.white_dn, camera.black_dn);
  TrainingConfig config = testing::scene_config(scene);
  config.models = {"nikon-d850"};
  config.package.settings.layout = "bayer-rggb";
  config.validation_scenes = {folder / "bright.exr"};
  Image bright(64, 64, 0.5F);
  for (int r = 0; r < 64; ++r)
    for (int c = 32; c < 64; ++c) bright(r, c) = 1.4F;
  save_picture(config.validation_scenes.front(), bright);
  config.cases = {{400, 1}};
  config.validation.crop = kSide;
  config.package.network =
      fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
  const Image clean = sample_of(config, folder, "clean");
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      ASSERT_NEAR(clean(r, c), (c < kSide / 2 ? 0.5 : 1.0) * white, 1e-3 * white);
  EXPECT_GT(Validation(config, kSeed, silent_progress()).noisy_score().image_psnr_db, 35);
  config.package.settings.domain = "linear";
  config.package.settings.residual = false;
  config.package.settings.target = "rgb";
  config.package.network =
      fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
  EXPECT_GT(Validation(config, kSeed, silent_progress()).noisy_score().image_psnr_db, 25);
}

// So it has no error of AoLP, and counts for that of the other scenes as if it were not there.
TEST(Validation, AFrameWithoutAMetricIsNotCountedAsZero) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = guided_config(scene);
  config.data.polarized = false;
  const fs::path grey = folder / "grey.exr";
  save_picture(grey, Image(64, 64, 0.5F));
  const auto noisy = [&](const std::vector<fs::path>& scenes) {
    config.validation_scenes = scenes;
    return Validation(config, kSeed, silent_progress()).noisy_score();
  };
  const ValidationScore polarized = noisy({scene.path}), unpolarized = noisy({grey}),
                        both = noisy({scene.path, grey});
  EXPECT_FALSE(unpolarized.aolp_circular_deg);
  EXPECT_TRUE(unpolarized.dolp_psnr_db);
  EXPECT_DOUBLE_EQ(both.aolp_circular_deg.value(), polarized.aolp_circular_deg.value());
  EXPECT_LT(both.dolp_psnr_db.value(),
            std::max(*polarized.dolp_psnr_db, *unpolarized.dolp_psnr_db));
}

// The same draws with the bias and without it: taken out of the frames that hold it, they differ
// by their rounding.
TEST(Validation, BiasThatWasNotDrawnIsNotTakenOut) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  TrainingConfig config = guided_config(scene);
  const NoiseProfile profile =
      load_model(config.models.front()).profile_at({12.0, {}}, GainRange::kCalibratedOnly);
  ASSERT_GT(std::abs(profile.channels.front().bias_dn), 0.9);
  const Image with = sample_of(config, folder, "noisy");
  config.synthesis.bias = false;
  const Image without = sample_of(config, folder, "noisy");
  double difference = 0;
  for (std::size_t i = 0; i < with.size(); ++i)
    difference += double{with.values()[i]} - without.values()[i];
  EXPECT_NEAR(difference / static_cast<double>(with.size()) / config.cases.front().ratio, 0, 0.1);
}

TEST(Validation, StopsWhereAsked) {
  const testing::TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  const TrainingConfig config = guided_config(scene);
  const Validation validation(config, kSeed, silent_progress());
  const auto network = make_network(config.package.network);
  EXPECT_THROW(validation.score(*network, config.package, testing::StopAfter(0)), Cancelled);
}

}  // namespace
}  // namespace malus
