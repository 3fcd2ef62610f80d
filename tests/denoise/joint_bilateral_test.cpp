// Truth: pictures without noise, Gaussian noise of deviation 1 with fixed seeds, and estimates
// whose error is known because the test made them.
#include "malus/denoise/internal/joint_bilateral.h"

#include "malus/base/error.h"
#include "malus/base/progress.h"
#include "malus/base/random.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/internal/bilateral_kernel.h"
#include "malus/denoise/internal/kept_noise.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>
#include <vector>

#include "denoise/drawn_frame.h"
#include "denoise/instruction_sets.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kPrintRows = 200, kPrintCols = 180;
constexpr float kPaper = 60, kInk = 45;

Image with_unit_noise(const Image& clean, std::uint64_t seed) {
  RandomSequence random(seed, 0, Draw::kOther);
  Image noisy = clean;
  for (float& v : noisy.values()) v += static_cast<float>(random.normal());
  return noisy;
}

// Squares of `side` pixels, ink or paper by chance, as in a QR code; every channel has its own
// levels.
Image printed(int side) {
  RandomSequence random(5, 0, Draw::kOther);
  Image squares(kPrintRows, kPrintCols), picture(kPrintRows, kPrintCols);
  for (float& v : squares.values()) v = random.normal() > 0 ? kInk : kPaper;
  for (int r = 0; r < kPrintRows; ++r)
    for (int c = 0; c < kPrintCols; ++c)
      picture(r, c) = squares(r / side, c / side) + 3.0f * static_cast<float>(r % 4 + c % 4);
  return picture;
}

double squared_error(const Image& estimate, const Image& clean) {
  double sum = 0;
  for (std::size_t i = 0; i < clean.size(); ++i)
    sum += std::pow(double{estimate.values()[i]} - double{clean.values()[i]}, 2);
  return sum / static_cast<double>(clean.size());
}

internal::SampleNoise sample_noise(float uncut, float variance) {
  return {std::vector<float>(16, uncut), [variance](std::size_t, float) { return variance; }};
}

struct Averaged {
  Image estimate, error;
};

Averaged averaged(const Image& samples, const Image& estimate, float error,
                  double memory_mib = 1024, float uncut = 1e5f, float sure_noise = 1.0f,
                  const char* layout_name = "polar-bayer-rggb") {
  const SensorLayout layout = SensorLayout::named(layout_name);
  Averaged result{estimate, Image(estimate.rows(), estimate.cols(), error)};
  const Image cell_error(internal::cell_count(estimate.rows()),
                         internal::cell_count(estimate.cols()), error);
  internal::average_alike_pixels(source_of(samples, layout), sample_noise(uncut, sure_noise),
                                 {memory_mib}, {result.estimate, cell_error, &result.error},
                                 silent_progress());
  return result;
}

// A filter of blocks that finds none alike leaves the samples as they are.
TEST(JointBilateral, AveragesPrintThatTheFilterLeftNoisyAndStatesItsError) {
  const Image clean = printed(3), noisy = with_unit_noise(clean, 1);
  const Averaged result = averaged(noisy, noisy, 1.0f);
  const double error = squared_error(result.estimate, clean);
  EXPECT_LT(error, 0.03);
  double stated = 0;
  for (const float v : result.error.values()) stated += double{v} / double(result.error.size());
  EXPECT_GT(stated, error / 2);
  // Few pixels tell what a round has left of the error, and what is left is not below 0.
  EXPECT_LT(stated, error * 5);
}

// What polarization does not tell apart is averaged furthest.
TEST(JointBilateral, LooksFurtherOnSensorsWithoutPolarizers) {
  Image clean = printed(3);
  for (int r = 0; r < kPrintRows; ++r)
    for (int c = 0; c < kPrintCols; ++c) clean(r, c) -= 3.0f * static_cast<float>(r % 4 + c % 4);
  const Image noisy = with_unit_noise(clean, 12);
  const auto left = [&](const char* layout) {
    return squared_error(averaged(noisy, noisy, 1.0f, 1024, 1e5f, 1.0f, layout).estimate, clean);
  };
  EXPECT_LT(left("mono"), 0.005);  // 0.01 of 17x17 pixels
  EXPECT_GT(left("polar-mono"), 0.005);
}

