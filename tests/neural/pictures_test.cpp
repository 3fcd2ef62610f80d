// Networks that give pictures. Truth: closed forms (the sRGB curve of IEC 61966-2-1, colours that a
// mosaic's own sites must show), whole against tiled, and what the file formats say.
#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/io/picture_file.h"
#include "malus/neural/inference.h"
#include "malus/neural/internal/example_pool.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/internal/tiles.h"
#include "malus/neural/trainer.h"
#include "malus/polar/color_map.h"
#include "malus/polar/demosaick.h"
#include "malus/synthesize/scene.h"
#include "malus/synthesize/synthesizer.h"

#include <cmath>
#include <fstream>

#include "problem_of.h"
#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;
using testing::TemporaryFolder;

constexpr const char* kCamera = "nikon-d850";

PackageSettings picture_settings(const std::string& target) {
  PackageSettings settings;
  settings.layout = "bayer-rggb";
  settings.target = target;
  settings.domain = "linear";
  settings.noise_input = "none";
  settings.residual = false;
  settings.row_noise = false;
  return settings;
}

NetworkPackage picture_package(const std::string& target) {
  NetworkPackage package;
  package.settings = picture_settings(target);
  package.network = fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, package.settings);
  return package;
}

// Smooth colours, as fractions of white.
Planes colors(int rows, int cols) {
  Planes rgb(3, rows, cols);
  for (int k = 0; k < 3; ++k)
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        rgb[k](r, c) =
            static_cast<float>(0.3 + 0.15 * std::sin(0.2 * r + k) + 0.1 * std::cos(0.15 * c - k));
  return rgb;
}

int color_of(const SensorLayout& layout, int row, int col) {
  const Color color = layout.site(layout.channel_at(row, col)).color;
  return color == Color::kRed ? 0 : color == Color::kBlue ? 2 : 1;
}

// A frame of those colours.
struct PictureShot {
  explicit PictureShot(int rows, int cols) : rgb_dn(colors(rows, cols)) {
    const double white = model.white_dn - model.black_dn.front();
    for (Image& plane : rgb_dn)
      for (float& v : plane.values()) v *= static_cast<float>(white);
    clean_dn = mosaic_of(unpolarized(rgb_dn), model.layout);
    SynthesisSettings settings;
    settings.parameters = "mean";
    noisy = Synthesizer(model, settings)
                .draw_raw(clean_dn, gain, {.seed = 2}, model.black_dn, model.white_dn);
  }
  NoiseModel model = load_model(kCamera);
  GainSetting gain{{}, 1600.0};
  NoiseProfile profile = model.profile_at(gain);
  Planes rgb_dn;
  Image clean_dn;
  RawFrame noisy;
};

TEST(PicturePackage, HasAHeadOfThreeColoursAtTheMosaicsSize) {
  const NetworkPackage package = picture_package("rgb");
  EXPECT_EQ(package.output_planes(), 3);
  EXPECT_EQ(package.network.settings["upscale"], 2);
  const auto network = make_network(package.network);
  const auto output = apply_network(*network, package, torch::rand({2, 4, 10, 6}));
  EXPECT_EQ(output.sizes(), (std::vector<std::int64_t>{2, 3, 20, 12}));
  const TensorFile file = package_file(package, *network);
  EXPECT_EQ(package_of(file, "weights").settings.target, "rgb");
}

TEST(PicturePackage, RefusesWhatDoesNotFitTogether) {
  const auto refused = [](const char* architecture, void (*change)(PackageSettings&)) {
    PackageSettings settings = picture_settings("srgb");
    change(settings);
    EXPECT_THROW(fitted_network({architecture, {}}, settings), InputError);
  };
  refused("nafnet", [](PackageSettings&) {});
  refused("unet", [](PackageSettings& s) { s.layout = "polar-bayer-rggb"; });
  refused("unet", [](PackageSettings& s) { s.domain = "stabilised"; });
  refused("unet", [](PackageSettings& s) { s.residual = true; });
  refused("unet", [](PackageSettings& s) { s.noise_input = "units"; });
  // A head under a package of mosaics, and a package that calls its mosaics pictures.
  const NetworkPackage package = picture_package("rgb");
  TensorFile file = package_file(package, *make_network(package.network));
  std::string& text = file.metadata.at("malus_package");
  text.replace(text.find("\"rgb\""), 5, "\"mosaic\"");
  EXPECT_THROW(package_of(file, "weights"), InputError);
}

