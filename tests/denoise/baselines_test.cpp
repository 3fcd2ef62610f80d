// Truth: the same filter, run on pictures that the test puts together itself.
#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include "denoise/tiled_scene.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

Image denoised_by(const char* method, const RawFrame& frame) {
  return denoise_frame(frame, profile_of(camera_noise(frame.layout)),
                       {.method = method, .profile = "fast"})
      .dn_above_black;
}

RawFrame baseline_frame(const char* layout, int rows, int cols) {
  return drawn_frame(polarized_blobs(rows, cols), camera_noise(SensorLayout::named(layout)),
                     {.black_dn = 82}, 7);
}

// The 2x2 pixels of one colour of every cell of 4x4, put together.
RawFrame colour_picture(const RawFrame& frame, int row, int col) {
  RawFrame grey = frame;
  grey.layout = SensorLayout::named("mono");
  grey.black_dn.resize(1);
  grey.dn = Image(frame.dn.rows() / 2, frame.dn.cols() / 2);
  for (int r = 0; r < grey.dn.rows(); ++r)
    for (int c = 0; c < grey.dn.cols(); ++c)
      grey.dn(r, c) = frame.dn(r / 2 * 4 + row + r % 2, c / 2 * 4 + col + c % 2);
  return grey;
}

// Whoever works with the result knows them by their value: filtered, they lay below white.
TEST(Baselines, KeepSaturatedPixels) {
  RawFrame frame = baseline_frame("polar-mono", 48, 64);
  for (int r = 10; r < 14; ++r)
    for (int c = 20; c < 30; ++c) frame.dn(r, c) = static_cast<float>(frame.white_dn);
  const Image kept = denoised_by("nl-ridge", frame);
  for (const char* method : {"plane-bm3d", "paper-bm3d", "paper-mbm3d", "vst-bm3d"}) {
    const Image result = denoised_by(method, frame);
    for (int r = 10; r < 14; ++r)
      for (int c = 20; c < 30; ++c) {
        ASSERT_NEAR(result(r, c), frame.white_dn - 82, 2) << method;  // less black and bias
        ASSERT_EQ(result(r, c), kept(r, c)) << method;
      }
  }
}

// 000, 6.1: "BM3D, taking each color channel containing 4 polarization channels as a grayscale
// input".
TEST(Baselines, ThePapersBm3dTakesTheFourAnglesOfAColourAsOneGreyPicture) {
  for (const char* layout : {"polar-bayer-rggb", "polar-bayer-grbg"}) {
    const RawFrame frame = baseline_frame(layout, 96, 128);
    const Image whole = denoised_by("paper-bm3d", frame);
    for (const auto& [row, col] : {std::pair{0, 0}, {0, 2}, {2, 0}, {2, 2}}) {
      const Image grey = denoised_by("paper-bm3d", colour_picture(frame, row, col));
      for (int r = 0; r < grey.rows(); ++r)
        for (int c = 0; c < grey.cols(); ++c)
          ASSERT_EQ(whole(r / 2 * 4 + row + r % 2, c / 2 * 4 + col + c % 2), grey(r, c))
              << layout << " " << row << " " << col;
    }
    EXPECT_NE(whole.values(), denoised_by("plane-bm3d", frame).values());
  }
}

TEST(Baselines, ThePapersBm3dTakesAMonoPolarizationMosaicAsOneGreyPicture) {
  RawFrame frame = baseline_frame("polar-mono", 64, 80);
  const Image whole = denoised_by("paper-bm3d", frame);
  EXPECT_NE(whole.values(), denoised_by("plane-bm3d", frame).values());
  frame.layout = SensorLayout::named("mono");
  frame.black_dn.resize(1);
  EXPECT_EQ(whole.values(), denoised_by("paper-bm3d", frame).values());
}

// Pixels of one colour that have no polarizers, or of a cell that holds no four angles in a
// rectangle, have no companions.
TEST(Baselines, ThePapersBm3dTakesOtherPlanesAlone) {
  for (const char* layout : {"mono", "bayer-rggb"}) {
    const RawFrame frame = baseline_frame(layout, 61, 43);
    EXPECT_EQ(denoised_by("paper-bm3d", frame).values(), denoised_by("plane-bm3d", frame).values());
  }
  RawFrame row = baseline_frame("polar-mono", 40, 64);
  row.layout = SensorLayout::from_sites({{"0", "45", "90", "135"}});
  EXPECT_EQ(denoised_by("paper-bm3d", row).values(), denoised_by("plane-bm3d", row).values());
}

// Where the colours of one angle stand together, a colour's angles lie two pixels apart.
TEST(Baselines, ThePapersBm3dFindsTheAnglesOfAColourWhereverTheyStand) {
  RawFrame frame = baseline_frame("polar-bayer-rggb", 64, 64);
  const SensorLayout named = frame.layout;
  frame.layout = SensorLayout::from_sites({{"R90", "G1_90", "R45", "G1_45"},
                                           {"G2_90", "B90", "G2_45", "B45"},
                                           {"R135", "G1_135", "R0", "G1_0"},
                                           {"G2_135", "B135", "G2_0", "B0"}});
  const Image found = denoised_by("paper-bm3d", frame);
  RawFrame moved = frame;
  moved.layout = named;
  const auto place = [](int i) { return i / 4 * 4 + i % 2 * 2 + i / 2 % 2; };
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) moved.dn(place(r), place(c)) = frame.dn(r, c);
  const Image expected = denoised_by("paper-bm3d", moved);
  for (int r = 0; r < 64; ++r)
    for (int c = 0; c < 64; ++c) ASSERT_EQ(found(r, c), expected(place(r), place(c)));
}

}  // namespace
}  // namespace malus
