// Truth: what a step sees is the same however the pool came to it, and the pace of makers that
// sleep.
#include "malus/neural/internal/example_pool.h"

#include "malus/base/error.h"
#include "malus/base/random.h"
#include "malus/neural/trainer.h"

#include <chrono>
#include <filesystem>
#include <thread>

#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::scene_config;
using testing::StopAfter;
using testing::TemporaryFolder;
using testing::weights_in;

TrainingExample example_of(std::uint32_t number) {
  RandomSequence random(1, number, Draw::kOther);
  const auto value = static_cast<float>(random.uniform());
  const auto planes = torch::arange(2 * 6 * 6, torch::kFloat32).reshape({2, 6, 6}) + 1000 * value;
  return {planes, planes.slice(0, 0, 1)};
}

TEST(Pool, IsTheSameHoweverTheBatchIsSharedAndWhereverItBegins) {
  PoolShape shape{.batch = 4,
                  .first_place = 0,
                  .places = 4,
                  .pool = 3,
                  .refresh = {0.4},
                  .patch_rows = 2,
                  .patch_cols = 3};
  ExamplePool whole(example_of, shape, 9, 0);
  shape.makers = 3;
  ExamplePool many(example_of, shape, 9, 0);
  shape.places = 2;
  ExamplePool first(example_of, shape, 9, 0);
  shape.first_place = 2;
  ExamplePool late(example_of, shape, 9, 11);
  for (int step = 0; step < 30; ++step) {
    const auto all = whole.batch(step);
    ASSERT_EQ(all.input.sizes(), (std::vector<std::int64_t>{4, 2, 2, 3}));
    EXPECT_TRUE(torch::equal(many.batch(step).input, all.input));
    EXPECT_TRUE(torch::equal(first.batch(step).input, all.input.slice(0, 0, 2)));
    if (step >= 11) {
      EXPECT_TRUE(torch::equal(late.batch(step).input, all.input.slice(0, 2, 4)));
    }
  }
}

TEST(Pool, HandsOnWhatItsMakerThrows) {
  const PoolShape shape{.batch = 1,
                        .first_place = 0,
                        .places = 1,
                        .pool = 1,
                        .refresh = {1},
                        .patch_rows = 2,
                        .patch_cols = 2};
  ExamplePool pool([](std::uint32_t) -> TrainingExample { throw InputError("a", "b", "c"); }, shape,
                   0, 0);
  EXPECT_THROW(pool.batch(0), InputError);
}

// One maker that takes 1 ms for an example, two places, steps of 12 ms: twelve examples per step,
// six for each place, of which nine tenths are asked for; at most one. With 10 ms, eight places and
// 8 ms they are 0.8 and 0.09, whatever a validation takes meanwhile. Sleeps are never too short,
// and a busy machine lengthens both.
TEST(Pool, MeasuresHowManyNewExamplesNoStepWaitsFor) {
  const auto sleep_ms = [](int ms) { std::this_thread::sleep_for(std::chrono::milliseconds(ms)); };
  const auto measured = [&](int maker_ms, int places, int step_ms, int validation_ms) {
    const PoolShape shape{.batch = places,
                          .first_place = 0,
                          .places = places,
                          .pool = 1000,
                          .refresh = {0, ExamplePool::kMeasuringSteps},
                          .patch_rows = 2,
                          .patch_cols = 3};
    ExamplePool pool(
        [&](std::uint32_t number) {
          sleep_ms(maker_ms);
          return example_of(number);
        },
        shape, 9, 0);
    for (int step = 0; step < ExamplePool::kMeasuringSteps; ++step) {
      pool.batch(step);
      sleep_ms(step_ms);
      if (step != ExamplePool::kMeasuringSteps / 2) continue;
      const Stopwatch beside;
      sleep_ms(validation_ms);
      pool.leave_out(beside.seconds());
    }
    EXPECT_TRUE(pool.refresh_is_due(ExamplePool::kMeasuringSteps));
    return pool.measured_refresh();
  };
  EXPECT_EQ(measured(1, 2, 12, 0), 1);
  for (const int validation_ms : {0, 800}) {
    const int step_ms = validation_ms > 0 ? 2 : 8;
    const double slow = measured(step_ms + step_ms / 4, 8, step_ms, validation_ms);
    EXPECT_GT(slow, 0.03) << validation_ms;
    EXPECT_LT(slow, 0.27) << validation_ms;
  }
}

// Until the refresh is known all steps draw from the first generation; from there on they are the
// same whether this pool measured it or a checkpoint brought it. Another one is due when a hundred
// steps were seen and twice as many made.
TEST(Pool, CountsFromWhereItsRefreshWasMeasured) {
  constexpr std::int64_t kFrom = 10;
  PoolShape shape{.batch = 1,
                  .first_place = 0,
                  .places = 1,
                  .pool = 3,
                  .refresh = {0, kFrom},
                  .patch_rows = 6,
                  .patch_cols = 6};
  ExamplePool measuring(example_of, shape, 9, 0);
  for (std::int64_t step = 0; step < kFrom; ++step)
    EXPECT_TRUE(torch::equal(measuring.batch(step).input[0], example_of(0).input)) << step;
  const auto expect_the_same = [&](const Refresh& refresh, std::int64_t end, std::int64_t due) {
    measuring.set_refresh(refresh);
    shape.refresh = refresh;
    ExamplePool resumed(example_of, shape, 9, refresh.from);
    bool changed = false;
    for (std::int64_t step = refresh.from; step < end; ++step) {
      const torch::Tensor seen = measuring.batch(step).input;
      EXPECT_TRUE(torch::equal(resumed.batch(step).input, seen)) << step;
      EXPECT_EQ(measuring.refresh_is_due(step + 1), step + 1 >= due) << step;
      changed = changed || !torch::equal(seen[0], example_of(0).input);
    }
    EXPECT_TRUE(changed);
  };
  expect_the_same({0.3, kFrom}, 150, kFrom + ExamplePool::kMeasuringSteps);
  const std::int64_t newest = measuring.refresh().newest(150);
  EXPECT_EQ(newest, 42);  // 140 steps
  expect_the_same({0.1, 150, newest}, 310, 300);
  // Lanes of three: at step 309 the newest example is 42 + 15.
  bool recent = false;
  for (std::uint32_t number : {55u, 56u, 57u})
    recent = recent || torch::equal(measuring.batch(309).input[0], example_of(number).input);
  EXPECT_TRUE(recent);
}

TEST(Training, GoesOnWithTheRefreshThatItMeasured) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.data.refresh = 0;
  config.train.steps = ExamplePool::kMeasuringSteps + 8;
  const auto worker = single_worker();
  StopAfter stop(ExamplePool::kMeasuringSteps + 3);
  EXPECT_THROW(train(config, {folder / "one", false, false, 3}, *worker, stop), Cancelled);
  std::filesystem::copy(folder / "one", folder / "two");
  const auto one = train(config, {folder / "one", true, false, 3}, *worker, silent_progress());
  const auto two = train(config, {folder / "two", true, false, 3}, *worker, silent_progress());
  const auto a = weights_in(folder / "one/weights.safetensors"),
             b = weights_in(folder / "two/weights.safetensors");
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::equal(a[i], b[i])) << i;
  EXPECT_EQ(one["log"].front()["refresh"], 0);
  EXPECT_GT(one["log"].back()["refresh"], 0);
  EXPECT_EQ(one["log"].back()["refresh"], one["log"][ExamplePool::kMeasuringSteps]["refresh"]);
  EXPECT_EQ(one["log"].back()["refresh"], two["log"].back()["refresh"]);
}

}  // namespace
}  // namespace malus
