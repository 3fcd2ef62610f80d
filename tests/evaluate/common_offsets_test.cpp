// Two sets of frames of one camera: what their rows and levels make of the distance of their noise.
#include "malus/evaluate/internal/common_offsets.h"

#include "malus/base/random.h"
#include "malus/evaluate/divergence.h"

#include <cmath>
#include <numbers>
#include <optional>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr int kCameraRows = 64, kCameraCols = 32;

struct OffsetCamera {
  double row_dn = 0;    ///< in groups of two
  double decay = 0;     ///< of the rows, from group to group
  double drift_dn = 0;  ///< of the frames
  double shade_dn = 0;  ///< from the first row to the last, in all frames
  double fall_dn = 0;   ///< of the clean picture from column to column
};

// Pixel noise of 1 DN, rounded.
NoiseFrames camera_frames(const OffsetCamera& camera, int count, std::uint64_t seed) {
  return {count, [=](int k) {
            RandomSequence random(seed, static_cast<std::uint32_t>(k), Draw::kPixel);
            Image frame(kCameraRows, kCameraCols);
            const double level = camera.drift_dn * random.normal();
            double row = camera.row_dn * random.normal();
            for (int r = 0; r < kCameraRows; ++r) {
              if (r % 2 == 0)
                row = camera.decay * row +
                      camera.row_dn * std::sqrt(1 - camera.decay * camera.decay) * random.normal();
              for (int c = 0; c < kCameraCols; ++c)
                frame(r, c) =
                    static_cast<float>(std::round(level + row + camera.shade_dn * r / kCameraRows +
                                                  camera.fall_dn * c + random.normal()));
            }
            return frame;
          }};
}

// The floor is the mean of what halves of one camera differ by. Where rows or a drift are most of
// it, the square is a χ² of one: of 30 sessions its mean is known to 0.26; level about 1e-4. It had
// been a hundredth of that for the strongest.
TEST(CommonOffsets, HalvesOfOneCameraLieAtTheFloor) {
  constexpr int kSessions = 30;
  std::uint64_t seed = 0;
  for (const OffsetCamera& camera : {OffsetCamera{},
                                     {.row_dn = 0.25},
                                     {.row_dn = 0.5},
                                     {.row_dn = 0.5, .decay = 0.8},
                                     {.row_dn = 0.1, .drift_dn = 0.2},
                                     {.row_dn = 0.5, .shade_dn = 2}})
    for (const int frames : {1, 8}) {
      if (frames == 1 && camera.drift_dn + camera.decay > 0) continue;  // one frame tells none
      double squares = 0;
      int beyond = 0;
      for (int i = 0; i < kSessions; ++i) {
        const NoiseFrames a = camera_frames(camera, frames, ++seed),
                          b = camera_frames(camera, frames, ++seed);
        const NoiseDistance d = compare_noise(a, b, std::nullopt, SensorLayout(), {}).pooled;
        squares += d.jsd_bits / (d.sqrt_jsd_floor * d.sqrt_jsd_floor) / kSessions;
        beyond += d.sqrt_jsd > 2 * d.sqrt_jsd_floor;
      }
      EXPECT_NEAR(squares, 1, 0.85)
          << camera.row_dn << ' ' << camera.decay << ' ' << camera.drift_dn << ' ' << frames;
      EXPECT_LE(beyond, kSessions / 5);
    }
}

// Frames less their own mean have no level of their own. The rows' spread is still of few rows.
TEST(CommonOffsets, FramesWithoutTheirMeanLieAtTheFloor) {
  NoiseComparisonSettings settings;
  settings.remove_fixed_pattern = true;
  double squares = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const OffsetCamera camera{.row_dn = 0.7, .drift_dn = 0.3};
    const NoiseDistance d = compare_noise(camera_frames(camera, 8, 2 * seed + 1),
                                          camera_frames(camera, 8, 2 * seed + 2), std::nullopt,
                                          SensorLayout(), settings)
                                .pooled;
    squares += d.jsd_bits / (d.sqrt_jsd_floor * d.sqrt_jsd_floor) / 10;
  }
  EXPECT_LT(squares, 2.5);  // strong rows: third order counts, too
  EXPECT_GT(squares, 0.4);
}

// Noise of independent pixels has the floor that its numbers make, of all levels and of each.
TEST(CommonOffsets, OfIndependentPixelsAreNone) {
  Image clean(kCameraRows, kCameraCols);
  for (int r = 0; r < kCameraRows; ++r)
    for (int c = 0; c < kCameraCols; ++c) clean(r, c) = 10.0F * static_cast<float>(c);
  const OffsetCamera camera{.fall_dn = 10};
  const NoiseComparison result =
      compare_noise(camera_frames(camera, 8, 1), camera_frames(camera, 8, 2), clean, SensorLayout(),
                    {.levels = 4});
  const auto plain = [](const NoiseDistance& d, int bins) {
    return std::sqrt((bins - 1) / (8 * std::numbers::ln2) *
                     (1.0 / static_cast<double>(d.reference_samples) +
                      1.0 / static_cast<double>(d.test_samples)));
  };
  ASSERT_EQ(result.levels.size(), 4);
  EXPECT_NEAR(result.pooled.sqrt_jsd_floor, plain(result.pooled, 10),
              0.15 * plain(result.pooled, 10));
  for (const NoiseDistance& level : result.levels)
    EXPECT_NEAR(level.sqrt_jsd_floor, plain(level, 9), 0.25 * plain(level, 9));
}

}  // namespace
}  // namespace malus
