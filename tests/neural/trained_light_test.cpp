// Truth: light of a known signal-to-noise ratio; the closed form of the shares.
#include "malus/neural/internal/trained_light.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/neural/inference.h"
#include "malus/neural/internal/example_pool.h"
#include "malus/neural/internal/raw_pairs.h"

#include <atomic>
#include <cmath>

#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

NetworkPackage package_with(const std::string& guide, const std::string& noise_input,
                            const std::string& domain = "stabilised") {
  NetworkPackage package;
  package.settings.layout = "bayer-rggb";
  package.settings.guide = guide;
  package.settings.noise_input = noise_input;
  package.settings.domain = domain;
  package.network = fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, package.settings);
  return package;
}

// Variance s + 1 at s DN: stabilised, with 0 at 0 DN, it is 2 (sqrt(s + 1) - 1).
NoiseProfile photons() {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("bayer-rggb");
  profile.channels.assign(4, ChannelProfile{});
  for (ChannelProfile& channel : profile.channels) channel.variance = VarianceCurve::affine(1, 1);
  return profile;
}

RawFrame even_frame(float dn, int rows = 32, int cols = 32) {
  RawFrame frame;
  frame.layout = SensorLayout::named("bayer-rggb");
  frame.black_dn.assign(4, 0.0);
  frame.white_dn = 4095;
  frame.white_known = true;
  frame.source = "even";
  frame.dn = Image(rows, cols, dn);
  return frame;
}

// Every eighth pair is of 900 DN, the others darker.
class KnownLight : public PairSource {
 public:
  std::size_t size() const override { return 8; }
  RawPair pair(std::uint64_t, std::uint32_t number) const override {
    const float dn = number % 8 == 3 ? 900.0f : 100.0f + 10.0f * static_cast<float>(number % 8);
    RawPair pair;
    pair.noisy = even_frame(dn);
    pair.clean_dn = pair.noisy.dn;
    pair.profile = photons();
    return pair;
  }
};

TEST(TrainedLight, IsTheBrightestOfTheExamplesInDeviationsOfTheirNoise) {
  const auto brightest = [](const NetworkPackage& package) {
    return brightest_light(package, KnownLight(), 1, silent_progress());
  };
  for (const char* guide : {"none", "bm3d"})
    EXPECT_NEAR(brightest(package_with(guide, "units")), 2 * (std::sqrt(901.0) - 1), 0.6) << guide;
  EXPECT_NEAR(brightest(package_with("none", "level", "linear")), std::sqrt(900.0), 0.3);
  EXPECT_TRUE(std::isinf(brightest(package_with("none", "none"))));
}

TEST(TrainedLight, IsTheSameForAnyNumberOfThreadsAndTold) {
  struct Told final : Progress {
    std::int64_t total = 0;
    std::atomic<std::int64_t> done = 0;
    int notes = 0;
    void begin(std::string_view, std::int64_t steps) override { total += steps; }
    void advance(std::int64_t steps) override { done += steps; }
    void warn(std::string_view) override {}
    void note(std::string_view) override { ++notes; }
    bool stop_requested() const override { return false; }
  };
  double before = 0;
  for (const int threads : {1, 3}) {
    set_thread_count(threads);
    Told told;
    const double light = brightest_light(package_with("none", "units"), KnownLight(), 1, told);
    if (threads > 1) {
      EXPECT_EQ(light, before);
    }
    before = light;
    EXPECT_EQ(told.total, 128);
    EXPECT_EQ(told.done, 128);
    EXPECT_EQ(told.notes, 1);
  }
  set_thread_count(0);
}

TEST(TrainedLight, StaysWithThePackageAndIsChecked) {
  NetworkPackage package = package_with("bm3d", "units");
  const auto network = make_network(package.network);
  EXPECT_TRUE(std::isinf(package_of(package_file(package, *network), "w").brightest));
  package.brightest = 62.5;
  EXPECT_EQ(package_of(package_file(package, *network), "w").brightest, 62.5);
  package.brightest = -1;
  EXPECT_THROW(package_of(package_file(package, *network), "w"), InputError);
  NetworkPackage blind = package_with("none", "none");
  blind.brightest = 62.5;
  EXPECT_THROW(package_of(package_file(blind, *make_network(blind.network)), "w"), InputError);
}

