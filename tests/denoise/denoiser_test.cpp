// Truth: pictures known without noise, noise from the generative law (synthesize/exact.h).
#include "malus/denoise/denoiser.h"

#include "malus/base/parallel.h"
#include "malus/image/pack.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>

#include "denoise/tiled_scene.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

Image scene(int rows, int cols) { return polarized_blobs(rows, cols); }

RawFrame noisy_frame(const Image& clean, const PhysicsNoise& noise, std::uint64_t seed) {
  return drawn_frame(clean, noise, {.black_dn = 82}, seed);
}

double rms(const Image& a, const Image& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    sum += std::pow(static_cast<double>(a.values()[i]) - b.values()[i], 2);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

// The profile of least time that has the method's own passes.
DenoiseSettings quick(const std::string& method) {
  DenoiseSettings settings;
  settings.method = method;
  settings.profile = method == "nl-ridge" ? "normal" : "fast";
  return settings;
}

// One set of weights for all values of a block lets noise through in those that hold no signal.
TEST(DenoiseFrame, CombinationsLeaveEvenLightNearlyAsCleanAsAWienerFilter) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  Image clean(192, 192);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c)
      clean(r, c) = 400.0f * (1.0f + 0.2f * static_cast<float>((r + c) % 2));
  const RawFrame frame = noisy_frame(clean, noise, 5);
  const auto error = [&](const char* method) {
    return rms(denoise_frame(frame, profile_of(noise), {.method = method}).dn_above_black, clean);
  };
  // Without the values' own gains it is 1.5 times, with one coarse scale 1.17.
  EXPECT_LT(error("nl-ridge"), 1.1 * error("bm3d"));
}

// 77 periods: coarse scales of odd sizes.
TEST(DenoiseFrame, ABorderThatTheCoarseScalesDoNotReachIsAsClean) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  constexpr int kSize = 308, kBorder = 24;
  double first = 0, last = 0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const RawFrame frame = noisy_frame(Image(kSize, kSize, 150.0f), noise, seed);
    const Denoised result = denoise_frame(frame, profile_of(noise), {});
    for (int r = 0; r < kSize; ++r)
      for (int c = 0; c < kBorder; ++c) {
        first += std::pow(double{result.dn_above_black(r, c)} - 150, 2);
        last += std::pow(double{result.dn_above_black(r, kSize - 1 - c)} - 150, 2);
      }
  }
  EXPECT_LT(last, 2 * first);  // 3 times and more with a last coarse column of single samples
}

// PFCD, whose blocks are of 32x32 pixels, was the better one on smooth light.
TEST(DenoiseFrame, SmoothLightComesOutCleanerThanFromWienerFiltersAndFromPfcd) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  Image clean(256, 256);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c)
      clean(r, c) = static_cast<float>(100 + 2.0 * c + r * (1 + 0.3 * ((r + c) % 2)));
  const RawFrame frame = noisy_frame(clean, noise, 5);
  const auto error = [&](const char* method) {
    return rms(denoise_frame(frame, profile_of(noise), {.method = method}).dn_above_black, clean);
  };
  EXPECT_LT(error("nl-ridge"), std::min(0.7 * error("bm3d"), error("vst-pfcd")));
}

TEST(DenoiseFrame, EveryMethodRemovesMostOfTheNoise) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  const Image clean = scene(160, 192);
  const RawFrame frame = noisy_frame(clean, noise, 3);
  Image noisy = frame.dn;
  for (float& v : noisy.values()) v -= 82.0f;
  double of_default = 0, largest_on_mosaic = 0;
  for (const DenoiseMethod& method : denoise_methods()) {
    const Denoised result = denoise_frame(frame, profile_of(noise), quick(method.name));
    const double error = rms(result.dn_above_black, clean);
    // No light has the scene's sums I0 + I90 and I45 + I135: within a colour's 2x2 pixels their
    // difference counts as noise.
    const double left = method.name == "paper-bm3d" ? 0.8 : 0.6;
    EXPECT_LT(error, left * rms(noisy, clean)) << method.name;
    if (of_default == 0) of_default = error;
    if (method.on_mosaic())
      largest_on_mosaic = std::max(largest_on_mosaic, error);
    else  // vst-pfcd filters all alignments in full, which profile fast of bm3d does not
      EXPECT_LT(method.name == "vst-pfcd" ? of_default : largest_on_mosaic, error) << method.name;
  }
}