// What a filter with the gain g leaves of the noise n: the residual (1 - g) n, the error g n.
TEST(KeptNoise, IsTheGainOfAFilterThatShrinksEverything) {
  const SensorLayout layout = SensorLayout::named("mono");
  const Image clean(kPrintRows, kPrintCols, 50), noisy = with_unit_noise(clean, 13);
  constexpr float kGain = 0.25f;
  Image estimate = clean;
  for (std::size_t i = 0; i < clean.size(); ++i)
    estimate.values()[i] += kGain * (noisy.values()[i] - clean.values()[i]);
  const auto kept = [&](float error) {
    const Image cell_error(internal::cell_count(kPrintRows), internal::cell_count(kPrintCols),
                           error);
    const internal::SampleNoise noise = sample_noise(1e5f, 1.0f);
    const internal::PixelStrip strip{layout, noisy, estimate, cell_error, noise, 0};
    const Image all = internal::measure_kept_noise(strip).all;
    double sum = 0;
    for (const float v : all.values()) sum += double{v} / double(all.size());
    return sum;
  };
  EXPECT_NEAR(kept(kGain * kGain), kGain, 0.01);
  // No more than the residual lacks.
  EXPECT_NEAR(kept(1.0f), 1 - (1 - kGain) * (1 - kGain), 0.01);
}

// Of each 2x2 pixels the filter has left the mean as it was, and knows the rest: polarization.
TEST(JointBilateral, LeavesWhatTheFilterKnowsOfPolarization) {
  const Image clean = printed(4), noisy = with_unit_noise(clean, 11);
  const auto common = [](const Image& a, const Image& b, int r, int c) {
    float sum = 0;
    for (int i = r / 2 * 2; i < r / 2 * 2 + 2; ++i)
      for (int k = c / 2 * 2; k < c / 2 * 2 + 2; ++k) sum += a(i, k) - b(i, k);
    return sum / 4;
  };
  Image estimate = clean;
  for (int r = 0; r < kPrintRows; ++r)
    for (int c = 0; c < kPrintCols; ++c) estimate(r, c) += common(noisy, clean, r, c);
  const Image result = averaged(noisy, estimate, 0.25f).estimate;
  double mean_square = 0, rest_square = 0;
  for (int r = 0; r < kPrintRows; ++r)
    for (int c = 0; c < kPrintCols; ++c) {
      const float mean = common(result, clean, r, c);
      mean_square += double{mean} * mean / double(clean.size());
      rest_square += std::pow(double{result(r, c) - clean(r, c) - mean}, 2) / double(clean.size());
    }
  EXPECT_LT(mean_square, 0.05);    // of 0.25
  EXPECT_LT(rest_square, 0.0045);  // 0.006 with one share for all
}

// Every value once: nothing is alike, so whatever is averaged is lost.
TEST(JointBilateral, LeavesTextureAsItIs) {
  RandomSequence random(2, 0, Draw::kOther);
  Image clean(kPrintRows, kPrintCols, 50);
  for (float& v : clean.values()) v += 3 * static_cast<float>(random.normal());
  const Image noisy = with_unit_noise(clean, 3);
  EXPECT_LT(squared_error(averaged(noisy, noisy, 1.0f).estimate, clean),
            1.005 * squared_error(noisy, clean));
}

// An estimate that has lost detail, and no noise left to take.
TEST(JointBilateral, LeavesAnEstimateWithoutNoise) {
  const Image clean(kPrintRows, kPrintCols, 50), noisy = with_unit_noise(clean, 4);
  const Image estimate(kPrintRows, kPrintCols, 50.1f);
  EXPECT_EQ(averaged(noisy, estimate, 0.01f).estimate, estimate);
}

// White cuts the noise off: the samples differ by less from the estimate, which tells nothing.
TEST(JointBilateral, LeavesLightNearWhite) {
  Image clean(kPrintRows, kPrintCols, 50);
  for (int c = 0; c < kPrintCols; ++c)
    for (int r = 0; r < kPrintRows; ++r) clean(r, c) += 0.002f * static_cast<float>(c * (r % 2));
  Image noisy = with_unit_noise(clean, 6);
  for (float& v : noisy.values()) v = std::min(v, 50.0f);
  EXPECT_EQ(averaged(noisy, clean, 0.1f, 1024, 48.0f).estimate, clean);
}

