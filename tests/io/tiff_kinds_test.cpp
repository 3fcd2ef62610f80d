// What other programs' TIFF files hold: libtiff writes them here by itself.
#include "malus/base/error.h"
#include "malus/io/picture_file.h"

#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

#include "support.h"
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <tiffio.h>

namespace malus {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

struct Close {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};

// 21 x 37 samples of several channels, which differ everywhere.
struct TiffKind {
  std::uint16_t channels = 1, bits = 16, format = SAMPLEFORMAT_UINT, planar = PLANARCONFIG_CONTIG,
                compression = COMPRESSION_NONE, extra = EXTRASAMPLE_UNSPECIFIED;
  std::uint32_t tile = 0;
  int photometric = -1;  // else of the channels
  const char* mode = "w";
  static constexpr int kRows = 21, kCols = 37;

  int sample(int r, int c, int channel) const {
    return (r * 41 + c * 7 + channel * 13) % (bits == 8 ? 251 : 60013);
  }
  std::string text() const {
    return fmt::format("{} channels of {} bits, format {}, planar {}, compression {}, tile {}, {}",
                       channels, bits, format, planar, compression, tile, mode);
  }
  void append(std::vector<std::uint8_t>& bytes, int value) const {
    const auto put = [&](auto stored) {
      const auto* const first = reinterpret_cast<const std::uint8_t*>(&stored);
      bytes.insert(bytes.end(), first, first + sizeof stored);
    };
    if (format == SAMPLEFORMAT_IEEEFP && bits == 64) return put(static_cast<double>(value));
    if (format == SAMPLEFORMAT_IEEEFP) return put(static_cast<float>(value));
    if (bits == 8) return put(static_cast<std::uint8_t>(value));
    put(static_cast<std::uint16_t>(value));
  }
  // Rows and columns from there on, beyond the picture 0.
  std::vector<std::uint8_t> block(int row0, int col0, int rows, int cols, int sheet) const {
    std::vector<std::uint8_t> bytes;
    for (int r = row0; r < row0 + rows; ++r)
      for (int c = col0; c < col0 + cols; ++c)
        for (int k = 0; k < channels; ++k)
          if (planar == PLANARCONFIG_CONTIG || k == sheet)
            append(bytes, r < kRows && c < kCols ? sample(r, c, k) : 0);
    return bytes;
  }
  void write(const std::filesystem::path& path) const {
    const std::unique_ptr<TIFF, Close> tiff(TIFFOpen(path.c_str(), mode));
    TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, kCols);
    TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, kRows);
    TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, bits);
    TIFFSetField(tiff.get(), TIFFTAG_SAMPLEFORMAT, format);
    TIFFSetField(tiff.get(), TIFFTAG_SAMPLESPERPIXEL, channels);
    TIFFSetField(tiff.get(), TIFFTAG_PLANARCONFIG, planar);
    TIFFSetField(tiff.get(), TIFFTAG_COMPRESSION, compression);
    const int colours = channels == 3 || extra != EXTRASAMPLE_UNSPECIFIED ? 3 : 1;
    TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC,
                 photometric >= 0 ? photometric
                 : colours == 3   ? PHOTOMETRIC_RGB
                                  : PHOTOMETRIC_MINISBLACK);
    const std::vector<std::uint16_t> extras(static_cast<std::size_t>(channels - colours), extra);
    if (!extras.empty())
      TIFFSetField(tiff.get(), TIFFTAG_EXTRASAMPLES, static_cast<int>(extras.size()),
                   extras.data());
    const int sheets = planar == PLANARCONFIG_SEPARATE ? channels : 1;
    if (tile > 0) return write_tiles(tiff.get(), sheets);
    TIFFSetField(tiff.get(), TIFFTAG_ROWSPERSTRIP, 4);
    for (int sheet = 0; sheet < sheets; ++sheet)
      for (int r = 0; r < kRows; ++r) {
        std::vector<std::uint8_t> row = block(r, 0, 1, kCols, sheet);
        TIFFWriteScanline(tiff.get(), row.data(), static_cast<std::uint32_t>(r),
                          static_cast<std::uint16_t>(sheet));
      }
  }
  void write_tiles(TIFF* tiff, int sheets) const {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, tile);
    const auto side = static_cast<int>(tile);
    for (int sheet = 0; sheet < sheets; ++sheet)
      for (int row0 = 0; row0 < kRows; row0 += side)
        for (int col0 = 0; col0 < kCols; col0 += side) {
          std::vector<std::uint8_t> bytes = block(row0, col0, side, side, sheet);
          TIFFWriteTile(tiff, bytes.data(), static_cast<std::uint32_t>(col0),
                        static_cast<std::uint32_t>(row0), 0, static_cast<std::uint16_t>(sheet));
        }
  }
};