class MosaicMethod : public testing::TestWithParam<std::string> {};

std::vector<std::string> mosaic_methods() {
  std::vector<std::string> names;
  for (const DenoiseMethod& method : denoise_methods())
    if (method.on_mosaic()) names.push_back(method.name);
  return names;
}
INSTANTIATE_TEST_SUITE_P(All, MosaicMethod, testing::ValuesIn(mosaic_methods()));

TEST_P(MosaicMethod, EveryLayoutAndSizeWorks) {
  for (const std::string& name : SensorLayout::known_names()) {
    const PhysicsNoise noise = camera_noise(SensorLayout::named(name));
    for (const auto& [rows, cols] : {std::pair{61, 43}, {1, 50}, {50, 1}, {1, 1}, {3, 2}}) {
      const Image clean(rows, cols, 100.0f), with_black(rows, cols, 182.0f);
      const RawFrame frame = noisy_frame(clean, noise, 1);
      const Denoised result = denoise_frame(frame, profile_of(noise), quick(GetParam()));
      ASSERT_EQ(result.dn_above_black.rows(), rows);
      ASSERT_EQ(result.dn_above_black.cols(), cols);
      // Noise of 12.5 DN: a flat picture comes out much flatter, a handful of pixels no worse.
      const double most_dn = rows * cols > 1000 ? 3.0 : 1.1 * rms(frame.dn, with_black);
      EXPECT_LT(rms(result.dn_above_black, clean), most_dn) << name;
    }
    const Image clean(67, 71, 100.0f);  // odd, and large enough for a coarse scale of some
    const Denoised result =
        denoise_frame(noisy_frame(clean, noise, 1), profile_of(noise), {.method = GetParam()});
    EXPECT_LT(rms(result.dn_above_black, clean), 2.0) << name;
  }
}

// Of two scales, and of what repeats: denoiser_slow_test.cpp.
TEST_P(MosaicMethod, TilesEqualTheWhole) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  const RawFrame frame = noisy_frame(scene(700, 900), noise, 5);
  DenoiseSettings settings{.method = GetParam(), .profile = "fast"};
  const Denoised whole = denoise_frame(frame, profile_of(noise), settings);
  ASSERT_EQ(whole.tiles, 1);
  leave_memory(40, settings);
  WarningsAndTiles seen;
  const Denoised tiled = denoise_frame(frame, profile_of(noise), settings, seen);
  EXPECT_GT(tiled.tiles, 1);
  // A wait that the memory makes is told before it, not after.
  EXPECT_THAT(seen.warnings,
              testing::ElementsAre(testing::ContainsRegex("^test: .* tiles, .* times the work")));
  EXPECT_EQ(seen.tiles_before_warning, 0);
  EXPECT_EQ(whole.dn_above_black.values(), tiled.dn_above_black.values());
}

TEST_P(MosaicMethod, SameBytesForAnyThreadCount) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(scene(300, 280), noise, 5);
  const int before = thread_count();
  set_thread_count(1);
  const Denoised one = denoise_frame(frame, profile_of(noise), quick(GetParam()));
  set_thread_count(3);
  const Denoised three = denoise_frame(frame, profile_of(noise), quick(GetParam()));
  set_thread_count(before);
  EXPECT_EQ(one.dn_above_black.values(), three.dn_above_black.values());
}