// Less noise than was told looks like noise that the estimate has kept.
TEST(JointBilateral, BelievesNoMoreNoiseThanIsSure) {
  RandomSequence random(10, 0, Draw::kOther);
  Image clean(kPrintRows, kPrintCols), noisy(kPrintRows, kPrintCols);
  for (std::size_t i = 0; i < clean.size(); ++i) {
    clean.values()[i] = 50 + 0.3f * static_cast<float>(random.normal());
    noisy.values()[i] = clean.values()[i] + 0.85f * static_cast<float>(random.normal());
  }
  EXPECT_NE(averaged(noisy, clean, 0.1f).estimate, clean);
  EXPECT_EQ(averaged(noisy, clean, 0.1f, 1024, 1e5f, 0.7f).estimate, clean);
}

// A star: nothing around it is like it.
TEST(JointBilateral, LeavesAPixelThatIsAlone) {
  Image clean = printed(3);
  clean(100, 90) = 200;
  const Image noisy = with_unit_noise(clean, 7);
  Image estimate = noisy;
  estimate(100, 90) = 190;
  const Averaged result = averaged(noisy, estimate, 1.0f);
  EXPECT_EQ(result.estimate(100, 90), 190);
  EXPECT_EQ(result.error(100, 90), 1.0f);
}

TEST(JointBilateral, StripsAreAsTheWholeFrame) {
  const Image clean = printed(5), noisy = with_unit_noise(clean, 8);
  const Averaged whole = averaged(noisy, noisy, 1.0f), strips = averaged(noisy, noisy, 1.0f, 0.0);
  EXPECT_EQ(whole.estimate, strips.estimate);
  EXPECT_EQ(whole.error, strips.error);
  EXPECT_LT(squared_error(whole.estimate, clean), 0.05);
}

// The whole pipeline, of which the step is a setting.
TEST(JointBilateral, IsLeftOutIfAsked) {
  PhysicsNoise noise = equal_channels("polar-bayer-rggb", {1.5, 0.1, -0.4, 1.8, 0.6});
  noise.row_group = 2;
  Image clean = printed(3);
  for (float& v : clean.values()) v *= 8;
  const RawFrame frame = drawn_frame(clean, noise, {.black_dn = 82}, 8);
  const auto error = [&](bool like_pixels) {
    return squared_error(
        denoise_frame(frame, profile_of(noise), {.like_pixels = like_pixels}).dn_above_black,
        clean);
  };
  EXPECT_LT(error(true), 0.5 * error(false));
}

// In the dark stabilised samples have less than unit noise, which is no noise that was kept.
TEST(JointBilateral, LeavesEvenDarkLight) {
  const PhysicsNoise noise = equal_channels("polar-mono", {1.0, 0.14, 0, 0.7, 0});
  const RawFrame frame = drawn_frame(Image(128, 128, 0.2f), noise, {.black_dn = 82}, 9);
  const auto result = [&](bool like_pixels) {
    return denoise_frame(frame, profile_of(noise), {.like_pixels = like_pixels}).dn_above_black;
  };
  EXPECT_EQ(result(true), result(false));
}

TEST(JointBilateral, StopsWhenAsked) {
  class Stopped : public Progress {
    void begin(std::string_view, std::int64_t) override {}
    void advance(std::int64_t) override {}
    void warn(std::string_view) override {}
    bool stop_requested() const override { return true; }
  } stopped;
  Image estimate = printed(3);
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  EXPECT_THROW(internal::average_alike_pixels(source_of(estimate, layout), sample_noise(1e5f, 1.0f),
                                              {1024}, {estimate, Image(50, 45, 1.0f)}, stopped),
               Cancelled);
}

