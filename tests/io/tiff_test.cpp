#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/frame_file.h"

#include "support.h"
#include "tiff_directory.h"
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace malus {
namespace {

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

TEST(Tiff, SeveralPagesAreRefused) {
  const testing::TemporaryFolder folder;
  std::string page = tiff(1, 2, 8, 1, "ab");
  // The first directory's link to the next leads to a copy of the same.
  const std::size_t entries = 10, link = 8 + 2 + 12 * entries;
  const std::string directory = page.substr(8, 2 + 12 * entries + 4);
  page.resize(page.size() + page.size() % 2);
  page[link] = static_cast<char>(page.size());
  write_file(folder / "two.tif", page + directory, false);
  EXPECT_THAT([&] { load_frame(folder / "two.tif"); },
              ThrowsMessage<InputError>(HasSubstr("several pictures")));
}

}  // namespace
}  // namespace malus