TEST_P(MosaicMethod, NonfinitePixelsStayAndHarmNobody) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  const Image clean = scene(96, 96);
  RawFrame frame = noisy_frame(clean, noise, 9);
  frame.dn(10, 20) = std::numeric_limits<float>::quiet_NaN();
  frame.dn(50, 51) = std::numeric_limits<float>::infinity();
  const Denoised result = denoise_frame(frame, profile_of(noise), quick(GetParam()));
  EXPECT_EQ(result.nonfinite_pixels, 2);
  EXPECT_TRUE(std::isnan(result.dn_above_black(10, 20)));
  EXPECT_TRUE(std::isinf(result.dn_above_black(50, 51)));
  int bad = 0;
  for (const float v : result.dn_above_black.values()) bad += !std::isfinite(v);
  EXPECT_EQ(bad, 2);
}

// A file's "no data", and what a division by nearly 0 gives.
TEST_P(MosaicMethod, PixelsFarBeyondAllLightAreTakenAsNonfiniteOnes) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  RawFrame frame = noisy_frame(scene(96, 96), noise, 9);
  const auto denoised = [&](float value) {
    frame.dn(50, 51) = value;
    return denoise_frame(frame, profile_of(noise), quick(GetParam()), silent_progress(), true);
  };
  const Denoised hole = denoised(std::numeric_limits<float>::quiet_NaN());
  for (const float value : {-3.4e38f, -1e10f, 1e20f}) {
    Denoised result = denoised(value);
    EXPECT_EQ(result.nonfinite_pixels, 1);
    EXPECT_EQ(result.saturated_pixels, 0);
    EXPECT_FLOAT_EQ(result.dn_above_black(50, 51), value);
    EXPECT_TRUE(std::isnan((*result.variance_dn2)(50, 51)));
    result.dn_above_black(50, 51) = hole.dn_above_black(50, 52);
    Image expected = hole.dn_above_black;
    expected(50, 51) = hole.dn_above_black(50, 52);
    EXPECT_EQ(result.dn_above_black, expected) << value;
    EXPECT_EQ(result.mean_dn, hole.mean_dn);
  }
}

TEST_P(MosaicMethod, FlatAndSaturatedPicturesStayFlat) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  RawFrame frame = noisy_frame(Image(80, 80), noise, 9);
  for (float& v : frame.dn.values()) v = 4095;  // all white
  const Denoised result = denoise_frame(frame, profile_of(noise), quick(GetParam()));
  EXPECT_EQ(result.saturated_pixels, 6400);
  for (const float v : result.dn_above_black.values()) EXPECT_NEAR(v, 4013.4, 0.01);
}

TEST_P(MosaicMethod, SaturatedPixelsAreToldByWhiteWhateverTheBias) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  RawFrame frame = noisy_frame(Image(64, 64, 3900.0f), noise, 9);
  NoiseProfile profile = profile_of(noise);
  const std::array<double, 4> bias_dn = {30, -30, 0, 7};
  for (std::size_t k = 0; k < 4; ++k) profile.channels[k].bias_dn = bias_dn[k];
  for (int i = 0; i < 64; ++i) {
    frame.dn(i, i) = 4095;
    frame.dn(i, (i + 9) % 64) = 4090;  // not saturated
  }
  const Denoised result = denoise_frame(frame, profile, quick(GetParam()));
  for (int i = 0; i < 64; ++i) {
    const auto above_dn = [&](int col, double raw_dn) {
      const auto k = static_cast<std::size_t>(frame.layout.channel_at(i, col));
      return static_cast<float>(raw_dn) - static_cast<float>(82 + bias_dn[k]);
    };
    EXPECT_EQ(result.dn_above_black(i, i), above_dn(i, 4095));
    EXPECT_NE(result.dn_above_black(i, (i + 9) % 64), above_dn((i + 9) % 64, 4090));
  }
}

