#include "malus/neural/internal/loss_watch.h"

#include "malus/base/error.h"

#include <cmath>
#include <limits>

#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;

constexpr double kNoBase = std::numeric_limits<double>::quiet_NaN();

TEST(LossWatch, StopsWhereLossOrGradientIsNoNumber) {
  LossWatch watch("run.toml");
  double first = 0;
  EXPECT_NO_THROW(watch.see(0.5, kNoBase, 1, 0, first));
  EXPECT_EQ(first, 0.5);
  EXPECT_THROW(watch.see(std::nan(""), 1, 1, 1, first), InputError);
  EXPECT_THROW(watch.see(1, 1, INFINITY, 1, first), InputError);
}

TEST(LossWatch, SaysSoOfWeightsWhoseLossExplodedAndStopsWhereItStaysThere) {
  LossWatch watch("run.toml");
  double first = 0.5;  // of a part of the run before
  for (int step = 0; step < 5; ++step) watch.see(40, 0.1, 1, step, first);
  EXPECT_EQ(watch.complaint(), "");
  watch.see(60, 0.1, 1, 5, first);
  EXPECT_THAT(watch.complaint(), HasSubstr("exploded"));
  watch.see(60, 1, 1, 6, first);  // like its input, which is a hundredth
  EXPECT_EQ(watch.complaint(), "");
  const auto stay = [&] {
    for (int step = 7; step < 107; ++step) watch.see(1e6, 1, 1, step, first);
  };
  try {
    stay();
    ADD_FAILURE() << "went on";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("1e+06 at step 106"));
    EXPECT_THAT(error.what(), HasSubstr("into another folder or with force true"));
  }
  EXPECT_EQ(first, 0.5);
}

}  // namespace
}  // namespace malus
