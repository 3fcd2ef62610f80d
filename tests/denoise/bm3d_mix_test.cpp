// Truth: pictures without noise, Gaussian noise of deviation 1 or the generative law with fixed
// seeds, and estimates whose error is known because the test made them.
#include "malus/denoise/internal/bm3d_mix.h"

#include "malus/base/error.h"
#include "malus/base/progress.h"
#include "malus/base/random.h"
#include "malus/denoise/bm3d.h"
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

Image noise_of(int rows, int cols, float deviation, std::uint64_t seed) {
  RandomSequence random(seed, 0, Draw::kOther);
  Image noise(rows, cols);
  for (float& v : noise.values()) v = deviation * static_cast<float>(random.normal());
  return noise;
}

// Stars of `height` on even ground.
Image stars(int rows, int cols, float ground, float height) {
  Image picture(rows, cols, ground);
  RandomSequence random(4, 0, Draw::kOther);
  for (int star = 0; star < rows * cols / 400; ++star) {
    const double row = 4 + random.uniform() * (rows - 8), col = 4 + random.uniform() * (cols - 8);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c)
        picture(r, c) +=
            height *
            static_cast<float>(std::exp(-((r - row) * (r - row) + (c - col) * (c - col)) / 1.6));
  }
  return picture;
}

double mean_square(const Image& a, const Image& b, int first_col, int last_col) {
  double sum = 0;
  for (int r = 0; r < a.rows(); ++r)
    for (int c = first_col; c < last_col; ++c)
      sum += std::pow(double{a(r, c)} - double{b(r, c)}, 2);
  return sum / (double{1} * a.rows() * (last_col - first_col));
}

Image sum_of(const Image& a, const Image& b) {
  Image sum = a;
  for (std::size_t i = 0; i < sum.size(); ++i) sum.values()[i] += b.values()[i];
  return sum;
}

// A mono frame, an estimate of it, and what is stated of that.
struct Case {
  Image clean, noisy, estimate, cell_error;
  Image mixed(const internal::Bm3dMix& mix) const {
    Image result = estimate, error = cell_error;
    internal::mix_bm3d(
        mix, [&](int r, int c) { return noisy(r, c); }, error, result, silent_progress());
    return result;
  }
};

Case case_of(const Image& clean, const Image& estimate, float error) {
  return {clean, sum_of(clean, noise_of(clean.rows(), clean.cols(), 1, 3)), estimate,
          Image(internal::cell_count(clean.rows()), internal::cell_count(clean.cols()), error)};
}

// The estimate of the left half has lost a third of the stars' light, that of the right half is
// hardly wrong.
TEST(Bm3dMix, TakesWhatTheEstimateLostAndLeavesWhatItKnowsBetter) {
  constexpr int kRows = 160, kCols = 320, kMiddle = kCols / 2, kEdge = 32;
  Image clean(kRows, kCols, 40), estimate(kRows, kCols, 40);
  const Image sky = stars(kRows, kMiddle, 40, 15);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kMiddle; ++c) {
      clean(r, c) = sky(r, c);
      estimate(r, c) = 40 + (sky(r, c) - 40) * 2 / 3;
    }
  estimate = sum_of(estimate, noise_of(kRows, kCols, 0.03f, 8));
  Case mono = case_of(clean, estimate, 0.001f);
  for (int i = 0; i < mono.cell_error.rows(); ++i)
    for (int k = 0; k < kMiddle / 4; ++k) mono.cell_error(i, k) = 0.15f;
  const Image mixed = mono.mixed(internal::plan_bm3d_mix("normal", kRows, kCols, {256}));
  EXPECT_LT(mean_square(mixed, clean, 0, kMiddle - kEdge),
            0.5 * mean_square(estimate, clean, 0, kMiddle - kEdge));
  EXPECT_LT(mean_square(mixed, clean, kMiddle + kEdge, kCols),
            1.02 * mean_square(estimate, clean, kMiddle + kEdge, kCols));
}

// With nothing to tell them apart a mix leaves less than either, as errors differ.
TEST(Bm3dMix, OfEqualsTakesTheMean) {
  constexpr int kSize = 128;
  Image clean(kSize, kSize);
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c)
      clean(r, c) = 40 + 4 * static_cast<float>(std::sin(0.7 * r) * std::cos(0.5 * c + 0.02 * r));
  const Image noisy = sum_of(clean, noise_of(kSize, kSize, 1, 3));
  const float deviation = 1;
  Planes plane(1, kSize, kSize), error;
  plane[0] = noisy;
  const Planes plain = bm3d(plane, {&deviation, 1}, {}, {}, silent_progress(), &error);
  const double of_plain = mean_square(plain[0], clean, 0, kSize);
  // As far from the truth as BM3D, but otherwise.
  Image estimate = clean;
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c)
      estimate(r, c) += plain[0](kSize - 1 - r, c) - clean(kSize - 1 - r, c);
  double stated = 0;
  for (const float v : error[0].values()) stated += v / (kSize * kSize);
  const Image mixed =
      case_of(clean, estimate, static_cast<float>(stated)).mixed({"normal", kSize, kSize});
  EXPECT_LT(mean_square(mixed, clean, 0, kSize), 0.75 * of_plain);
}