std::vector<TiffKind> tiff_kinds() {
  std::vector<TiffKind> kinds;
  constexpr std::uint16_t kSheets[] = {PLANARCONFIG_CONTIG, PLANARCONFIG_SEPARATE};
  for (const std::uint16_t channels : {std::uint16_t{1}, std::uint16_t{3}, std::uint16_t{16}})
    for (const std::uint16_t planar : kSheets)
      for (const std::uint32_t tile : {0, 16})
        for (const char* mode : {"wl", "wb", "w8"})
          kinds.push_back({.channels = channels, .planar = planar, .tile = tile, .mode = mode});
  for (const std::uint16_t bits : {std::uint16_t{32}, std::uint16_t{64}})
    for (const char* mode : {"wl", "wb"})
      kinds.push_back({.channels = 4, .bits = bits, .format = SAMPLEFORMAT_IEEEFP, .mode = mode});
  for (const std::uint16_t compression :
       {std::uint16_t{COMPRESSION_LZW}, std::uint16_t{COMPRESSION_PACKBITS},
        std::uint16_t{COMPRESSION_ZSTD}, std::uint16_t{COMPRESSION_LZMA}})
    kinds.push_back({.channels = 3, .bits = 8, .compression = compression});
  kinds.push_back({.bits = 16, .format = SAMPLEFORMAT_VOID});
  return kinds;
}

TEST(TiffKinds, EverySampleArrivesAsStored) {
  const testing::TemporaryFolder folder;
  for (const TiffKind& kind : tiff_kinds()) {
    kind.write(folder / "a.tif");
    const Picture picture = load_picture(folder / "a.tif");
    ASSERT_EQ(picture.planes.channels(), kind.channels) << kind.text();
    EXPECT_EQ(picture.bits, kind.format == SAMPLEFORMAT_IEEEFP ? 0 : kind.bits) << kind.text();
    int wrong = 0;
    for (int k = 0; k < kind.channels; ++k)
      for (int r = 0; r < kind.kRows; ++r)
        for (int c = 0; c < kind.kCols; ++c)
          wrong += picture.planes[k](r, c) != static_cast<float>(kind.sample(r, c, k));
    EXPECT_EQ(wrong, 0) << kind.text();
  }
}

// Inks and negatives would come as light.
TEST(TiffKinds, WhatIsNoLightIsRefusedByItsName) {
  const testing::TemporaryFolder folder;
  const std::pair<TiffKind, const char*> kinds[] = {
      {{.channels = 4, .photometric = PHOTOMETRIC_SEPARATED}, "inks"},
      {{.channels = 3, .photometric = PHOTOMETRIC_CIELAB}, "L*a*b*"},
      {{.photometric = PHOTOMETRIC_MINISWHITE}, "a negative"},
      {{.photometric = 12345}, "unknown photometric"}};
  for (const auto& [kind, what] : kinds) {
    kind.write(folder / "a.tif");
    EXPECT_THAT([&] { load_picture(folder / "a.tif"); },
                ThrowsMessage<InputError>(HasSubstr(what)));
  }
  TiffKind{.photometric = PHOTOMETRIC_CFA}.write(folder / "a.tif");
  EXPECT_EQ(load_picture(folder / "a.tif").planes.channels(), 1);
}

