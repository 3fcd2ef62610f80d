#include "malus/base/settings_check.h"

#include <cmath>
#include <optional>

#include "problem_of.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;

struct AllKinds {
  bool flag = true;
  int count = 4;
  double share = 0.5;
  std::string word = "one", free = "any";
  std::vector<double> gains = {};
  std::optional<double> ratio = std::nullopt;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.flag, ParameterInfo{"flag", "", ""});
    field(self.count, ParameterInfo{"count", "1", "", 2, 8});
    field(self.share, ParameterInfo{"share", "1", "", 0, 1});
    field(self.word,
          ParameterInfo{.name = "word", .unit = "", .help = "", .choices = {"one", "two"}});
    field(self.free, ParameterInfo{"free", "", ""});
    field(self.gains, ParameterInfo{"gains", "1", "", 0.01, 100});
    field(self.ratio, ParameterInfo{"ratio", "1", "", 1e-6, 1e9});
  }
};

std::string said_of(const AllKinds& settings) {
  return problem_of([&] { require_settings(settings); });
}

TEST(RequireSettings, TakesWhatIsInRange) {
  EXPECT_NO_THROW(require_settings(AllKinds()));
  AllKinds ends{false, 2, 1, "two", "", {0.01, 100}, 1e9};
  EXPECT_NO_THROW(require_settings(ends));
}

TEST(RequireSettings, NamesWhatIsNot) {
  EXPECT_EQ(said_of({.count = 0}), "count: 0 is outside its range; give 2 to 8");
  EXPECT_EQ(said_of({.share = -1}), "share: -1 is outside its range; give 0 to 1");
  EXPECT_EQ(said_of({.share = std::nan("")}), "share: nan is outside its range; give 0 to 1");
  EXPECT_EQ(said_of({.word = "three"}), "word: three is not known; known: one, two");
  EXPECT_EQ(said_of({.word = "twoo"}),
            "word: twoo is not known; did you mean \"two\"? known: one, two");
  EXPECT_EQ(said_of({.gains = {1, 1e3}}), "gains: 1000 is outside its range; give 0.01 to 100");
  EXPECT_EQ(said_of({.ratio = 0}), "ratio: 0 is outside its range; give 1e-06 to 1e+09");
}

}  // namespace
}  // namespace malus