TEST_P(MosaicMethod, TheMeanOfADarkPictureIsKept) {
  // 1.3 electrons: an inverse without correction would be wrong by a quarter of an electron.
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  const Image clean(256, 256, 2.0f);
  const Denoised result =
      denoise_frame(noisy_frame(clean, noise, 2), profile_of(noise), quick(GetParam()));
  double mean = 0;
  for (const float v : result.dn_above_black.values()) mean += v / 65536.0;
  // Deviation of a pixel 4.3 DN: the mean of 65536 has 0.017, rows add 0.05.
  EXPECT_NEAR(mean, 2.0, 0.2);
}

TEST_P(MosaicMethod, SaysByHowMuchTheMeansMoved) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("bayer-rggb"));
  const RawFrame frame = noisy_frame(scene(128, 128), noise, 3);
  const auto mean = [](const Image& plane) {
    double sum = 0;
    for (const float v : plane.values()) sum += static_cast<double>(v);
    return sum / static_cast<double>(plane.size());
  };
  // The largest share of a channel's mean that is said to have moved; what is said is checked.
  const auto moved = [&](const NoiseProfile& profile) {
    const Denoised result = denoise_frame(frame, profile, quick(GetParam()));
    double most = 0;
    for (int k = 0; k < 4; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const double before =
          mean(pack(frame.dn, frame.layout)[k]) - 82 - profile.channels[at].bias_dn;
      EXPECT_NEAR(result.mean_dn.at(at), before, 0.05);  // rows are removed before
      const double after = mean(pack(result.dn_above_black, frame.layout)[k]);
      EXPECT_NEAR(result.mean_shift_dn.at(at), after - result.mean_dn[at], 1e-3);
      most = std::max(most, std::abs(result.mean_shift_dn[at]) / result.mean_dn[at]);
    }
    return most;
  };
  const NoiseProfile right = profile_of(noise);
  EXPECT_LT(moved(right), 0.005);
  NoiseProfile wrong = right;  // a converter of 40 times the gain
  for (ChannelProfile& channel : wrong.channels)
    channel = {.variance = VarianceCurve::affine(60, 14), .bias_dn = channel.bias_dn};
  EXPECT_GT(moved(wrong), 0.02);
}

TEST(DenoiseFrame, EveryMethodKeepsToItsMemoryOrRefuses) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(Image(2000, 1000, 100.0f), noise, 1);
  for (const DenoiseMethod& method : denoise_methods()) {
    DenoiseSettings settings = quick(method.name);
    leave_memory(18, settings);  // the frame and its result alone take 16
    EXPECT_THROW(denoise_frame(frame, profile_of(noise), settings), InputError) << method.name;
  }
}

// Of the frame itself, and for all of its scales: the coarse one, which is filtered first, held
// more.
TEST(DenoiseFrame, TheMemoryThatARefusalNamesIsEnough) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(Image(900, 600, 100.0f), noise, 1);
  DenoiseSettings settings{.profile = "fast"};
  leave_memory(4.5, settings);  // the frame and its result alone take 4.3
  try {
    denoise_frame(frame, profile_of(noise), settings);
    FAIL() << "takes what it is refused";
  } catch (const InputError& error) {
    const std::string words = error.what(), at_least = "give at least ";
    EXPECT_NE(words.find("a frame of 600 x 900 pixels"), std::string::npos) << words;
    settings.memory_mib = std::stod(words.substr(words.find(at_least) + at_least.size()));
  }
  EXPECT_NO_THROW(denoise_frame(frame, profile_of(noise), settings));
  settings.memory_mib -= 2;
  EXPECT_THROW(denoise_frame(frame, profile_of(noise), settings), InputError);
}

TEST(DenoiseFrame, WhatTheCallerHoldsCountsInTheMemory) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(scene(96, 96), noise, 1);
  for (const DenoiseMethod& method : denoise_methods()) {
    DenoiseSettings settings = quick(method.name);
    settings.memory_mib = 128;
    settings.held_values = 128 * 0x1p20 / 4;
    EXPECT_THROW(denoise_frame(frame, profile_of(noise), settings), InputError) << method.name;
  }
}

