// Messages are made in the words of whoever calls.
#include "malus/base/wording.h"

#include <string>

#include <gtest/gtest.h>

namespace malus {
namespace {

std::string shouted(std::string_view name, const SettingValue& value) {
  return std::string(name) + "!" + std::to_string(value.index());
}
std::string named(std::string_view name) { return std::string("<").append(name) + ">"; }
constexpr Wording kShouting{shouted, named, named};

TEST(Wording, IsPlainUntilAnotherIsUsed) {
  EXPECT_EQ(setting("black"), "black");
  EXPECT_EQ(setting("black", 82.5), "black 82.5");
  EXPECT_EQ(setting("level_step", 1e6), "level_step 1e+06");
  const std::string kind = "physics";
  EXPECT_EQ(setting("kind", kind), "kind physics");
  EXPECT_EQ(setting("kind", "gaussian"), "kind gaussian");  // a text, no switch
  EXPECT_EQ(setting("shot", false), "shot false");
  EXPECT_EQ(setting_name("memory"), "memory");
  EXPECT_EQ(command("model list"), "`malus model list`");
}

TEST(Wording, IsTheCallersAfterwards) {
  use_wording(kShouting);
  EXPECT_EQ(setting("black"), "black!0");
  EXPECT_EQ(setting("shot", false), "shot!1");
  EXPECT_EQ(setting("black", 82.5), "black!2");
  EXPECT_EQ(setting("kind", "physics"), "kind!3");
  EXPECT_EQ(setting_name("memory"), "<memory>");
  EXPECT_EQ(command("model list"), "<model list>");
  use_wording(kPlainWording);
  EXPECT_EQ(setting("black", 82.5), "black 82.5");
}

}  // namespace
}  // namespace malus