// 1.5, -0.25, the largest and the smallest half, in either byte order.
TEST(TiffKinds, HalvesAreFloats) {
  const testing::TemporaryFolder folder;
  for (const char* mode : {"wl", "wb"}) {
    {
      const std::unique_ptr<TIFF, Close> tiff(TIFFOpen((folder / "a.tif").c_str(), mode));
      TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, 4);
      TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, 1);
      TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, 16);
      TIFFSetField(tiff.get(), TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
      TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
      std::uint16_t halves[] = {0x3e00, 0xb400, 0x7bff, 0x0001};
      TIFFWriteScanline(tiff.get(), halves, 0, 0);
    }
    EXPECT_THAT(load_picture(folder / "a.tif").planes[0].values(),
                ElementsAre(1.5f, -0.25f, 65504.0f, 5.9604645e-8f))
        << mode;
  }
}

// Four planes are no colours with alpha unless the file says so.
TEST(TiffKinds, AlphaIsWhatTheFileCallsSo) {
  const testing::TemporaryFolder folder;
  TiffKind{.channels = 4}.write(folder / "planes.tif");
  EXPECT_THAT(load_picture(folder / "planes.tif").names, ElementsAre("C00", "C01", "C02", "C03"));
  TiffKind{.channels = 4, .extra = EXTRASAMPLE_UNASSALPHA}.write(folder / "alpha.tif");
  EXPECT_THAT(load_picture(folder / "alpha.tif").names, ElementsAre("R", "G", "B", "A"));
}

TEST(TiffKinds, PalettesComeAsTheirColours) {
  const testing::TemporaryFolder folder;
  {
    const std::unique_ptr<TIFF, Close> tiff(TIFFOpen((folder / "a.tif").c_str(), "w"));
    TIFFSetField(tiff.get(), TIFFTAG_IMAGEWIDTH, 2);
    TIFFSetField(tiff.get(), TIFFTAG_IMAGELENGTH, 1);
    TIFFSetField(tiff.get(), TIFFTAG_BITSPERSAMPLE, 8);
    TIFFSetField(tiff.get(), TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_PALETTE);
    std::vector<std::uint16_t> red(256), green(256), blue(256);
    red[7] = 200 * 257, green[7] = 100 * 257, blue[7] = 50 * 257;
    red[9] = 1 * 257, green[9] = 2 * 257, blue[9] = 3 * 257;
    TIFFSetField(tiff.get(), TIFFTAG_COLORMAP, red.data(), green.data(), blue.data());
    std::uint8_t numbers[] = {7, 9};
    TIFFWriteScanline(tiff.get(), numbers, 0, 0);
  }
  const Picture picture = load_picture(folder / "a.tif");
  ASSERT_EQ(picture.planes.channels(), 3);
  EXPECT_THAT(picture.planes[0].values(), ElementsAre(200, 1));
  EXPECT_THAT(picture.planes[1].values(), ElementsAre(100, 2));
  EXPECT_THAT(picture.planes[2].values(), ElementsAre(50, 3));
  EXPECT_EQ(picture.bits, 8);
}

TEST(TiffKinds, DamagedPixelsAreRefusedWhereTheCompressionTells) {
  const testing::TemporaryFolder folder;
  for (const std::uint16_t compression :
       {std::uint16_t{COMPRESSION_LZW}, std::uint16_t{COMPRESSION_ZSTD}})
    for (const std::uint32_t tile : {0, 16}) {
      TiffKind{.compression = compression, .tile = tile}.write(folder / "a.tif");
      // The strips or tiles come first here, their directory last: the beginning of one is
      // overwritten.
      std::FILE* file = std::fopen((folder / "a.tif").c_str(), "r+b");
      std::fseek(file, 8, SEEK_SET);
      const std::vector<char> nothing(24, '\xff');
      std::fwrite(nothing.data(), 1, nothing.size(), file);
      std::fclose(file);
      EXPECT_THAT([&] { load_picture(folder / "a.tif"); },
                  ThrowsMessage<InputError>(HasSubstr("cannot be decoded")))
          << compression << " " << tile;
    }
}

}  // namespace
}  // namespace malus
