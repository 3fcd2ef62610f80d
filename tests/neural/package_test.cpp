// Truth: closed forms and simulation from the generative law, not the functions under test.
#include "malus/neural/package.h"

#include "malus/base/error.h"
#include "malus/neural/inference.h"
#include "malus/neural/internal/kernels.h"
#include "malus/noise/model.h"
#include "malus/synthesize/synthesizer.h"

#include <cmath>
#include <filesystem>
#include <tuple>

#include "problem_of.h"
#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using testing::problem_of;

NetworkPackage small_package(PackageSettings settings = {}) {
  NetworkPackage package;
  package.settings = settings;
  package.network = fitted_network({"unet", {{"width", 2}}}, settings);
  package.training = {{"steps", 3}};
  return package;
}

// A frame with a smooth picture, drawn with the built-in camera's noise.
struct Camera {
  NoiseModel model = load_model("imx250myr-simulated");
  GainSetting gain{12.0, {}};
  NoiseProfile profile = model.profile_at(gain);
  Image clean_dn;

  Camera(int rows, int cols) : clean_dn(rows, cols) {
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        clean_dn(r, c) = static_cast<float>(150 + 100 * std::sin(0.03 * r) * std::cos(0.02 * c));
  }
  RawFrame noisy() const {
    SynthesisSettings settings;
    settings.parameters = "mean";
    settings.row = false;
    return Synthesizer(model, settings)
        .draw_raw(clean_dn, gain, {.seed = 1}, model.black_dn, model.white_dn);
  }
};

TEST(Package, KeepsItsDescriptionAndWeightsThroughAFile) {
  PackageSettings settings;
  settings.guide = "bm3d";
  settings.row_noise = false;
  const NetworkPackage package = small_package(settings);
  EXPECT_EQ(package.input_planes(), 33);
  const auto network = make_network(package.network);
  const testing::TemporaryFolder folder;
  const auto path = folder / "package.safetensors";
  save_tensor_file(package_file(package, *network), path);
  const LoadedPackage loaded = load_package(path);
  EXPECT_EQ(loaded.package.settings.guide, "bm3d");
  EXPECT_FALSE(loaded.package.settings.row_noise);
  EXPECT_EQ(loaded.package.training, package.training);
  const torch::NoGradGuard no_gradients;
  const auto input = torch::ones({1, 33, 16, 16});
  EXPECT_TRUE(torch::equal(apply_network(*network, package, input),
                           apply_network(*loaded.network, loaded.package, input)));
}

TEST(Package, RefusesDescriptionsThatDoNotFit) {
  const NetworkPackage package = small_package();
  const auto network = make_network(package.network);
  const TensorFile good = package_file(package, *network);
  const auto damaged = [&](const char* from, const char* to) {
    TensorFile file = good;
    std::string& text = file.metadata.at("malus_package");
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    text.replace(at, std::string(from).size(), to);
    return file;
  };
  EXPECT_NO_THROW(package_of(good, "weights"));
  TensorFile without = good;
  without.metadata.erase("malus_package");
  EXPECT_THROW(package_of(without, "weights"), InputError);
  EXPECT_THAT(problem_of([&] { package_of(damaged("stabilised", "stabilized"), "weights"); }),
              AllOf(HasSubstr("\"domain\" is \"stabilized\""), HasSubstr("mean \"stabilised\"?")));
  EXPECT_THROW(package_of(damaged("\"guide\"", "\"guise\""), "weights"), InputError);
  EXPECT_THROW(package_of(damaged("polar-bayer-rggb", "bayer-rggb"), "weights"), InputError);
  EXPECT_THROW(package_of(damaged("\"level\"", "\"none\""), "weights"), InputError);
  EXPECT_THROW(package_of(damaged("\"version\":1", "\"version\":9"), "weights"), InputError);
  EXPECT_THROW(package_of(damaged("{", "["), "weights"), InputError);
}

// Whatever is wrong with a weight file, the line begins with its name.
TEST(Package, NamesTheFileThatItRefuses) {
  const NetworkPackage package = small_package();
  const TensorFile good = package_file(package, *make_network(package.network));
  const auto subject = [&](const char* key, const std::string& from, const std::string& to) {
    TensorFile file = good;
    std::string& text = file.metadata.at(key);
    text.replace(text.find(from), from.size(), to);
    try {
      package_of(file, "w.safetensors");
    } catch (const InputError& error) {
      return error.subject();
    }
    return std::string("taken");
  };
  EXPECT_EQ(subject("malus_package", "polar-bayer-rggb", "polar-bayer-rgbb"), "w.safetensors");
  EXPECT_EQ(subject("malus_package", "\"mosaic\"", "\"rgb\""), "w.safetensors");
  EXPECT_EQ(subject("architecture", "unet", "wnet"), "w.safetensors");
}