// What a sensor without colours sees has a mosaic of grey, and no picture.
TEST(PicturePackage, WantsASensorWithColours) {
  const auto mono = SensorLayout::named("mono");
  EXPECT_EQ(picture_settings("mosaic").phase_of(mono), (CellPhase{0, 0}));
  for (const char* target : {"rgb", "srgb"}) {
    EXPECT_FALSE(picture_settings(target).phase_of(mono)) << target;
    EXPECT_EQ(picture_settings(target).phase_of(SensorLayout::named("bayer-bggr")),
              (CellPhase{1, 1}));
  }
}

TEST(PicturePackage, OnesWrittenBeforeThereWerePicturesGiveMosaics) {
  NetworkPackage package;
  package.settings = picture_settings("mosaic");
  package.network = fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, package.settings);
  TensorFile file = package_file(package, *make_network(package.network));
  std::string& text = file.metadata.at("malus_package");
  const std::string target = ",\"target\":\"mosaic\"";
  ASSERT_NE(text.find(target), std::string::npos) << text;
  text.erase(text.find(target), target.size());
  EXPECT_FALSE(package_of(file, "weights").gives_picture());
}

TEST(PictureTarget, IsLinearLightOrWhatADisplayShows) {
  const PictureShot shot(32, 48);
  for (const std::string target : {"rgb", "srgb"}) {
    const PackageSettings settings = picture_settings(target);
    const NetworkFrame frame = prepare_network_frame(shot.noisy, shot.profile, settings);
    const auto planes = picture_target(settings, frame.domain, shot.rgb_dn);
    ASSERT_EQ(planes.sizes(), (std::vector<std::int64_t>{1, 3, 32, 48}));
    const Planes back = picture_of(settings, frame.domain, planes, 31, 47);
    ASSERT_EQ(back.rows(), 31);
    ASSERT_EQ(back.cols(), 47);
    for (int k = 0; k < 3; ++k)
      for (int r = 0; r < 31; ++r)
        for (int c = 0; c < 47; ++c) {
          const double dn = shot.rgb_dn[k](r, c);
          if (target == "rgb") {
            ASSERT_NEAR(back[k](r, c), dn, 1e-5 * dn);
          } else {
            ASSERT_NEAR(srgb_to_linear(back[k](r, c)), std::min(dn / frame.domain.scale(), 1.0),
                        1e-5);
          }
        }
  }
}

TEST(PictureExamples, ShowTheColoursThatTheMosaicWasMadeOf) {
  const TemporaryFolder folder;
  save_picture(folder / "a.exr", colors(64, 80), {"R", "G", "B"});
  TrainingConfig config;
  config.package = picture_package("rgb");
  config.pictures = {folder / "a.exr"};
  config.models = {kCamera};
  config.data.example = 48;
  config.data.patch = 16;
  config.noise.ratio_low = config.noise.ratio_high = 3;
  const auto source = make_pair_source(config);
  const SensorLayout layout = config.package.layout();
  for (std::uint32_t number = 0; number < 8; ++number) {
    const RawPair pair = source->pair(4, number);
    ASSERT_EQ(pair.clean_rgb_dn.channels(), 3);
    for (int r = 0; r < pair.clean_dn.rows(); ++r)
      for (int c = 0; c < pair.clean_dn.cols(); ++c)
        ASSERT_EQ(pair.clean_rgb_dn[color_of(layout, r, c)](r, c), pair.clean_dn(r, c)) << number;
    const TrainingExample example = make_example(pair, config.package);
    EXPECT_EQ(example.target.size(1), 2 * example.input.size(1));
  }
}

