#include "pattern_sessions.h"

namespace malus {
namespace {

// Of 100 sessions each, the error over its standard error has a mean square of 1 ± 0.14: below 0.55
// or above 1.55 once in 2000 sets.
TEST(FixedPattern, DsnuAndBiasAreWithinTheirStandardErrorsOverManySessions) {
  testing::expect_stated_errors_of_patterns(100, 0.55, 1.55);
}

}  // namespace
}  // namespace malus
