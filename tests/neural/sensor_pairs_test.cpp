// Pairs of sensors whose pixels or whose lack of colours the model knows. Truth: the frames and the
// scene that the test wrote.
#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/io/picture_file.h"
#include "malus/neural/internal/example_pool.h"
#include "malus/neural/internal/raw_pairs.h"

#include <cmath>
#include <fstream>

#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::scene_config;
using testing::TemporaryFolder;

constexpr int kSensorSide = 64;
const GainSetting kPairGain{.gain_db = 12, .iso = {}};

// A model of it, and one pair of frames that cover it.
struct SensorPairs {
  SensorPairs(double dsnu_dn, const std::vector<DefectPixel>& defects) {
    NoiseModel model = load_model("imx250mzr-simulated");
    for (PhysicsCalibration& p : model.physics) p.dsnu_dn.assign(4, dsnu_dn);
    model.physics.front().dark_shading_dn = Image(kSensorSide, kSensorSide);
    model.defects = defects;
    save_model(model, folder / "sensor.h5");
    noise = model.profile_at(kPairGain).channels[0].variance;
    config.source = "config.toml";
    config.package.settings.layout = "polar-mono";
    config.pairs = {folder / "pairs.json"};
    config.models = {folder / "sensor.h5"};
  }
  // more: of the list's entry.
  RawPair pair_of(const Image& noisy_dn, const Image& reference_dn, double ratio,
                  const std::string& more = "") const {
    SaveOptions save;
    save.force = true;
    save_picture(folder / "short.npy", noisy_dn, save);
    save_picture(folder / "reference.npy", reference_dn, save);
    std::ofstream(folder / "pairs.json")
        << R"({"pairs": [{"short": "short.npy", "reference": "reference.npy", "ratio": )" << ratio
        << R"(, "gain_db": 12, "iso": null)" << more << "}]}";
    return make_pair_source(config)->pair(1, 0);
  }
  TemporaryFolder folder;
  TrainingConfig config;
  VarianceCurve noise;
};

// A pixel's dark signal d is in both, but the clean picture is the reference over the ratio: the
// difference holds d (1 - 1 / ratio). 4096 pixels: 5 standard errors of a variance are 11 %.
TEST(SensorPairs, DarkSignalThatTheRatioTakesFromTheReferenceIsNoise) {
  constexpr double kDsnuDn = 12, kLightDn = 40;
  const SensorPairs pairs(kDsnuDn, {});
  RandomSequence random(3, 0, Draw::kOther);
  Image pattern_dn(kSensorSide, kSensorSide), noisy_dn(pattern_dn), reference_dn(pattern_dn);
  for (std::size_t i = 0; i < pattern_dn.size(); ++i) {
    const double dark_dn = kDsnuDn * random.normal();
    pattern_dn.values()[i] = static_cast<float>(dark_dn);
    noisy_dn.values()[i] =
        static_cast<float>(kLightDn + dark_dn + std::sqrt(pairs.noise(kLightDn)) * random.normal());
  }
  for (const double ratio : {1.0, 10.0, 0.5}) {
    for (std::size_t i = 0; i < pattern_dn.size(); ++i)
      reference_dn.values()[i] = static_cast<float>(ratio * kLightDn) + pattern_dn.values()[i];
    const RawPair pair = pairs.pair_of(noisy_dn, reference_dn, ratio);
    Moments difference;
    for (std::size_t i = 0; i < pattern_dn.size(); ++i)
      difference.add(double{pair.noisy.dn.values()[i]} - double{pair.clean_dn.values()[i]});
    const double told = pair.profile.channels[0].variance(kLightDn);
    EXPECT_NEAR(told / difference.variance(), 1, 0.11) << ratio;
    if (ratio == 1) {
      EXPECT_EQ(told, pairs.noise(kLightDn));
    }
  }
}