TEST(Bm3dMix, PartsDoNotChangeAByte) {
  for (const auto& [rows, cols] : {std::pair{30, 830}, {830, 30}, {1, 400}, {3, 2}}) {
    const Image clean = stars(rows, std::max(cols, 2), 40, 15);
    const Case mono =
        case_of(clean, sum_of(clean, noise_of(clean.rows(), clean.cols(), 0.4f, 9)), 0.16f);
    const Image whole = mono.mixed({"normal", clean.rows(), clean.cols()});
    EXPECT_NE(whole.values(), mono.estimate.values());
    EXPECT_EQ(mono.mixed({"normal", 180, 180}).values(), whole.values()) << rows << ' ' << cols;
    EXPECT_EQ(mono.mixed({"normal", 360, 180}).values(), whole.values()) << rows << ' ' << cols;
  }
}

TEST(Bm3dMix, PartsAreAsLargeAsTheMemoryAllows) {
  const auto side = [](double memory_mib) {
    return internal::plan_bm3d_mix("normal", 8000, 9000, {memory_mib}).part_cols;
  };
  EXPECT_EQ(side(4096), 9000);
  const int grid = bm3d_reach({}).grid;
  EXPECT_EQ(side(200) % grid, 0);
  EXPECT_GT(side(400), side(200));
  EXPECT_GE(side(64), grid);
  EXPECT_THROW((void)side(8), InputError);
}

// What it decides by: cells of four pixels, of which the filter's tiles may hold half.
TEST(Bm3dMix, ErrorsOfCellsAreTheSameInTiles) {
  const Image noisy = sum_of(stars(40, 3000, 40, 15), noise_of(40, 3000, 1, 3));
  const SensorLayout layout = SensorLayout::named("mono");
  const MosaicFilterPlan plan = mosaic_filter_plan("nl-ridge", "fast", layout);
  internal::FrameTiles tiles{};
  const auto errors = [&](double memory_mib) {
    Image estimate(noisy.rows(), noisy.cols());
    Image cells(internal::cell_count(noisy.rows()), internal::cell_count(noisy.cols()));
    tiles = internal::filter_frame(source_of(noisy, layout), plan, {memory_mib}, estimate,
                                   {.cell_error = &cells}, silent_progress());
    return cells;
  };
  const Image whole = errors(1024);
  ASSERT_EQ(tiles.count, 1);
  EXPECT_EQ(tiles.work, 1.0);
  const Image tiled = errors(21.2);
  ASSERT_GT(tiles.count, 1);
  EXPECT_GT(tiles.work, 1.0);
  EXPECT_EQ(whole.values(), tiled.values());
  const double enough_mib = tiles.whole_mib;
  (void)errors(enough_mib);
  EXPECT_EQ(tiles.count, 1);
  (void)errors(enough_mib - 1.5);
  EXPECT_GT(tiles.count, 1);
}

TEST(Bm3dMix, StarsOfAMonoSensorComeOutAsCleanAsFromBm3dAndSlopesCleaner) {
  PhysicsChannel channel;
  channel.gain_dn_per_e = 0.5;
  channel.sigma_tl_dn = 2;
  const PhysicsNoise noise = equal_channels("mono", channel);
  const auto error = [&](const Image& clean, const char* method) {
    const RawFrame frame = drawn_frame(clean, noise, {.black_dn = 82}, 5);
    const Denoised result = denoise_frame(frame, profile_of(noise), {.method = method});
    return std::sqrt(mean_square(result.dn_above_black, clean, 0, clean.cols()));
  };
  const Image sky = stars(192, 192, 5, 60);
  EXPECT_LT(error(sky, "nl-ridge"), 1.02 * error(sky, "vst-bm3d"));
  Image slope(192, 192);
  for (int r = 0; r < 192; ++r)
    for (int c = 0; c < 192; ++c) slope(r, c) = 60 + 0.6f * static_cast<float>(c + r);
  EXPECT_LT(error(slope, "nl-ridge"), 0.6 * error(slope, "vst-bm3d"));
}

// Stein's estimate of what like pixels gain takes the noise that the residual lacks for kept, and a
// mix keeps less: with all of it crisp slanted stripes lost 3 dB.
TEST(Bm3dMix, LikePixelsTakeLittleOfTheKnowledgeOfSlantedStripes) {
  PhysicsChannel channel;
  channel.gain_dn_per_e = 0.4;
  channel.sigma_tl_dn = 1;
  const PhysicsNoise noise = equal_channels("mono", channel);
  constexpr int kSize = 192, kParts = 4;  // of a pixel, each way
  Image stripes(kSize, kSize, 1.6f);
  for (int r = 0; r < kParts * kSize; ++r)
    for (int c = 0; c < kParts * kSize; ++c) {
      const double across = (0.94 * c + 0.34 * r) / kParts / 12;
      if (across - std::floor(across) < 0.5) stripes(r / kParts, c / kParts) += 11.2f / 16;
    }
  const RawFrame frame = drawn_frame(stripes, noise, {.black_dn = 82}, 5);
  const auto error = [&](bool like_pixels) {
    const Denoised result = denoise_frame(frame, profile_of(noise), {.like_pixels = like_pixels});
    return std::sqrt(mean_square(result.dn_above_black, stripes, 0, kSize));
  };
  EXPECT_LT(error(true), 1.25 * error(false));
}

}  // namespace
}  // namespace malus