TEST(PictureExamples, OfCapturedPairsAreTheirPictureOrDemosaicked) {
  const TemporaryFolder folder;
  const PictureShot shot(32, 48);
  SaveOptions save;
  save.type = SampleType::kUint16;
  RawFrame noisy = shot.noisy;
  noisy.gain = shot.gain;
  save_frame(folder / "short.tif", noisy, save);
  save_picture(folder / "reference.npy", shot.clean_dn);
  save_picture(folder / "picture.npy", shot.rgb_dn, {});
  TrainingConfig config;
  config.package = picture_package("srgb");
  config.pairs = {folder / "pairs.json"};
  config.models = {kCamera};
  config.data.example = 16;
  const auto pair_of = [&](const char* more) {
    std::ofstream(folder / "pairs.json")
        << R"({"pairs": [{"short": "short.tif", "reference": "reference.npy", "ratio": 1, )"
        << R"("gain_db": null, "iso": 1600)" << more << "}]}";
    return make_pair_source(config)->pair(1, 1);
  };
  const RawPair without = pair_of("");
  EXPECT_EQ(without.clean_rgb_dn.channels(), 0);
  const auto target = make_example(without, config.package).target;
  const NetworkFrame frame =
      prepare_network_frame(without.noisy, without.profile, config.package.settings);
  EXPECT_TRUE(torch::equal(
      target, picture_target(config.package.settings, frame.domain,
                             demosaick_bayer(without.clean_dn, config.package.layout()))[0]));
  const RawPair with = pair_of(R"(, "picture": "picture.npy")");
  ASSERT_EQ(with.clean_rgb_dn.channels(), 3);
  for (int r = 0; r < 16; ++r)
    for (int c = 0; c < 16; ++c)
      ASSERT_EQ(with.clean_rgb_dn[color_of(shot.model.layout, r, c)](r, c), with.clean_dn(r, c));
  // What is no picture, or holds no numbers, is named.
  const auto refused = [&](Planes picture) {
    SaveOptions replace;
    replace.force = true;
    save_picture(folder / "picture.npy", picture, {}, replace);
    return problem_of([&] { pair_of(R"(, "picture": "picture.npy")"); });
  };
  for (const int planes : {1, 4})
    EXPECT_NE(refused(Planes(planes, 32, 48)).find("picture.npy: "), std::string::npos) << planes;
  Planes holed = shot.rgb_dn;
  for (float& v : holed[1].values()) v = std::nanf("");
  EXPECT_NE(refused(holed).find("picture.npy: 1536 pixels are NaN"), std::string::npos);
}

// A target that counts its own pixels, twice as fine as the input: patches must stay aligned.
TEST(PicturePool, CutsTargetsWhereItCutsInputs) {
  const auto maker = [](std::uint32_t) {
    const auto input = torch::arange(8 * 10, torch::kFloat32).reshape({1, 8, 10});
    return TrainingExample{
        input, input.repeat_interleave(2, 1).repeat_interleave(2, 2).expand({3, 16, 20})};
  };
  const PoolShape shape{.batch = 3,
                        .first_place = 0,
                        .places = 3,
                        .pool = 1,
                        .refresh = {1},
                        .patch_rows = 4,
                        .patch_cols = 3};
  ExamplePool pool(maker, shape, 5, 0);
  for (int step = 0; step < 5; ++step) {
    const auto batch = pool.batch(step);
    ASSERT_EQ(batch.target.sizes(), (std::vector<std::int64_t>{3, 3, 8, 6}));
    EXPECT_TRUE(torch::equal(batch.target.slice(1, 0, 1),
                             batch.input.repeat_interleave(2, 2).repeat_interleave(2, 3)));
  }
}

TEST(PictureTiles, OfAnEnlargingNetworkFitTogether) {
  torch::manual_seed(1);
  const auto whole = torch::rand({1, 2, 37, 50});
  const auto enlarge = [](const torch::Tensor& x) {
    return x.repeat_interleave(2, 2).repeat_interleave(2, 3);
  };
  for (const bool exact : {true, false}) {
    const TileDemand demand{.multiple = 4, .overlap = 8, .exact = exact, .bytes_per_pixel = 1};
    const auto result = run_tiled(
        {37, 50, {12, 16}, 2, demand},
        [&](const TileSpan& r, const TileSpan& c) {
          return whole.slice(2, r.begin, r.end).slice(3, c.begin, c.end);
        },
        enlarge, silent_progress());
    EXPECT_GT(result.tiles, 4);
    EXPECT_TRUE(torch::allclose(result.planes, enlarge(whole), 1e-6, 1e-6));
  }
}