// The definition, in double precision.
TEST(BilateralKernel, IsTheWeightedMeanAndItsDerivative) {
  constexpr int kReach = 2, kSpacing = 2, kMargin = kReach * kSpacing, kSide = 2 * kMargin + 1;
  constexpr int kWidth = kSide - 1 + internal::kLanes;
  RandomSequence random(9, 0, Draw::kOther);
  Image samples(kSide, kWidth), guide(kSide, kWidth, internal::kNoGuide);
  for (float& v : samples.values()) v = static_cast<float>(random.normal());
  for (int r = 1; r < kSide; ++r)
    for (int c = 0; c < kWidth; ++c) guide(r, c) = static_cast<float>(random.normal());
  constexpr float kPerCut = 0.6f;
  const auto compute = [&] {
    std::vector<float> per_cut(internal::kLanes, kPerCut);
    const std::uint8_t wanted = 1;
    Image out(3, internal::kLanes);
    const std::ptrdiff_t at = kMargin * kWidth + kMargin;
    internal::average_alike({samples.values().data() + at, guide.values().data() + at, kWidth,
                             kSpacing, kSpacing, kReach, 1, &wanted, per_cut.data(), out.row(0),
                             out.row(1), out.row(2)});
    return out;
  };
  const Image out = compute();
  for (int lane = 0; lane < internal::kLanes; ++lane) {
    const auto mean = [&](double moved, double* own) {
      double weights = 0, sum = 0;
      for (int i = -kReach; i <= kReach; ++i)
        for (int k = -kReach; k <= kReach; ++k) {
          const int r = kMargin + i * kSpacing, c = kMargin + lane + k * kSpacing;
          const double u = (double{guide(r, c)} - guide(kMargin, kMargin + lane) - moved) * kPerCut;
          const double weight = u * u < 1 ? std::pow(1 - u * u, 4) : 0;
          weights += weight;
          sum += weight * samples(r, c);
        }
      if (own) *own = 1 / weights;
      return sum / weights;
    };
    double own = 0;
    EXPECT_NEAR(out(0, lane), mean(0, &own), 1e-5) << lane;
    EXPECT_NEAR(out(1, lane), own, 1e-5) << lane;
    EXPECT_NEAR(out(2, lane), (mean(1e-4, nullptr) - mean(-1e-4, nullptr)) / 2e-4, 1e-4) << lane;
  }
  expect_same_on_every_instruction_set(compute, 1e-5);
}

// The step was left out below 0.32 steps, and print kept its noise: between two codes, all of it.
TEST(JointBilateral, AveragesPrintWhoseNoiseTheConverterHides) {
  constexpr float kDark = 0.54f, kBright = 4.59f, kSd = 0.25f;
  Image clean = printed(3);
  for (int r = 0; r < kPrintRows; ++r)
    for (int c = 0; c < kPrintCols; ++c)
      clean(r, c) = clean(r, c) - 3.0f * static_cast<float>(r % 4 + c % 4) < 50 ? kDark : kBright;
  RandomSequence random(3, 0, Draw::kOther);
  RawFrame frame;
  frame.layout = SensorLayout::named("mono");
  frame.dn = clean;
  for (float& v : frame.dn.values())
    v = std::round(16 + v + kSd * static_cast<float>(random.normal()));
  frame.bits = 8;
  frame.black_dn = {16.0};
  frame.white_dn = 255;
  frame.black_known = frame.white_known = true;
  NoiseProfile profile;
  profile.layout = frame.layout;
  profile.step_dn = 1;
  profile.channels.push_back({.variance = VarianceCurve::affine(0, kSd * kSd + 1.0 / 12)});
  const double error =
      squared_error(denoise_frame(frame, profile, {.profile = "fast"}).dn_above_black, clean);
  EXPECT_LT(error, 0.12);  // of 0.24
}

// All pixels may have been rounded alike, which no average tells.
TEST(JointBilateral, StatesNoLessErrorWhereAStepHidesTheNoise) {
  const Image noisy = with_unit_noise(printed(3), 1);
  const SensorLayout layout = SensorLayout::named("polar-bayer-rggb");
  internal::SampleNoise noise = sample_noise(1e5f, 1.0f);
  noise.hides = [](std::size_t, float) { return true; };
  Image estimate = noisy, error(kPrintRows, kPrintCols, 1.0f);
  const Image cell_error(internal::cell_count(kPrintRows), internal::cell_count(kPrintCols), 1.0f);
  internal::average_alike_pixels(source_of(noisy, layout), noise, {1024},
                                 {estimate, cell_error, &error}, silent_progress());
  const Averaged seen = averaged(noisy, noisy, 1.0f);
  EXPECT_EQ(estimate.values(), seen.estimate.values());
  EXPECT_NE(seen.error.values(), error.values());
  for (const float v : error.values()) ASSERT_EQ(v, 1.0f);
}

}  // namespace
}  // namespace malus
