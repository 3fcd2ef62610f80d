#include "malus/neural/noise_flow.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/evaluate/divergence.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/neural/threads.h"

#include <cmath>
#include <limits>

#include "problem_of.h"
#include "support.h"
#include <ATen/Parallel.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;

// A flow whose couplings do something: random weights where training starts with zeros.
NoiseFlow busy_flow(std::int64_t channels, std::int64_t steps) {
  torch::manual_seed(5);
  NoiseFlow flow(channels, steps, 6);
  const torch::NoGradGuard no_gradients;
  for (const auto& item : flow.named_parameters())
    if (!item.key().ends_with("mixing")) torch::Tensor(item.value()).normal_(0, 0.15);
  flow.to(torch::kDouble);
  return flow;
}

TEST(NoiseFlow, InverseUndoesForward) {
  for (const std::int64_t channels : {1, 4, 16}) {
    auto flow = busy_flow(channels, 4);
    const auto noise = torch::randn({2, channels, 7, 6}, torch::kDouble);
    const auto clean = torch::rand({2, channels, 7, 6}, torch::kDouble);
    const auto gain = torch::tensor({0.3, 1.2}, torch::kDouble);
    const auto back = flow.inverse(flow.forward(noise, clean, gain).z, clean, gain);
    EXPECT_LT((back - noise).abs().max().item().toDouble(), 1e-9) << channels;
  }
}

// Change of variables against the whole numeric Jacobian.
TEST(NoiseFlow, LogDeterminantIsThatOfTheJacobian) {
  auto flow = busy_flow(2, 4);
  const torch::NoGradGuard no_gradients;
  const auto noise = torch::randn({1, 2, 3, 2}, torch::kDouble);
  const auto clean = torch::rand({1, 2, 3, 2}, torch::kDouble);
  const auto gain = torch::tensor({0.7}, torch::kDouble);
  const auto n = noise.numel();
  auto jacobian = torch::empty({n, n}, torch::kDouble);
  constexpr double kStep = 1e-6;
  for (std::int64_t i = 0; i < n; ++i) {
    auto up = noise.clone(), down = noise.clone();
    up.view(-1)[i] += kStep;
    down.view(-1)[i] -= kStep;
    jacobian.select(1, i).copy_(
        (flow.forward(up, clean, gain).z - flow.forward(down, clean, gain).z).reshape(-1) /
        (2 * kStep));
  }
  const double expected = std::get<1>(torch::linalg_slogdet(jacobian)).item().toDouble();
  EXPECT_NEAR(flow.forward(noise, clean, gain).log_det.item().toDouble(), expected, 1e-5);
}

// Without couplings the flow is a heteroscedastic Gaussian: its likelihood has a closed form.
TEST(NoiseFlow, LikelihoodOfTheGaussianLayersIsExact) {
  NoiseFlow flow(1, 0, 1);
  flow.start_at(0.02, 0.003);
  const auto clean = torch::tensor({0.5}).view({1, 1, 1, 1});
  const auto noise = torch::tensor({0.1}).view({1, 1, 1, 1});
  const double variance = 0.02 * 0.5 + 0.003;
  EXPECT_NEAR(flow.log_likelihood(noise, clean, torch::zeros({1})).item().toDouble(),
              -0.5 * (0.01 / variance + std::log(2 * M_PI * variance)), 1e-5);
}

constexpr double kPairSlopeDn = 2.5, kPairOffsetDn2 = 30;

// Heteroscedastic Gaussian noise on a ramp: variance = slope * signal + offset.
NoiseFlowPair simulated_pair(std::uint32_t frame) {
  NoiseFlowPair pair{Image(96, 96), Image(96, 96), {.gain_db = 12.0, .iso = {}}};
  RandomSequence random(8, frame, Draw::kScene);
  for (int r = 0; r < 96; ++r)
    for (int c = 0; c < 96; ++c) {
      const double signal = 20.0 + 9.0 * c;
      pair.clean_dn(r, c) = static_cast<float>(signal);
      pair.noisy_dn(r, c) = static_cast<float>(
          signal + std::sqrt(kPairSlopeDn * signal + kPairOffsetDn2) * random.normal());
    }
  return pair;
}

NoiseFlowSensor sensor() { return {"bayer-rggb", {64, 64, 64, 64}, 1087, 0, 0}; }