TEST(Package, RefusesWeightsThatAreNotNumbers) {
  const NetworkPackage package = small_package();
  const auto network = make_network(package.network);
  {
    const torch::NoGradGuard no_gradients;
    network->parameters().front().view(-1)[0] = std::nan("");
  }
  const testing::TemporaryFolder folder;
  const auto path = folder / "nan.safetensors";
  save_tensor_file(package_file(package, *network), path);
  EXPECT_THROW(load_package(path), InputError);
}

TEST(Package, AResidualNetworkOfZerosReturnsItsBase) {
  const std::vector<NetworkDescription> networks = {
      {"unet", {{"width", 2}}},
      {"nafnet",
       {{"width", 2}, {"middle_blk_num", 1}, {"enc_blk_nums", {1}}, {"dec_blk_nums", {1}}}},
      {"malus", {{"dim", 8}, {"depths", {1, 1}}, {"heads", {1, 1}}}}};
  for (const NetworkDescription& described : networks) {
    NetworkPackage package = small_package();
    package.network = fitted_network(described, package.settings);
    const auto network = make_network(package.network);
    const torch::NoGradGuard no_gradients;
    for (auto& parameter : network->parameters()) parameter.zero_();
    const auto input = torch::rand({1, package.input_planes(), 16, 16});
    const auto output = apply_network(*network, package, input);
    EXPECT_TRUE(torch::allclose(output, input.slice(1, 0, 16))) << described.architecture;
  }
}

class Domain : public ::testing::TestWithParam<const char*> {};

TEST_P(Domain, CleanSignalsComeBackAndNoisySamplesHaveTheirMeanAndDeviation) {
  const Camera camera(382, 515);  // not whole cells
  PackageSettings settings;
  settings.domain = GetParam();
  const NetworkFrame frame = prepare_network_frame(camera.noisy(), camera.profile, settings);
  const FrameDomain& domain = frame.domain;
  const auto clean = domain.clean_planes(camera.clean_dn);
  ASSERT_EQ(clean.sizes(), (std::vector<std::int64_t>{1, 16, 96, 129}));
  const Image back = domain.mosaic_of(clean, 382, 515);
  for (int r = 0; r < 382; ++r)
    for (int c = 0; c < 515; ++c) ASSERT_NEAR(back(r, c), camera.clean_dn(r, c), 0.05);
  // What is left of noisy - clean has mean 0 and the stated deviation; 792,576 samples: five
  // standard errors are .006 and .004. The quantisation to whole DN and the approximate
  // stabilisation allow the rest.
  const auto noise = domain.noise_planes(frame.frame.dn);
  EXPECT_EQ(noise.size(1), std::string(GetParam()) == "linear" ? 16 : 1);
  const auto z = (domain.noisy_planes(frame.frame.dn) - clean) / noise;
  EXPECT_NEAR(z.mean().item<double>(), 0.0, std::string(GetParam()) == "linear" ? 0.06 : 0.02);
  EXPECT_NEAR(z.std().item<double>(), 1.0, 0.03);
}

INSTANTIATE_TEST_SUITE_P(Both, Domain, ::testing::Values("stabilised", "linear"));

TEST(FrameInDomain, AWindowIsAPartOfTheWholeAndTheGuideComesBack) {
  const Camera camera(128, 192);
  PackageSettings settings;
  settings.guide = "bm3d";
  settings.guide_profile = "fast";
  const NetworkFrame frame = prepare_network_frame(camera.noisy(), camera.profile, settings);
  const auto whole = prepare_input(frame, {0, 0, 128, 192});
  const auto part = prepare_input(frame, {32, 64, 40, 80});
  EXPECT_TRUE(torch::equal(part, whole.slice(2, 8, 18).slice(3, 16, 36)));
  const Image guide = restore_output(frame, whole.slice(1, 0, 16), {0, 0, 128, 192});
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 192; ++c) ASSERT_NEAR(guide(r, c), frame.guide_dn(r, c), 0.05);
  DenoiseSettings classical;
  classical.method = "bm3d";
  classical.profile = "fast";
  EXPECT_EQ(frame.guide_dn,
            denoise_frame(camera.noisy(), camera.profile, classical).dn_above_black);
}

PackageSettings settings_without_rows(const std::string& domain) {
  PackageSettings settings;
  settings.domain = domain;
  settings.row_noise = false;
  settings.layout = "polar-bayer-rggb";
  return settings;
}

