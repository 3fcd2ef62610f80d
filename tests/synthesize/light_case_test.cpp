#include "malus/synthesize/light_case.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(LightCase, IsGainAndRatio) {
  const auto light = parsed_light_case("-3.5:60");
  ASSERT_TRUE(light);
  EXPECT_EQ(light->gain, -3.5);
  EXPECT_EQ(light->ratio, 60);
}

TEST(LightCase, RefusesWhatIsNoPairOfNumbers) {
  for (const char* text : {"", "12", "12:", ":60", "12:60x", "12 :60", "twelve:60", "12:0", "12:-2",
                           "nan:10", "12:inf", "12:60:1"})
    EXPECT_FALSE(parsed_light_case(text)) << text;
}

}  // namespace
}  // namespace malus
