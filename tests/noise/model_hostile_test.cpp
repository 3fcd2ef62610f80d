// Files made by other programs, most of them to mislead: fuzz/corpus/model holds them, and the name
// says what load_model has to do.
#include "malus/base/error.h"
#include "malus/noise/model.h"

#include "support.h"

namespace malus {
namespace {

TEST(HostileModelFiles, AreRefusedAndGoodOnesRead) {
  int good = 0, bad = 0;
  const std::filesystem::path folder =
      std::filesystem::path(MALUS_SOURCE_DIR) / "fuzz" / "corpus" / "model";
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("good_")) {
      EXPECT_EQ(contradiction_in(load_model(entry.path())), "") << name;
      ++good;
    } else if (name.starts_with("bad_")) {
      try {
        (void)load_model(entry.path());
        ADD_FAILURE() << name << " was read";
      } catch (const InputError& error) {
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << name;
        EXPECT_EQ(error.subject(), entry.path().string()) << name;
        RecordProperty(name, error.problem());
      }
      ++bad;
    }
  }
  EXPECT_GE(good, 3);
  EXPECT_GE(bad, 20);
}

}  // namespace
}  // namespace malus