// Couplings that do something, which those of a new model do not.
NoiseFlowModel model_with_random_weights(std::int64_t couplings, std::int64_t width) {
  NoiseFlowModel model(sensor(), couplings, width);
  const torch::NoGradGuard no_gradients;
  torch::manual_seed(5);
  for (const auto& item : model.network().named_parameters())
    if (!item.key().ends_with("mixing")) torch::Tensor(item.value()).normal_(0, 0.15);
  return model;
}

// Of a small flow.
NoiseFlowSettings brief_training(int steps) {
  NoiseFlowSettings settings;
  settings.couplings = 2;
  settings.width = 4;
  settings.steps = steps;
  settings.batch = 4;
  settings.crop = 16;
  return settings;
}

TEST(NoiseFlow, LearnsAHeteroscedasticGaussian) {
  std::vector<NoiseFlowPair> pairs;
  for (std::uint32_t frame = 0; frame < 4; ++frame) pairs.push_back(simulated_pair(frame));
  auto fit = train_noise_flow(sensor(), pairs, brief_training(120), 3);
  const testing::TemporaryFolder folder;
  fit.model.save(folder / "flow.safetensors", fit.record);
  NoiseFlowModel model(folder / "flow.safetensors");
  const NoiseFlowPair truth = simulated_pair(77);
  const GainSetting gain{.gain_db = 12.0, .iso = {}};
  const Image drawn = model.draw(truth.clean_dn.view(), gain, {.seed = 1, .frame = 2});
  // Deviation at the dark and the bright end.
  for (const auto& [from, to] : {std::pair{0, 24}, {72, 96}}) {
    double square = 0, expected = 0;
    for (int r = 0; r < 96; ++r)
      for (int c = from; c < to; ++c) {
        square += std::pow(static_cast<double>(drawn(r, c) - truth.clean_dn(r, c)), 2);
        expected += kPairSlopeDn * static_cast<double>(truth.clean_dn(r, c)) + kPairOffsetDn2;
      }
    // 2304 samples: 3 % standard error of the variance; training itself is brief.
    EXPECT_NEAR(square / expected, 1, 0.15) << from;
  }
  EXPECT_THROW(model.draw(truth.clean_dn.view(), {.gain_db = 24.0, .iso = {}}, {}), InputError);
}

// Read noise without gain lies decades below the mean noise of both gains, and a brief training
// moves weights little: the first layer has to begin at each gain's own line.
TEST(NoiseFlow, TheDarkOfALowGainIsLearntBesideAHighGain) {
  const auto variance = [](double signal, double gain_db) {
    const double factor = std::pow(10, gain_db / 20);
    return factor * 0.36 * signal + factor * factor * 0.4;
  };
  std::vector<NoiseFlowPair> pairs;
  for (const double gain_db : {0.0, 24.0}) {
    NoiseFlowPair pair{Image(128, 128), Image(128, 128), {.gain_db = gain_db, .iso = {}}};
    RandomSequence random(8, static_cast<std::uint32_t>(gain_db), Draw::kScene);
    for (int r = 0; r < 128; ++r)
      for (int c = 0; c < 128; ++c) {
        const double signal = std::exp(0.05 * c) - 1;  // to 570 DN
        pair.clean_dn(r, c) = static_cast<float>(signal);
        pair.noisy_dn(r, c) =
            static_cast<float>(signal + std::sqrt(variance(signal, gain_db)) * random.normal());
      }
    pairs.push_back(std::move(pair));
  }
  std::vector<NoiseFlowPair> mixed = pairs;
  mixed.back().gain = {.gain_db = {}, .iso = 1600};
  EXPECT_THROW(train_noise_flow(sensor(), mixed, brief_training(60), 3), InputError);
  const auto fit = train_noise_flow(sensor(), pairs, brief_training(60), 3);
  for (const NoiseFlowPair& pair : pairs)
    for (const auto& [from, to] : {std::pair{0, 32}, {32, 96}, {96, 128}}) {
      const Image drawn = fit.model.draw(pair.clean_dn.view(), pair.gain, {.seed = 1});
      double ratio = 0;
      for (int r = 0; r < 128; ++r)
        for (int c = from; c < to; ++c)
          ratio += std::pow(static_cast<double>(drawn(r, c) - pair.clean_dn(r, c)), 2) /
                   variance(static_cast<double>(pair.clean_dn(r, c)), *pair.gain.gain_db);
      // 4096 samples: 2.2 % standard error, and as much of those that were learnt from.
      EXPECT_NEAR(ratio / (128 * (to - from)), 1, 0.15) << *pair.gain.gain_db << " dB, " << from;
    }
}