TEST(TrainedLight, BeyondItTheGuideStands) {
  for (const char* noise_input : {"level", "units"}) {
    NetworkPackage package = package_with("bm3d", noise_input);
    const auto network = make_network(package.network);
    const torch::NoGradGuard no_gradients;
    for (auto& parameter : network->parameters()) parameter.uniform_(-0.3, 0.3);
    const double level = 0.01;
    // Guide, noisy and noise planes; columns of 0.5, 0.9, 1, 1.1 and 2 times the light of training.
    const double times[] = {0.5, 0.9, 1, 1.1, 2};
    torch::Tensor input = torch::rand({1, 9, 16, 5}) * level;
    input.slice(1, 8) = level;
    for (int c = 0; c < 5; ++c) {
      torch::Tensor guide = input.slice(1, 0, 4).select(3, c);
      guide += times[c] * 40 * level - guide.mean(1, true);
    }
    const torch::Tensor guide = input.slice(1, 0, 4);
    const torch::Tensor whole = apply_network(*network, package, input) - guide;
    ASSERT_GT(whole.abs().min().item<double>(), 0);
    package.brightest = 40;
    EXPECT_EQ(count_brighter(package, input.slice(3, 3)), 32);
    const torch::Tensor part = apply_network(*network, package, input) - guide;
    const double share[] = {1, 0.75, 0.5, 0.25, 0};
    for (int c = 0; c < 5; ++c)
      EXPECT_TRUE(torch::allclose(part.select(3, c), share[c] * whole.select(3, c), 1e-3, 1e-6))
          << noise_input << ' ' << times[c];
  }
}

struct Listening : Progress {
  std::string warnings;
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t) override {}
  void warn(std::string_view message) override { warnings += message; }
  bool stop_requested() const override { return false; }
};

TEST(TrainedLight, AFrameThatIsBrighterIsNamed) {
  const testing::TemporaryFolder folder;
  for (const char* guide : {"none", "nl-ridge"}) {
    NetworkPackage package = package_with(guide, "units");
    package.brightest = 40;
    const auto path = folder / "w.safetensors";
    save_tensor_file(package_file(package, *make_network(package.network)), path);
    NetworkInference network(path, {});
    Listening dark, bright;
    network.denoise(even_frame(100), photons(), {}, dark);
    EXPECT_EQ(dark.warnings, "");
    network.denoise(even_frame(900), photons(), {}, bright);
    EXPECT_EQ(bright.warnings.rfind("even: 100 % of it", 0), 0u) << bright.warnings;
    EXPECT_EQ(bright.warnings.find("there the result is that of nl-ridge") != std::string::npos,
              std::string(guide) == "nl-ridge");
  }
}

// The bright quarter lies in the middle, which most tiles see.
TEST(TrainedLight, PlacesThatManyTilesSeeCountOnce) {
  const testing::TemporaryFolder folder;
  NetworkPackage package = package_with("none", "units");
  package.brightest = 40;
  const auto path = folder / "w.safetensors";
  save_tensor_file(package_file(package, *make_network(package.network)), path);
  RawFrame frame = even_frame(100, 128, 128);
  for (int r = 32; r < 96; ++r)
    for (int c = 32; c < 96; ++c) frame.dn(r, c) = 900;
  for (const double memory_mib : {1000.0, 0.35}) {
    DenoiseSettings settings;
    settings.memory_mib = memory_mib;
    Listening progress;
    const Denoised result =
        NetworkInference(path, {}).denoise(frame, photons(), settings, progress);
    EXPECT_EQ(result.tiles > 4, memory_mib < 1) << result.tiles;
    EXPECT_EQ(progress.warnings.rfind("even: 25 % of it", 0), 0u) << progress.warnings;
  }
}

}  // namespace
}  // namespace malus