TEST(PictureTraining, LearnsAndGivesPicturesOfTheFramesSize) {
  const TemporaryFolder folder;
  save_picture(folder / "a.exr", colors(96, 96), {"R", "G", "B"});
  for (const std::string target : {"rgb", "srgb"}) {
    TrainingConfig config;
    config.package = picture_package(target);
    config.pictures = {folder / "a.exr"};
    config.models = {kCamera};
    config.noise.gains = {1600};
    config.data.example = 64;
    config.data.patch = 32;
    config.data.pool = 2;
    config.train.batch = 4;
    config.train.steps = 60;
    config.train.warm_up = 5;
    config.train.learning_rate = 5e-3;
    config.train.average = 0;
    config.train.loss = "l1";
    config.train.log_every = 1;
    config.validation_scenes = {folder / "a.exr"};
    config.cases = {{1600, 1}};
    config.validation.every = 30;
    config.validation.crop = 64;
    const auto worker = single_worker();
    const auto run = train(config, {folder / target, false, false, 1}, *worker, silent_progress());
    std::vector<double> losses, scores;
    for (const auto& line : run["log"]) {
      if (line.contains("loss")) losses.push_back(line["loss"].get<double>());
      if (line.contains("validation"))
        scores.push_back(line["validation"]["image_psnr_db"].get<double>());
      EXPECT_FALSE(line.contains("base_loss"));
    }
    ASSERT_EQ(losses.size(), 60u);
    EXPECT_LT(losses.back(), 0.7 * losses.front()) << target;
    ASSERT_EQ(scores.size(), 2u);
    EXPECT_GT(scores[1], scores[0]) << target;
    EXPECT_GT(run["noisy"]["image_psnr_db"].get<double>(), 20);
    EXPECT_FALSE(run.contains("sample"));

    // Whole and in tiles, of a frame that ends inside a cell.
    const PictureShot shot(61, 75);
    const auto picture_in = [&](double memory_mib, int* tiles) {
      NetworkInference inference(folder / target / "weights.safetensors", {});
      EXPECT_EQ(network_target_name(inference.target()), target);
      DenoiseSettings settings;
      settings.memory_mib = memory_mib;
      auto rendered = inference.render(shot.noisy, shot.profile, settings, silent_progress());
      *tiles = rendered.report.tiles;
      EXPECT_THROW(inference.denoise(shot.noisy, shot.profile, settings, silent_progress()),
                   InputError);
      return std::move(rendered.picture);
    };
    int one = 0, many = 0;
    const Planes whole = picture_in(1024, &one), tiled = picture_in(0.21, &many);
    EXPECT_EQ(one, 1);
    EXPECT_GT(many, 1);
    ASSERT_EQ(whole.rows(), 61);
    ASSERT_EQ(whole.cols(), 75);
    for (int k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < whole[k].size(); ++i) {
        const float a = whole[k].values()[i];
        ASSERT_NEAR(tiled[k].values()[i], a, 1e-5f * std::abs(a) + 1e-5f);
      }
  }
}

// Every weight is a number, the result is none that could be light.
TEST(Inference, RefusesWhatNoLightIs) {
  const TemporaryFolder folder;
  const PictureShot shot(64, 64);
  for (const float bias : {3e38f, 1e6f})
    for (const char* target : {"mosaic", "rgb", "srgb"}) {
      const bool mosaic = std::string(target) == "mosaic";
      NetworkPackage package;
      package.settings.layout = "bayer-rggb";
      package.settings.target = target;
      package.settings.domain = mosaic ? "stabilised" : "linear";
      package.settings.residual = mosaic;
      package.settings.noise_input = "none";
      package.network = fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, package.settings);
      const auto network = make_network(package.network);
      {
        const torch::NoGradGuard no_gradients;
        for (auto& item : network->named_parameters()) item.value().fill_(1);
        network->named_parameters()["conv4_1.bias"].fill_(bias);
      }
      const auto path = folder / (std::string(target) + ".safetensors");
      save_tensor_file(package_file(package, *network), path);
      NetworkInference inference(path, {});
      try {
        if (mosaic)
          inference.denoise(shot.noisy, shot.profile, {}, silent_progress());
        else
          inference.render(shot.noisy, shot.profile, {}, silent_progress());
        ADD_FAILURE() << target << " " << bias;
      } catch (const InputError& error) {
        EXPECT_EQ(error.subject(), path.string());
      }
    }
}

}  // namespace
}  // namespace malus
