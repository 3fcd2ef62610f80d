#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/frame_file.h"

#include "deflated.h"
#include "support.h"
#include "tiff_directory.h"
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace malus {
namespace {

using testing::deflated;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;
using testing::TiffDirectory;

constexpr std::uint16_t kWhiteIsZero = 0, kBlackIsZero = 1;

// One uncompressed grey picture of one strip.
std::string tiff(std::uint32_t rows, std::uint32_t cols, std::uint16_t bits,
                 std::uint16_t sample_format, const std::string& pixels,
                 std::uint16_t photometric = kBlackIsZero) {
  const auto build = [&](std::uint32_t pixels_at) {
    TiffDirectory d;
    d.longs(256, {cols});
    d.longs(257, {rows});
    d.shorts(258, {bits});
    d.shorts(259, {1});
    d.shorts(262, {photometric});
    d.longs(273, {pixels_at});
    d.shorts(277, {1});
    d.longs(278, {rows});
    d.longs(279, {static_cast<std::uint32_t>(pixels.size())});
    d.shorts(339, {sample_format});
    return d;
  };
  const auto pixels_at = static_cast<std::uint32_t>(8 + build(0).size());
  return std::string("II*\0\x08\0\0\0", 8) + build(pixels_at).write(8) + pixels;
}

// TIFF packs from the highest bit, each row from a new byte.
TEST(Tiff, PackedTwelveAndTenBitsAreNotStretched) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.tif",
             tiff(2, 3, 12, 1,
                  {'\x12', '\x3a', '\xbc', '\xff', '\xf0', '\x00', '\x10', '\x02', '\x80', '\x00'}),
             false);
  const RawFrame twelve = load_frame(folder / "a.tif");
  EXPECT_THAT(twelve.dn.values(), ElementsAre(0x123, 0xabc, 0xfff, 0x001, 0x002, 0x800));
  EXPECT_EQ(twelve.bits, 12);
  EXPECT_EQ(twelve.white_dn, 4095);
  // 0x001, 0x2aa, 0x155, 0x3ff
  write_file(folder / "b.tif", tiff(1, 4, 10, 1, {'\x00', '\x6a', '\xa5', '\x57', '\xff'}), false);
  const RawFrame ten = load_frame(folder / "b.tif");
  EXPECT_THAT(ten.dn.values(), ElementsAre(0x001, 0x2aa, 0x155, 0x3ff));
  EXPECT_EQ(ten.bits, 10);
}

TEST(Tiff, PixelsAreAsStoredWhereWhiteIsZeroToo) {
  const testing::TemporaryFolder folder;
  const auto stored = [&](std::uint16_t bits, const std::string& pixels) {
    const auto path = folder / fmt::format("{}.tif", bits);
    write_file(path, tiff(1, 4, bits, 1, pixels, kWhiteIsZero), false);
    return load_frame(path).dn.values();
  };
  EXPECT_THAT(stored(1, "\x50"), ElementsAre(0, 1, 0, 1));
  EXPECT_THAT(stored(4, "\x12\xef"), ElementsAre(1, 2, 14, 15));
  EXPECT_THAT(stored(8, "\x01\x02\x80\xff"), ElementsAre(1, 2, 128, 255));
  EXPECT_THAT(stored(12, "\x12\x3a\xbc\xff\xf8\x01"), ElementsAre(0x123, 0xabc, 0xfff, 0x801));
  EXPECT_THAT(stored(16, std::string("\x01\x00\x02\x00\x00\x80\xff\xff", 8)),
              ElementsAre(1, 2, 0x8000, 0xffff));
}

TEST(Tiff, SignedAndWideSamplesAreRefusedNotReinterpreted) {
  const testing::TemporaryFolder folder;
  write_file(folder / "signed.tif", tiff(1, 2, 16, 2, {1, 0, '\xff', '\xff'}), false);
  EXPECT_THAT([&] { load_frame(folder / "signed.tif"); },
              ThrowsMessage<InputError>(HasSubstr("int16")));
  write_file(folder / "wide.tif", tiff(1, 1, 32, 1, {1, 0, 0, 0}), false);
  EXPECT_THAT([&] { load_frame(folder / "wide.tif"); },
              ThrowsMessage<InputError>(HasSubstr("samples of type uint")));
}

// One channel of 16 bits in strips or tiles of Deflate.
struct DeflatedTiff {
  std::uint32_t rows = 10, cols = 64, block_rows = 4, tile_cols = 0;
  std::uint16_t predictor = 1, compression = 8;
  bool pad_last = false;
  std::vector<std::string> blocks = {};