// Integers of noise near one step q: a drawn frame, rounded or not, has the recorded frames'
// variance, neither the spread over ±q/2 that training adds (q²/12) nor a second rounding (q²/12
// more).
class NoiseFlowSteps : public ::testing::TestWithParam<double> {};

TEST_P(NoiseFlowSteps, DrawnFramesAreRoundedOnce) {
  const double step = GetParam(), deviation = 0.7 * step;
  std::vector<NoiseFlowPair> pairs;
  double recorded = 0;
  for (std::uint32_t frame = 0; frame < 6; ++frame) {
    NoiseFlowPair pair{Image(128, 128), Image(128, 128), {.gain_db = 12.0, .iso = {}}};
    RandomSequence random(9, frame, Draw::kScene);
    for (int r = 0; r < 128; ++r)
      for (int c = 0; c < 128; ++c) {
        const double signal = step * (10 + 0.37 * c);  // all phases of the lattice
        pair.clean_dn(r, c) = static_cast<float>(signal);
        pair.noisy_dn(r, c) =
            static_cast<float>(step * std::round((signal + deviation * random.normal()) / step));
        recorded +=
            std::pow(static_cast<double>(pair.noisy_dn(r, c)) - signal, 2) / (6 * 128 * 128);
      }
    pair.step_dn = frame == 0 ? 3 * step : step;
    pairs.push_back(std::move(pair));
  }
  for (const int couplings : {0, 2}) {
    NoiseFlowSettings settings;
    settings.couplings = couplings;
    settings.width = 4;
    settings.steps = 300;
    settings.batch = 4;
    settings.crop = 24;
    auto fit = train_noise_flow(sensor(), pairs, settings, 3);
    ASSERT_EQ(fit.model.sensor().spread_dn, step);
    const testing::TemporaryFolder folder;
    fit.model.save(folder / "flow.safetensors", fit.record);
    NoiseFlowModel model(folder / "flow.safetensors");
    double rounded = 0, plain = 0;
    for (std::uint32_t frame = 0; frame < 6; ++frame) {
      const DrawAddress address{.seed = 4, .frame = frame};
      const Image& clean = pairs[0].clean_dn;
      const RawFrame raw = model.draw_raw(clean.view(), pairs[0].gain, address);
      const Image dn = model.draw(clean.view(), pairs[0].gain, address);
      for (std::size_t i = 0; i < clean.size(); ++i) {
        rounded += std::pow(raw.dn.values()[i] - 64.0 - clean.values()[i], 2) / (6 * 128 * 128);
        plain +=
            std::pow(static_cast<double>(dn.values()[i]) - clean.values()[i], 2) / (6 * 128 * 128);
      }
    }
    // 98,304 samples: five standard errors of a variance are 2.3 % (and of the recorded one as
    // much); q²/12 is 14 % of it.
    EXPECT_NEAR(rounded / recorded, 1, 0.04) << couplings;
    EXPECT_NEAR(plain / recorded, 1, 0.04) << couplings;
  }
}

INSTANTIATE_TEST_SUITE_P(NoiseFlow, NoiseFlowSteps, ::testing::Values(1.0, 16.0));

// The couplings see 3 x 3 pixels of the planes each.
TEST(NoiseFlow, PixelsThatAreNoNumbersStayAlone) {
  NoiseFlowModel model = model_with_random_weights(2, 4);
  Image clean(40, 40, 300.0f);
  clean(20, 20) = std::numeric_limits<float>::quiet_NaN();
  clean(21, 24) = std::numeric_limits<float>::infinity();
  const GainSetting gain{.gain_db = 0.0, .iso = {}};
  const Image drawn = model.draw(clean.view(), gain, {.seed = 4});
  const RawFrame raw = model.draw_raw(clean.view(), gain, {.seed = 4});
  for (int r = 0; r < 40; ++r)
    for (int c = 0; c < 40; ++c)
      if (std::isfinite(clean(r, c))) {
        ASSERT_TRUE(std::isfinite(drawn(r, c))) << r << ' ' << c;
      }
  EXPECT_TRUE(std::isnan(drawn(20, 20)));
  EXPECT_EQ(drawn(21, 24), std::numeric_limits<float>::infinity());
  EXPECT_EQ(raw.dn(20, 20), 0.0f);
  EXPECT_EQ(raw.dn(21, 24), 1087.0f);
}

