// What other programs' PNG files hold: libpng writes them here by itself.
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"

#include <cstdint>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "support.h"
#include <gmock/gmock.h>
#include <png.h>

namespace malus {
namespace {

using ::testing::ElementsAre;

// Rows of bytes as the format has them; `more` sets further chunks.
template <class More>
void write_rows(const std::filesystem::path& path, int cols, int bits, int colour_type,
                int interlace, std::vector<std::vector<std::uint8_t>> rows, More more) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_set_IHDR(png, info, static_cast<png_uint_32>(cols), static_cast<png_uint_32>(rows.size()),
               bits, colour_type, interlace, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  more(png, info);
  png_write_info(png, info);
  std::vector<png_bytep> pointers;
  for (auto& row : rows) pointers.push_back(row.data());
  png_write_image(png, pointers.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
}

constexpr auto kNothing = [](png_structp, png_infop) {};

TEST(PngKinds, FewBitsAreNotStretched) {
  const testing::TemporaryFolder folder;
  const auto stored = [&](int bits, std::uint8_t byte) {
    write_rows(folder / "a.png", 2, bits, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, {{byte}},
               kNothing);
    const Picture picture = load_picture(folder / "a.png");
    EXPECT_EQ(picture.bits, bits);
    return picture.planes[0].values();
  };
  EXPECT_THAT(stored(1, 0x40), ElementsAre(0, 1));
  EXPECT_THAT(stored(2, 0x90), ElementsAre(2, 1));
  EXPECT_THAT(stored(4, 0x7c), ElementsAre(7, 12));
}

TEST(PngKinds, SixteenBitsAndInterlacedRowsArriveAsStored) {
  const testing::TemporaryFolder folder;
  for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7}) {
    std::vector<std::vector<std::uint8_t>> rows;
    for (int r = 0; r < 11; ++r) {
      rows.emplace_back();
      for (int c = 0; c < 13; ++c) {
        rows.back().push_back(static_cast<std::uint8_t>(r * 20 + c));
        rows.back().push_back(static_cast<std::uint8_t>(c * 5));
      }
    }
    write_rows(folder / "a.png", 13, 16, PNG_COLOR_TYPE_GRAY, interlace, rows, kNothing);
    const RawFrame frame = load_frame(folder / "a.png");
    for (int r = 0; r < 11; ++r)
      for (int c = 0; c < 13; ++c)
        ASSERT_EQ(frame.dn(r, c), 256 * (r * 20 + c) + 5 * c) << interlace;
  }
}

TEST(PngKinds, PalettesComeAsTheirColoursWithTheirTransparency) {
  const testing::TemporaryFolder folder;
  const auto palette = [](png_structp png, png_infop info) {
    const png_color colours[] = {{1, 2, 3}, {200, 100, 50}};
    png_set_PLTE(png, info, colours, 2);
  };
  write_rows(folder / "a.png", 2, 1, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE, {{0x40}}, palette);
  const Picture picture = load_picture(folder / "a.png");
  ASSERT_EQ(picture.planes.channels(), 3);
  EXPECT_THAT(picture.planes[0].values(), ElementsAre(1, 200));
  EXPECT_THAT(picture.planes[2].values(), ElementsAre(3, 50));
  EXPECT_EQ(picture.bits, 8);
  write_rows(folder / "b.png", 2, 1, PNG_COLOR_TYPE_PALETTE, PNG_INTERLACE_NONE, {{0x40}},
             [&](png_structp png, png_infop info) {
               palette(png, info);
               const png_byte alpha[] = {0, 77};
               png_set_tRNS(png, info, alpha, 2, nullptr);
             });
  const Picture with_alpha = load_picture(folder / "b.png");
  ASSERT_EQ(with_alpha.planes.channels(), 4);
  EXPECT_THAT(with_alpha.planes[3].values(), ElementsAre(0, 77));
}

TEST(PngKinds, GreyWithAlphaHasTwoChannels) {
  const testing::TemporaryFolder folder;
  write_rows(folder / "a.png", 2, 8, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_INTERLACE_NONE, {{5, 6, 7, 8}},
             kNothing);
  const Picture picture = load_picture(folder / "a.png");
  EXPECT_THAT(picture.names, ElementsAre("Y", "A"));
  EXPECT_THAT(picture.planes[0].values(), ElementsAre(5, 7));
  EXPECT_THAT(picture.planes[1].values(), ElementsAre(6, 8));
}

// One grey value that stands for nothing, which a chunk names.
TEST(PngKinds, TransparentGreyHasAlpha) {
  const testing::TemporaryFolder folder;
  write_rows(folder / "a.png", 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, {{5, 6}},
             [](png_structp png, png_infop info) {
               png_color_16 transparent{};
               transparent.gray = 6;
               png_set_tRNS(png, info, nullptr, 0, &transparent);
             });
  const Picture picture = load_picture(folder / "a.png");
  ASSERT_EQ(picture.planes.channels(), 2);
  EXPECT_THAT(picture.planes[0].values(), ElementsAre(5, 6));
  EXPECT_THAT(picture.planes[1].values(), ElementsAre(255, 0));
}

// A TIFF structure: the camera in the first directory, 1/4 s and ISO 400 in the one of Exif.
std::string exif_of_camera() {
  std::string exif("MM\0\x2a\0\0\0\x08\0\x02", 10);
  exif += std::string("\x01\x10\0\x02\0\0\0\x05\0\0\0\x26", 12);
  exif += std::string("\x87\x69\0\x04\0\0\0\x01\0\0\0\x2c\0\0\0\0", 16);
  exif += std::string("IMX2\0\0", 6);
  exif += std::string("\0\x02\x82\x9a\0\x05\0\0\0\x01\0\0\0\x4a", 14);
  exif += std::string("\x88\x27\0\x03\0\0\0\x01\x01\x90\0\0\0\0\0\0", 16);
  return exif + std::string("\0\0\0\x01\0\0\0\x04", 8);
}

TEST(PngKinds, ExifTellsCameraExposureAndIso) {
  const testing::TemporaryFolder folder;
  std::string exif = exif_of_camera();
  write_rows(folder / "a.png", 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, {{5, 6}},
             [&](png_structp png, png_infop info) {
               png_set_eXIf_1(png, info, static_cast<png_uint_32>(exif.size()),
                              reinterpret_cast<png_bytep>(exif.data()));
             });
  const FrameInfo told = load_frame_info(folder / "a.png", {});
  EXPECT_EQ(told.camera, "IMX2");
  EXPECT_EQ(told.frame.exposure_s, 0.25);
  EXPECT_EQ(told.frame.gain.iso, 400);
  // Damaged, it tells nothing, and the pixels are read.
  exif[7] = '\x7f';
  write_rows(folder / "b.png", 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, {{5, 6}},
             [&](png_structp png, png_infop info) {
               png_set_eXIf_1(png, info, static_cast<png_uint_32>(exif.size()),
                              reinterpret_cast<png_bytep>(exif.data()));
             });
  EXPECT_THAT(load_frame_info(folder / "b.png", {}).frame.dn.values(), ElementsAre(5, 6));
}

// Its length may be anything there: 4 GB were read in vain.
TEST(PngKinds, WhatStandsBehindTheLastChunkIsNoExif) {
  const testing::TemporaryFolder folder;
  write_rows(folder / "a.png", 2, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, {{5, 6}}, kNothing);
  const std::string exif = exif_of_camera();
  std::ofstream(folder / "a.png", std::ios::binary | std::ios::app)
      << std::string(3, '\0') << static_cast<char>(exif.size()) << "eXIf" << exif << "none";
  const FrameInfo told = load_frame_info(folder / "a.png", {});
  EXPECT_EQ(told.camera, "");
  EXPECT_EQ(told.frame.exposure_s, std::nullopt);
  EXPECT_THAT(told.frame.dn.values(), ElementsAre(5, 6));
}

}  // namespace
}  // namespace malus
