#include "pattern_sessions.h"

namespace malus {
namespace {

// Of 200 sessions each, the error over its standard error has a mean square of 1 ± 0.1: below 0.65
// or above 1.35 once in 2000 sets.
TEST(FixedPattern, DsnuAndBiasAreWithinTheirStandardErrorsOverManySessions) {
  testing::expect_stated_errors_of_patterns(200, 0.65, 1.35);
}

}  // namespace
}  // namespace malus