// The dark signal of a pixel is in proportion to K: d K' / K at the reference's gain. 4096 pixels,
// as above.
TEST(SensorPairs, DarkSignalOfAReferenceIsThatOfItsOwnGain) {
  constexpr double kDsnuDn = 12, kLightDn = 40, kRatio = 5;
  const SensorPairs pairs(kDsnuDn, {});
  const NoiseModel model = load_model(pairs.config.models.front());
  const double factor = model.profile_at({.gain_db = 24, .iso = {}}).channels[0].gain_dn_per_e /
                        model.profile_at(kPairGain).channels[0].gain_dn_per_e;
  ASSERT_NEAR(factor, 4, 0.2);
  RandomSequence random(4, 0, Draw::kOther);
  Image noisy_dn(kSensorSide, kSensorSide), reference_dn(noisy_dn);
  for (std::size_t i = 0; i < noisy_dn.size(); ++i) {
    const double dark_dn = kDsnuDn * random.normal();
    noisy_dn.values()[i] =
        static_cast<float>(kLightDn + dark_dn + std::sqrt(pairs.noise(kLightDn)) * random.normal());
    reference_dn.values()[i] = static_cast<float>(kRatio * kLightDn + factor * dark_dn);
  }
  const RawPair pair =
      pairs.pair_of(noisy_dn, reference_dn, kRatio,
                    R"(, "bias_removed": true, "reference_gain": {"gain_db": 24, "iso": null})");
  Moments difference;
  for (std::size_t i = 0; i < noisy_dn.size(); ++i)
    difference.add(double{pair.noisy.dn.values()[i]} - double{pair.clean_dn.values()[i]});
  EXPECT_NEAR(pair.profile.channels[0].variance(kLightDn) / difference.variance(), 1, 0.11);
}

// Of the first and of the last colour of every cell.
double last_over_first(const Image& mosaic) {
  double first = 0, last = 0;
  for (int r = 0; r < mosaic.rows(); ++r)
    for (int c = 0; c < mosaic.cols(); ++c) {
      if (r % 4 < 2 && c % 4 < 2) first += double{mosaic(r, c)};
      if (r % 4 >= 2 && c % 4 >= 2) last += double{mosaic(r, c)};
    }
  return last / first;
}

// One network for two cameras: to the one without colours every scene is grey, and the sites of the
// other's red (0.2 of white) see what those of its blue do (0.4). The first
// camera is the one that the network is for, and one whose cells begin elsewhere would need other
// pieces.
TEST(SyntheticPairs, OfASensorWithoutColoursAreOfGreyLight) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.noise.gains = {12};
  config.models = {"imx250myr-simulated", "imx250mzr-simulated"};
  const auto pairs = make_pair_source(config);
  int grey = 0;
  for (std::uint32_t number = 0; number < 12; ++number) {
    const RawPair pair = pairs->pair(3, number);
    const bool is_grey = pair.noisy.layout == SensorLayout::named("polar-mono");
    grey += is_grey ? 1 : 0;
    EXPECT_EQ(pair.profile.channels.size(), is_grey ? 4U : 16U);
    EXPECT_NEAR(last_over_first(pair.clean_dn), is_grey ? 1 : 2, 0.2) << number;
    const TrainingExample example = make_example(pair, config.package);
    EXPECT_EQ(example.target.sizes(),
              (std::vector<std::int64_t>{16, pair.clean_dn.rows() / 4, pair.clean_dn.cols() / 4}));
  }
  EXPECT_GT(grey, 0);
  EXPECT_LT(grey, 12);

  config.models = {"imx250mzr-simulated", "imx250myr-simulated"};
  EXPECT_THROW(make_pair_source(config), InputError);
  NoiseModel turned = load_model("imx250mzr-simulated");
  turned.layout = SensorLayout::from_sites({{"135", "0"}, {"90", "45"}});
  save_model(turned, folder / "turned.h5");
  config.models = {"imx250myr-simulated", folder / "turned.h5"};
  EXPECT_THROW(make_pair_source(config), InputError);
}

// As denoising fills them, wherever the piece of an example lies.
TEST(SensorPairs, DefectsOfAPieceAreFilledBeforeTheNetwork) {
  std::vector<DefectPixel> defects;
  Image noisy_dn(kSensorSide, kSensorSide, 300.0f);
  const Image reference_dn(noisy_dn);
  for (int k = 0; k < kSensorSide; k += 3) {
    defects.push_back({k, (7 * k) % kSensorSide, "hot", 9.0});
    noisy_dn(k, (7 * k) % kSensorSide) = 330;  // no impulse, by its value
  }
  SensorPairs pairs(0, defects);
  for (const int example : {64, 32}) {
    pairs.config.data.example = example;
    const RawPair pair = pairs.pair_of(noisy_dn, reference_dn, 1);
    ASSERT_EQ(pair.noisy.dn.rows(), example);
    const torch::Tensor input = make_example(pair, pairs.config.package).input;
    EXPECT_LT((input[0].max() - input[0].min()).item<float>(), 1e-3) << example;
  }
}

}  // namespace
}  // namespace malus
