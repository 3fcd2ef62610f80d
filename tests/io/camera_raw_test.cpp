#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/frame_file.h"

#include <cmath>

#include "support.h"
#include "tiff_directory.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using testing::TiffDirectory;

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr int kRows = 50, kCols = 66, kTop = 4, kLeft = 2;

// A DNG 1.4 whose visible area starts at (top, left) and reads R G / G B from there.
std::string dng(std::uint32_t top = kTop, std::uint32_t left = kLeft,
                const std::vector<double>& black = {60, 61, 62, 63}) {
  std::vector<std::int32_t> hundredths;
  for (const double level : black)
    hundredths.insert(hundredths.end(), {static_cast<std::int32_t>(std::lround(100 * level)), 100});
  const auto build = [&](std::uint32_t exif_at, std::uint32_t pixels_at) {
    TiffDirectory d;
    d.longs(254, {0});
    d.longs(256, {kCols});
    d.longs(257, {kRows});
    d.shorts(258, {16});
    d.shorts(259, {1});
    d.shorts(262, {32803});
    d.text(271, "Maker");
    d.text(272, "Model 1");
    d.longs(273, {pixels_at});
    d.shorts(274, {1});
    d.shorts(277, {1});
    d.longs(278, {kRows});
    d.longs(279, {2 * kRows * kCols});
    d.shorts(33421, {2, 2});
    d.bytes(33422, {0, 1, 1, 2});
    d.longs(34665, {exif_at});
    d.bytes(50706, {1, 4, 0, 0});
    d.text(50708, "Maker Model 1");
    d.bytes(50710, {0, 1, 2});
    d.shorts(50711, {1});
    d.shorts(50713, {2, 2});
    d.rationals(50714, 5, hundredths);
    d.longs(50717, {4000});
    d.rationals(50721, 10, {1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1});
    d.rationals(50728, 5, {1, 1, 1, 1, 1, 1});
    d.longs(50829, {top, left, kRows - 2, kCols - 2});
    return d;
  };
  TiffDirectory exif;
  exif.rationals(33434, 5, {1, 50});
  exif.shorts(34855, {1600});
  const std::size_t exif_at = 8 + build(0, 0).size(), pixels_at = exif_at + exif.size();
  std::string file("II*\0\x08\0\0\0", 8);
  file +=
      build(static_cast<std::uint32_t>(exif_at), static_cast<std::uint32_t>(pixels_at)).write(8);
  file += exif.write(exif_at);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) {
      const int value = 100 + 40 * r + c;
      file += static_cast<char>(value & 0xff);
      file += static_cast<char>(value >> 8);
    }
  return file;
}

TEST(CameraRaw, VisibleAreaLevelsAndFacts) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.dng", dng(), false);
  const FrameInfo info = load_frame_info(folder / "a.dng");
  const RawFrame& frame = info.frame;
  EXPECT_EQ(info.format, "camera raw");
  EXPECT_EQ(info.camera, "Maker Model 1");
  ASSERT_EQ(frame.dn.rows(), kRows - 2 - kTop);
  ASSERT_EQ(frame.dn.cols(), kCols - 2 - kLeft);
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c)
      ASSERT_EQ(frame.dn(r, c), static_cast<float>(100 + 40 * (r + kTop) + c + kLeft));
  // DNG 1.4: the CFA pattern and the black levels both count from the visible corner.
  EXPECT_EQ(frame.layout.name(), "bayer-rggb");
  EXPECT_TRUE(frame.layout_known && frame.black_known && frame.white_known);
  EXPECT_THAT(frame.black_dn, ElementsAre(60, 61, 62, 63));
  EXPECT_EQ(frame.white_dn, 4000);
  EXPECT_EQ(frame.bits, 12);
  EXPECT_EQ(frame.gain.iso, 1600);
  EXPECT_NEAR(frame.exposure_s.value(), 0.02, 1e-9);
}

TEST(CameraRaw, LayoutAndBlackFollowAnOddVisibleArea) {
  const testing::TemporaryFolder folder;
  const std::string colors[2][2] = {{"R", "G"}, {"G", "B"}};
  for (const std::uint32_t top : {3u, 4u})
    for (const std::uint32_t left : {1u, 2u}) {
      write_file(folder / "a.dng", dng(top, left), true);
      const RawFrame frame = load_frame(folder / "a.dng");
      // The pixel tells where it came from, wherever LibRaw starts.
      const int position = static_cast<int>(frame.dn(0, 0)) - 100;
      const auto row = static_cast<std::uint32_t>(position / 40);
      const auto col = static_cast<std::uint32_t>(position % 40);
      ASSERT_GE(row, top);
      ASSERT_GE(col, left);
      EXPECT_EQ(frame.layout.channel_name(0).substr(0, 1),
                colors[(row - top) % 2][(col - left) % 2])
          << top << " " << left;
      EXPECT_EQ(frame.black_dn[0], 60 + 2 * ((row - top) % 2) + (col - left) % 2);
      EXPECT_EQ(frame.black_dn[3], 63 - frame.black_dn[0] + 60);
    }
}

TEST(CameraRaw, FractionsOfBlackAndDecimalsOfTheExposureAreKept) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.dng", dng(kTop, kLeft, {60.75, 61.1, 62, 63.5}), false);
  const RawFrame frame = load_frame(folder / "a.dng");
  EXPECT_THAT(frame.black_dn, ElementsAre(60.75, 61.1, 62, 63.5));
  EXPECT_EQ(frame.exposure_s, 0.02);
}

TEST(CameraRaw, ProbeTellsTheSame) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.dng", dng(), false);
  const FrameInfo probed = probe_frame(folder / "a.dng"),
                  loaded = load_frame_info(folder / "a.dng");
  EXPECT_TRUE(probed.frame.dn.empty());
  EXPECT_EQ(probed.rows, loaded.rows);
  EXPECT_EQ(probed.cols, loaded.cols);
  EXPECT_EQ(probed.frame.black_dn, loaded.frame.black_dn);
  EXPECT_EQ(probed.frame.white_dn, loaded.frame.white_dn);
}

TEST(CameraRaw, FlagsWinOverTheFile) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.dng", dng(), false);
  FrameOptions options;
  options.black_dn = {70};
  options.white_dn = 3000;
  options.gain.gain_db = 6;
  const RawFrame frame = load_frame(folder / "a.dng", options);
  EXPECT_THAT(frame.black_dn, ElementsAre(70, 70, 70, 70));
  EXPECT_EQ(frame.white_dn, 3000);
  EXPECT_EQ(frame.gain.text(), "6 dB");
}

TEST(CameraRaw, CutOffFilesAreRefused) {
  const testing::TemporaryFolder folder;
  const std::string whole = dng();
  for (const std::size_t length :
       {std::size_t{9}, std::size_t{100}, whole.size() / 2, whole.size() - 700}) {
    write_file(folder / "cut.dng", whole.substr(0, length), true);
    EXPECT_THROW(load_frame(folder / "cut.dng"), InputError) << length;
  }
}

TEST(CameraRaw, UndecodableCompressionIsSaid) {
  MALUS_NEEDS_SHARED("bayer-raw/s25u_linear_jxl.dng");
  EXPECT_THAT([] { load_frame(testing::shared_data() / "bayer-raw" / "s25u_linear_jxl.dng"); },
              ThrowsMessage<InputError>(HasSubstr("of a kind that LibRaw")));
}

}  // namespace
}  // namespace malus
