// Truth: smooth pictures known without noise, noise from the generative law (synthesize/exact.h),
// fixed seeds.
#include "malus/denoise/internal/impulses.h"

#include "malus/base/parallel.h"
#include "malus/noise/model.h"
#include "malus/noise/tukey_lambda.h"

#include <cmath>

#include "denoise/drawn_frame.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kSize = 256;
constexpr double kReadSd = 6.0;

PhysicsNoise camera_noise(double lambda) {
  PhysicsNoise noise;
  noise.layout = SensorLayout::named("polar-bayer-rggb");
  noise.row_group = 2;
  noise.quantization_dn = 0;
  const double scale = kReadSd / std::sqrt(tukey_lambda_variance(lambda));
  noise.channels.assign(16, PhysicsChannel{1.0, lambda, 0.0, scale, 0.0});
  return noise;
}

Image smooth_light() {
  Image dn(kSize, kSize);
  for (int r = 0; r < kSize; ++r)
    for (int c = 0; c < kSize; ++c)
      dn(r, c) = static_cast<float>(8 + 5 * std::sin(0.02 * r) * std::cos(0.015 * c));
  return dn;
}

RawFrame noisy_frame(const Image& clean, const PhysicsNoise& noise) {
  return drawn_frame(clean, noise, {.black_dn = 64}, 5);
}

std::vector<DefectList::Place> found_in(const RawFrame& frame, const PhysicsNoise& noise) {
  Denoised report;
  const NoiseProfile profile = profile_of(noise);
  return find_impulses(prepare_frame(frame, profile, {.fill_impulses = false}, report), profile);
}

TEST(Impulses, OfAHeavyReadNoiseAreFound) {
  const PhysicsNoise noise = camera_noise(-0.3);
  const Image clean = smooth_light();
  const RawFrame frame = noisy_frame(clean, noise);
  const auto places = found_in(frame, noise);
  int far = 0, far_found = 0;  // further than the noise around can hide
  for (int r = 4; r < kSize - 4; ++r)
    for (int c = 4; c < kSize - 4; ++c)
      far += std::abs(frame.dn(r, c) - 64 - clean(r, c)) > 9 * kReadSd;
  for (const DefectList::Place& p : places) {
    const double off = std::abs(frame.dn(p.row, p.col) - 64 - clean(p.row, p.col));
    EXPECT_GT(off, 4 * kReadSd);
    far_found +=
        off > 9 * kReadSd && p.row >= 4 && p.col >= 4 && p.row < kSize - 4 && p.col < kSize - 4;
  }
  EXPECT_GT(far, 20);
  EXPECT_GT(far_found, 0.85 * far);  // the others have a neighbour that is off as well
}

TEST(Impulses, ThatNoLawExplainsAreThePicture) {
  const PhysicsNoise light = camera_noise(0.14), heavy = camera_noise(-0.3);
  Image stars = smooth_light();
  EXPECT_TRUE(found_in(noisy_frame(stars, light), light).empty());
  for (int r = 3; r < kSize; r += 6)
    for (int c = 3; c < kSize; c += 6) stars(r, c) += 200.0f;
  EXPECT_TRUE(found_in(noisy_frame(stars, light), light).empty());
  // More of them than even this law makes.
  EXPECT_TRUE(found_in(noisy_frame(stars, heavy), heavy).empty());
}

TEST(Impulses, AreFilledAndTheirErrorIsStated) {
  const PhysicsNoise noise = camera_noise(-0.3);
  const Image clean = smooth_light();
  const RawFrame frame = noisy_frame(clean, noise);
  const auto squared_error = [&](const Denoised& result) {
    double sum = 0;
    for (std::size_t i = 0; i < clean.size(); ++i)
      sum += std::pow(result.dn_above_black.values()[i] - clean.values()[i], 2);
    return sum;
  };
  for (const char* method : {"nl-ridge", "bm3d"}) {
    DenoiseSettings settings{.method = method, .profile = "fast"};
    const Denoised filled =
        denoise_frame(frame, profile_of(noise), settings, silent_progress(), true);
    EXPECT_GT(filled.impulse_pixels, 50);
    EXPECT_EQ(filled.defect_pixels, 0);
    settings.defects = false;
    const Denoised left = denoise_frame(frame, profile_of(noise), settings);
    EXPECT_EQ(left.impulse_pixels, 0);
    EXPECT_LT(squared_error(filled), 0.4 * squared_error(left)) << method;
    for (const float variance : filled.variance_dn2->values()) ASSERT_GT(variance, 0);
  }
  EXPECT_EQ(denoise_frame(frame, profile_of(noise), {.method = "paper-bm3d"}).impulse_pixels, 0);
}

TEST(Impulses, AreTheSameForAnyNumberOfThreads) {
  const PhysicsNoise noise = camera_noise(-0.3);
  const RawFrame frame = noisy_frame(smooth_light(), noise);
  const auto places = found_in(frame, noise);
  const int before = thread_count();
  set_thread_count(before == 1 ? 3 : 1);
  const auto alone = found_in(frame, noise);
  set_thread_count(before);
  ASSERT_EQ(places.size(), alone.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    EXPECT_EQ(places[i].row, alone[i].row);
    EXPECT_EQ(places[i].col, alone[i].col);
  }
}

}  // namespace
}  // namespace malus