TEST(DenoiseFrame, OnlyMosaicMethodsStateTheirErrors) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(scene(40, 40), noise, 1);
  for (const DenoiseMethod& method : denoise_methods()) {
    const auto run = [&] {
      return denoise_frame(frame, profile_of(noise), quick(method.name), silent_progress(), true);
    };
    if (method.on_mosaic())
      EXPECT_TRUE(run().variance_dn2.has_value()) << method.name;
    else
      EXPECT_THROW((void)run(), InputError) << method.name;
  }
}

// Asking for variances does not change the estimate.
TEST_P(MosaicMethod, VariancesAreFiniteAndComeOnTop) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  const RawFrame frame = noisy_frame(scene(93, 101), noise, 8);
  const DenoiseSettings settings{.method = GetParam()};
  const Denoised alone = denoise_frame(frame, profile_of(noise), settings);
  const Denoised both = denoise_frame(frame, profile_of(noise), settings, silent_progress(), true);
  EXPECT_EQ(alone.dn_above_black.values(), both.dn_above_black.values());
  for (const float v : both.variance_dn2->values()) {
    EXPECT_GT(v, 0);
    EXPECT_LT(v, 1e5);  // a pixel's own noise has 150 to 500 DN^2
  }
}

// Where the picture's own detail hides hardly any noise, a filter can do nothing: the error is the
// noise, and no more than that is stated.
TEST_P(MosaicMethod, NoMoreThanTheNoiseIsStatedWhereNothingCanBeDone) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-bayer-rggb"));
  Image clean(128, 128);
  for (int r = 0; r < 128; ++r)
    for (int c = 0; c < 128; ++c)
      clean(r, c) = 1500.0F + 1000.0F * static_cast<float>(std::sin(0.9 * r * c) *
                                                           std::cos(1.7 * r - 0.01 * c * c));
  const Denoised result = denoise_frame(noisy_frame(clean, noise, 3), profile_of(noise),
                                        {.method = GetParam()}, silent_progress(), true);
  double stated = 0;
  for (const float v : result.variance_dn2->values())
    stated += v / static_cast<double>(clean.size());
  EXPECT_NEAR(rms(result.dn_above_black, clean) / std::sqrt(stated), 1.0, 0.25);
}

TEST(DenoiseFrame, BadInputGetsOneLine) {
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(scene(40, 40), noise, 1);
  EXPECT_THROW(denoise_frame(frame, profile_of(noise), quick("bm4d")), InputError);
  EXPECT_THROW(
      denoise_frame(frame, profile_of(camera_noise(SensorLayout::named("mono"))), quick("bm3d")),
      InputError);
  for (const DenoiseSettings& settings :
       {DenoiseSettings{.profile = "slow"}, {.memory_mib = NAN}, {.strength = -1}})
    EXPECT_THROW(denoise_frame(frame, profile_of(noise), settings), InputError);
  DenoiseSettings settings = quick("bm3d");
  leave_memory(1, settings);
  EXPECT_THROW(denoise_frame(noisy_frame(scene(2000, 400), noise, 1), profile_of(noise), settings),
               InputError);
}

// What comes before the filter takes seconds of a large frame.
TEST(DenoiseFrame, StopsBeforeTheFilterBegins) {
  struct Stop final : Progress {
    int stages = 0;
    void begin(std::string_view, std::int64_t) override { ++stages; }
    void advance(std::int64_t) override {}
    void warn(std::string_view) override {}
    bool stop_requested() const override { return true; }
  } stop;
  const PhysicsNoise noise = camera_noise(SensorLayout::named("polar-mono"));
  const RawFrame frame = noisy_frame(Image(64, 64, 150.0f), noise, 1);
  EXPECT_THROW(denoise_frame(frame, profile_of(noise), {}, stop), Cancelled);
  EXPECT_EQ(stop.stages, 0);
}

}  // namespace
}  // namespace malus
