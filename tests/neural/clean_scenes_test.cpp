// Truth: the pixels of the scene that the pieces are cut from.
#include "malus/neural/internal/clean_scenes.h"

#include <future>
#include <set>
#include <vector>

#include "support.h"
#include "training_runs.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::AngleScene;
using testing::scene_config;
using testing::TemporaryFolder;

// Nothing but the scene's own values is in a piece that was cut out, and hardly any of them in one
// that was interpolated. Of 100 pieces 30 to 70 are cut out but for once in 20,000 times.
TEST(CleanScenes, EveryOtherPieceKeepsItsPixels) {
  const TemporaryFolder folder;
  const AngleScene scene(folder);
  TrainingConfig config = scene_config(scene);
  config.data.zoom = 1.5;
  config.data.symmetries = false;
  const auto whole = load_angle_scene(scene.path);
  const std::set<float> own(whole[1].s0.values().begin(), whole[1].s0.values().end());
  const CleanScenes scenes(config);
  int kept = 0;
  for (std::uint32_t number = 0; number < 100; ++number) {
    const auto piece = scenes.draw(5, number);
    bool all = true;
    for (const float v : piece[1].s0.values()) all = all && own.contains(v);
    kept += all ? 1 : 0;
  }
  EXPECT_GE(kept, 30);
  EXPECT_LE(kept, 70);
}

TEST(CleanScenes, AreTheSameFromAnyThreadAndWhateverIsKept) {
  const TemporaryFolder folder, wide_folder, high_folder;
  const AngleScene scene(folder), wide(wide_folder, 48, 90), high(high_folder, 80, 64);
  TrainingConfig config = scene_config(scene);
  config.scenes = {scene.path, wide.path, high.path, folder / "link"};
  std::filesystem::create_directory_symlink(wide.path, folder / "link");
  const CleanScenes plenty(config);
  config.data.memory_mib = 1e-3;  // of one scene at most
  const CleanScenes little(config);
  constexpr std::uint32_t kPieces = 40;
  std::vector<std::future<std::vector<StokesPlanes>>> drawn;
  for (std::uint32_t number = 0; number < kPieces; ++number)
    drawn.push_back(std::async(std::launch::async, [&, number] { return little.draw(7, number); }));
  for (std::uint32_t number = 0; number < kPieces; ++number) {
    const auto expected = plenty.draw(7, number), found = drawn[number].get();
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t k = 0; k < found.size(); ++k) {
      EXPECT_EQ(found[k].s0, expected[k].s0) << number;
      EXPECT_EQ(found[k].s2, expected[k].s2) << number;
    }
  }
}

}  // namespace
}  // namespace malus