  static std::uint16_t value(std::uint32_t r, std::uint32_t c) {
    return static_cast<std::uint16_t>(900 + 37 * r * c % 101);
  }
  void fill() {
    const std::uint32_t block_cols = tile_cols > 0 ? tile_cols : cols;
    for (std::uint32_t row0 = 0; row0 < rows; row0 += block_rows)
      for (std::uint32_t col0 = 0; col0 < cols; col0 += block_cols) {
        const bool whole = pad_last || tile_cols > 0;
        const std::uint32_t row1 = whole ? row0 + block_rows : std::min(rows, row0 + block_rows);
        std::string bytes;
        for (std::uint32_t r = row0; r < row1; ++r)
          for (std::uint32_t c = col0; c < col0 + block_cols; ++c) {
            const int before = predictor == 2 && c > col0 ? value(r, c - 1) : 0;
            const auto stored = static_cast<std::uint16_t>(value(r, c) - before);
            bytes += {static_cast<char>(stored & 0xff), static_cast<char>(stored >> 8)};
          }
        blocks.push_back(deflated(bytes));
      }
  }
  std::string file() const {
    std::vector<std::uint32_t> places, sizes;
    const auto build = [&] {
      TiffDirectory d;
      d.longs(256, {cols});
      d.longs(257, {rows});
      d.shorts(258, {16});
      d.shorts(259, {compression});
      d.shorts(262, {kBlackIsZero});
      if (tile_cols == 0) d.longs(273, places);
      d.shorts(277, {1});
      if (tile_cols == 0) d.longs(278, {block_rows});
      if (tile_cols == 0) d.longs(279, sizes);
      d.shorts(317, {predictor});
      if (tile_cols > 0) {
        d.longs(322, {tile_cols});
        d.longs(323, {block_rows});
        d.longs(324, places);
        d.longs(325, sizes);
      }
      return d;
    };
    std::string pixels;
    places.assign(blocks.size(), 0);
    for (const std::string& block : blocks)
      sizes.push_back(static_cast<std::uint32_t>(block.size()));
    const std::size_t at = 8 + build().size();
    for (std::size_t i = 0; i < blocks.size(); ++i) {
      places[i] = static_cast<std::uint32_t>(at + pixels.size());
      pixels += blocks[i];
    }
    return std::string("II*\0\x08\0\0\0", 8) + build().write(8) + pixels;
  }
};

std::vector<DeflatedTiff> deflated_pictures() {
  std::vector<DeflatedTiff> all;
  for (const std::uint16_t predictor : std::initializer_list<std::uint16_t>{1, 2})
    for (const std::uint16_t compression : std::initializer_list<std::uint16_t>{8, 32946}) {
      for (const std::uint32_t block_rows : {1, 4, 10})
        for (const bool pad : {false, true})
          all.push_back({.block_rows = block_rows,
                         .predictor = predictor,
                         .compression = compression,
                         .pad_last = pad});
      all.push_back(
          {.block_rows = 16, .tile_cols = 48, .predictor = predictor, .compression = compression});
    }
  for (DeflatedTiff& picture : all) picture.fill();
  return all;
}

TEST(Tiff, WholeDeflatedStripsAndTilesAreRead) {
  const testing::TemporaryFolder folder;
  for (const DeflatedTiff& picture : deflated_pictures()) {
    write_file(folder / "a.tif", picture.file(), true);
    const RawFrame frame = load_frame(folder / "a.tif");
    for (int r = 0; r < frame.dn.rows(); ++r)
      for (int c = 0; c < frame.dn.cols(); ++c)
        ASSERT_EQ(frame.dn(r, c), DeflatedTiff::value(static_cast<std::uint32_t>(r),
                                                      static_cast<std::uint32_t>(c)));
  }
}

TEST(Tiff, DamagedDeflatedStripsAndTilesAreRefused) {
  const testing::TemporaryFolder folder;
  const auto refused = [&](const DeflatedTiff& picture, const std::string& why) {
    write_file(folder / "a.tif", picture.file(), true);
    EXPECT_THAT([&] { load_frame(folder / "a.tif"); },
                ThrowsMessage<InputError>(
                    ::testing::AllOf(HasSubstr("cannot be decoded"), HasSubstr(why))));
    EXPECT_EQ(probe_frame(folder / "a.tif").rows, 10);
  };
  for (const DeflatedTiff& picture : deflated_pictures()) {
    const std::size_t last = picture.blocks.size() - 1;
    const std::string place = fmt::format(
        "{} {} of {} is damaged (", picture.tile_cols > 0 ? "tile" : "strip", last + 1, last + 1);
    for (std::size_t i : {0, 2, 4, 6}) {  // a sixth of the block on each time
      DeflatedTiff flipped = picture;
      std::string& block = flipped.blocks[last];
      const std::size_t at = i == 0 ? block.size() / 2 : i * block.size() / 7;
      block[at] = static_cast<char>(block[at] ^ 0x55);
      refused(flipped, place);
    }
    DeflatedTiff checksum = picture;
    checksum.blocks[last].back() = static_cast<char>(checksum.blocks[last].back() ^ 1);
    refused(checksum, place + "incorrect data check");
    DeflatedTiff cut = picture;
    cut.blocks[last].resize(cut.blocks[last].size() / 2);
    refused(cut, place + "it ends too early");
    DeflatedTiff little = picture;
    little.blocks[last] = deflated("few");
    refused(little, place + "it holds less than its pixels");
    DeflatedTiff much = picture;
    much.blocks[last] = deflated(std::string(100000, '\0'));
    refused(much, place + "it holds more than its pixels");
  }
}

TEST(Tiff, OneOfSeveralPagesHasToBeNamed) {
  const testing::TemporaryFolder folder;
  std::string page = tiff(1, 2, 8, 1, "ab");
  // The first directory's link to the next leads to a copy of the same.
  const std::size_t entries = 10, link = 8 + 2 + 12 * entries;
  const std::string directory = page.substr(8, 2 + 12 * entries + 4);
  page.resize(page.size() + page.size() % 2);
  page[link] = static_cast<char>(page.size());
  write_file(folder / "two.tif", page + directory, false);
  EXPECT_THAT([&] { load_frame(folder / "two.tif"); },
              ThrowsMessage<InputError>(HasSubstr("it holds 2 frames")));
}

}  // namespace
}  // namespace malus