// A frame of another order is the same sensor from another pixel on: the same planes but for the
// first ones, which repeat their neighbours. Every channel has a bias and a noise of its own.
TEST(FrameInDomain, AnotherOrderIsTheSameSensorFromAnotherPixel) {
  for (const char* domain : {"linear", "stabilised"}) {
    const PackageSettings settings = settings_without_rows(domain);
    Camera camera(64, 96);
    for (std::size_t k = 0; k < 16; ++k) {
      camera.profile.channels[k].bias_dn = static_cast<double>(k);
      camera.profile.channels[k].variance =
          VarianceCurve::affine(0.1 + 0.02 * static_cast<double>(k), 4);
    }
    const RawFrame whole = camera.noisy();
    RawFrame part = whole;
    part.layout = SensorLayout::named("polar-bayer-grbg");
    part.dn = Image(64, 94);
    for (int r = 0; r < 64; ++r)
      for (int c = 0; c < 94; ++c) part.dn(r, c) = whole.dn(r, c + 2);
    NoiseProfile profile = camera.profile;
    profile.layout = part.layout;
    for (int k = 0; k < 16; ++k) {
      const auto from = static_cast<std::size_t>(k / 4 * 4 + (k + 2) % 4);
      profile.channels[static_cast<std::size_t>(k)] = camera.profile.channels[from];
      part.black_dn[static_cast<std::size_t>(k)] = whole.black_dn[from];
    }
    const NetworkFrame of_whole = prepare_network_frame(whole, camera.profile, settings);
    const NetworkFrame of_part = prepare_network_frame(part, profile, settings);
    const auto expected = prepare_input(of_whole, {0, 0, 64, 96}) * of_whole.domain.scale();
    const auto planes = prepare_input(of_part, {0, 0, 64, 94}) * of_part.domain.scale();
    ASSERT_EQ(planes.sizes(), expected.sizes());
    EXPECT_TRUE(torch::allclose(planes.slice(3, 1), expected.slice(3, 1), 1e-4, 1e-3)) << domain;
    // The first columns of the 0 and 90 degree pairs that the part lacks are those of the next
    // cell.
    EXPECT_TRUE(
        torch::equal(planes.slice(1, 0, 1).slice(3, 0, 1), planes.slice(1, 0, 1).slice(3, 1, 2)));
    const auto window = prepare_input(of_part, {8, 14, 16, 20}) * of_part.domain.scale();
    EXPECT_TRUE(torch::equal(window, planes.slice(2, 2, 6).slice(3, 4, 9))) << domain;
    const Image back =
        restore_output(of_part, of_part.domain.clean_planes(of_part.frame.dn), {0, 0, 64, 94});
    for (int r = 0; r < 64; ++r)
      for (int c = 0; c < 94; ++c) ASSERT_NEAR(back(r, c), of_part.frame.dn(r, c), 0.05) << domain;
  }
}

// A frame of mono polarization is one of colour polarization of grey light, whatever the four
// channels' noise and bias: the same planes, and the same way back.
TEST(FrameInDomain, ASensorWithoutColoursSeesGrey) {
  for (const char* domain : {"linear", "stabilised"}) {
    const PackageSettings settings = settings_without_rows(domain);
    Camera camera(63, 94);
    const RawFrame colored = camera.noisy();
    RawFrame grey = colored;
    grey.layout = SensorLayout::named("polar-mono");
    grey.black_dn.resize(4);
    NoiseProfile profile = camera.profile;
    profile.layout = grey.layout;
    profile.channels.resize(4);
    for (std::size_t k = 0; k < 4; ++k) {
      profile.channels[k].bias_dn = static_cast<double>(k);
      profile.channels[k].variance = VarianceCurve::affine(0.1 + 0.1 * static_cast<double>(k), 4);
    }
    for (int r = 0; r < 4; ++r)
      for (int c = 0; c < 4; ++c)
        camera.profile.channels[static_cast<std::size_t>(colored.layout.channel_at(r, c))] =
            profile.channels[static_cast<std::size_t>(grey.layout.channel_at(r, c))];
    const NetworkFrame as_grey = prepare_network_frame(grey, profile, settings);
    const NetworkFrame as_colored = prepare_network_frame(colored, camera.profile, settings);
    const auto planes = prepare_input(as_grey, {0, 0, 63, 94});
    EXPECT_TRUE(torch::equal(planes, prepare_input(as_colored, {0, 0, 63, 94}))) << domain;
    const auto window = prepare_input(as_grey, {9, 13, 18, 21});
    EXPECT_TRUE(torch::equal(window, prepare_input(as_colored, {9, 13, 18, 21}))) << domain;
    const auto signal = as_grey.domain.clean_planes(as_grey.frame.dn);
    EXPECT_EQ(restore_output(as_grey, signal, {0, 0, 63, 94}),
              restore_output(as_colored, signal, {0, 0, 63, 94}))
        << domain;
  }
}