TEST(NoiseFlow, TheSameSeedAndFrameDrawTheSameNoise) {
  NoiseFlowModel model(sensor(), 0, 1);
  const GainSetting gain{.gain_db = 0.0, .iso = {}};
  Image clean(20, 24);
  for (float& v : clean.values()) v = 300;
  const Image whole = model.draw(clean.view(), gain, {.seed = 4, .frame = 9});
  EXPECT_EQ(whole, model.draw(clean.view(), gain, {.seed = 4, .frame = 9}));
  EXPECT_NE(whole, model.draw(clean.view(), gain, {.seed = 4, .frame = 10}));
  // Without couplings a crop draws the frame's own noise.
  const Image part = model.draw(clean.view().window(4, 6, 8, 10), gain,
                                {.seed = 4, .frame = 9, .row0 = 4, .col0 = 6});
  for (int r = 0; r < 8; ++r)
    for (int c = 0; c < 10; ++c) EXPECT_EQ(part(r, c), whole(r + 4, c + 6));
}

// A frame of several strips: in a part of it their edges lie elsewhere. Couplings reach two pixels
// of the planes each, four of this mosaic.
TEST(NoiseFlow, TheEdgesOfStripsDoNotShow) {
  constexpr int kCouplings = 4, kReach = 4 * kCouplings, kTop = 70, kRows = 560;
  NoiseFlowModel model = model_with_random_weights(kCouplings, 4);
  Image clean(640, 24);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c) clean(r, c) = static_cast<float>(r + 7 * c);
  const GainSetting gain{.gain_db = 0.0, .iso = {}};
  const Image whole = model.draw(clean.view(), gain, {.seed = 4});
  const Image part =
      model.draw(clean.view().window(kTop, 0, kRows, 24), gain, {.seed = 4, .row0 = kTop});
  for (int r = kReach; r < kRows - kReach; ++r)
    for (int c = 0; c < 24; ++c) ASSERT_NEAR(part(r, c), whole(r + kTop, c), 0.01) << r << ' ' << c;
}

// libtorch's loops end elsewhere with other numbers of threads, and round there in another way:
// 1083 of 16384 pixels differed by 6e-5 DN. And strips are drawn by malus' own threads.
TEST(NoiseFlow, AnyNumberOfThreadsDrawsTheSameNoise) {
  NoiseFlowModel model = model_with_random_weights(4, 16);
  Image clean(300, 404);
  for (int r = 0; r < clean.rows(); ++r)
    for (int c = 0; c < clean.cols(); ++c) clean(r, c) = static_cast<float>(c);
  const int threads = at::get_num_threads();
  std::vector<Image> drawn;
  for (const int n : {1, 2, 3}) {
    use_network_threads(n);
    set_thread_count(n);
    drawn.push_back(model.draw(clean.view(), {.gain_db = 0.0, .iso = {}}, {.seed = 4}));
    EXPECT_EQ(at::get_num_threads(), n);
  }
  use_network_threads(threads);
  set_thread_count(0);
  EXPECT_EQ(drawn[0], drawn[1]);
  EXPECT_EQ(drawn[0], drawn[2]);
}

TEST(NoiseFlow, PairsThatCannotBeLearntFromAreRefused) {
  EXPECT_THROW(train_noise_flow(sensor(), {}, {}, 0), InputError);
  NoiseFlowPair pair = simulated_pair(0);
  pair.gain = {};
  EXPECT_THROW(train_noise_flow(sensor(), {pair}, {}, 0), InputError);
}

TEST(NoiseFlow, PairsThatAreRefusedAreNamed) {
  const NoiseFlowPair good = simulated_pair(0);
  const auto refused = [&](NoiseFlowPair bad) {
    bad.name = "night_3.npy";
    return problem_of([&] { train_noise_flow(sensor(), {good, std::move(bad)}, {}, 0); });
  };
  NoiseFlowPair unlike = good, small = good, unknown = good;
  unlike.clean_dn = Image(96, 80);
  small.noisy_dn = small.clean_dn = Image(8, 8);
  unknown.gain = {};
  for (const NoiseFlowPair& pair : {unlike, small, unknown})
    EXPECT_TRUE(refused(pair).starts_with("night_3.npy: ")) << refused(pair);
}

}  // namespace
}  // namespace malus