// Black levels far apart: a channel of low black has light above the range of the others.
TEST(FrameInDomain, AChannelIsBrightUpToItsOwnWhite) {
  const Camera camera(64, 64);
  RawFrame raw = camera.noisy();
  constexpr float kRaisedDn = 3000, kLightDn = 3900;  // white is 4013 above the lowest black
  for (std::size_t k = 1; k < raw.black_dn.size(); ++k) raw.black_dn[k] += double{kRaisedDn};
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) raw.dn(r, c) += raw.layout.channel_at(r, c) > 0 ? kRaisedDn : 0;
  const NetworkFrame frame = prepare_network_frame(raw, camera.profile, PackageSettings());
  const auto planes = frame.domain.noisy_planes(Image(64, 64, kLightDn));
  EXPECT_NEAR(frame.domain.mosaic_of(planes, 64, 64)(0, 0), kLightDn, 1);
}

// Grey light is grey, whatever bends the estimate found in single channels.
TEST(FrameInDomain, ChannelsOfAnEstimateShareOneLine) {
  const Camera camera(64, 64);
  NoiseProfile profile = camera.profile;
  profile.channels[3].variance = VarianceCurve::table({500, 4000}, {2, 3000});
  const auto spread = [&] {
    const NetworkFrame frame = prepare_network_frame(camera.noisy(), profile, PackageSettings());
    const auto planes = frame.domain.clean_planes(Image(64, 64, 800.0F));
    return (planes.max() - planes.min()).item<double>() * frame.domain.scale();
  };
  EXPECT_GT(spread(), 5.0);  // deviations of the noise
  profile.estimated_from_picture = true;
  EXPECT_LT(spread(), 1e-3);
}

// Shot noise alone leaves none where there is no light: units of it would be 0.
TEST(FrameInDomain, NoNoiseIsNoUnit) {
  const Camera camera(64, 64);
  NoiseProfile profile = camera.profile;
  for (ChannelProfile& channel : profile.channels) channel.variance = VarianceCurve::affine(2, 0);
  PackageSettings settings;
  settings.domain = "linear";
  settings.noise_input = "units";
  const NetworkFrame frame = prepare_network_frame(camera.noisy(), profile, settings);
  const auto deviation_at = [&](float dn) {
    const torch::Tensor planes = frame.domain.noise_planes(Image(8, 8, dn));
    EXPECT_TRUE(torch::equal(planes, torch::full_like(planes, planes.max().item<float>())));
    return planes.max().item<double>() * frame.domain.scale();
  };
  EXPECT_NEAR(deviation_at(200), 20, 1e-5);
  EXPECT_NEAR(deviation_at(0), Stabilizer::kLeastDeviation * frame.frame.highest_dn, 1e-8);
  EXPECT_EQ(deviation_at(-5), deviation_at(0));
}

TEST(FrameInDomain, AsksForTheRatioWhereItNeedsIt) {
  const Camera camera(64, 64);
  PackageSettings settings;
  settings.domain = "linear";
  settings.amplification = "ratio";
  EXPECT_THROW(prepare_network_frame(camera.noisy(), camera.profile, settings), InputError);
  const NetworkFrame frame =
      prepare_network_frame(camera.noisy(), camera.profile, settings, {}, 10.0);
  EXPECT_DOUBLE_EQ(frame.domain.scale(), frame.frame.range_dn / 10);
  settings.layout = "bayer-rggb";
  EXPECT_THROW(prepare_network_frame(camera.noisy(), camera.profile, settings, {}, 10.0),
               InputError);
}

// Layers of libtorch round nothing, and an Uformer of this width has no kernels.
TEST(Package, WhatHasNoKernelsIsNotCalledBfloat16) {
  const testing::TemporaryFolder folder;
  for (const auto& [architecture, width, kernels] :
       {std::tuple{"nafnet", "width", true}, {"uformer", "embed_dim", false}}) {
    NetworkPackage package;
    package.network = fitted_network({architecture, {{width, 8}}}, package.settings);
    const auto path = folder / "w.safetensors";
    save_tensor_file(package_file(package, *make_network(package.network)), path);
    InferenceSettings settings;
    settings.precision = "bfloat16";
    const std::string taken = NetworkInference(path, settings).description().at("precision");
    EXPECT_EQ(taken, kernels && internal::rounded_products_pay() ? "bfloat16" : "float32")
        << architecture;
  }
}

}  // namespace
}  // namespace malus
