#include "malus/io/internal/png_check.h"

#include "malus/base/error.h"
#include "malus/io/picture_file.h"

#include <algorithm>
#include <array>
#include <string>
#include <utility>

#include "support.h"
#include <gmock/gmock.h>
#include <zlib.h>

namespace malus::internal {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

TEST(PngCheck, AnyFlippedBitIsFound) {
  const malus::testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(5, 7, 3.0f));
  const auto good = read_bytes(folder / "a.png");
  EXPECT_NO_THROW(check_png(good, "a.png"));
  for (std::size_t i = 0; i < good.size(); ++i)
    for (int bit = 0; bit < 8; ++bit) {
      auto bad = good;
      bad[i] = static_cast<std::uint8_t>(bad[i] ^ (1 << bit));
      EXPECT_THROW(check_png(bad, "a.png"), InputError) << i << "." << bit;
    }
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(check_png(Bytes(good).first(length), "a.png"), InputError) << length;
}

TEST(PngCheck, SizesOutOfRangeAreRefused) {
  const malus::testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(5, 7, 3.0f));
  for (const auto& [bytes_of_cols, what] :
       {std::pair{std::array<std::uint8_t, 4>{0, 0, 0, 0}, "declares 0x5 pixels"},
        {{0x80, 0, 0, 0}, "declares 2147483648x5 pixels"},
        {{0x7f, 0xff, 0xff, 0xff}, "it declares 2147483647x5 pixels"}}) {
    auto bytes = read_bytes(folder / "a.png");
    constexpr std::size_t kChunk = 12, kBody = 17;  // its type and 13 bytes
    std::copy(bytes_of_cols.begin(), bytes_of_cols.end(), bytes.begin() + kChunk + 4);
    const auto sum = static_cast<std::uint32_t>(crc32_z(0, bytes.data() + kChunk, kBody));
    for (std::size_t i = 0; i < 4; ++i)
      bytes[kChunk + kBody + i] = static_cast<std::uint8_t>(sum >> (24 - 8 * i));
    EXPECT_THAT([&] { check_png(bytes, "a.png"); }, ThrowsMessage<InputError>(HasSubstr(what)));
  }
}

TEST(PngCheck, DamagedPixelsAreNamed) {
  const malus::testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(5, 7, 3.0f));
  auto bytes = read_bytes(folder / "a.png");
  const std::string text(bytes.begin(), bytes.end());
  bytes[text.find("IDAT") + 6] ^= 1;
  EXPECT_THAT([&] { check_png(bytes, "a.png"); },
              ThrowsMessage<InputError>(HasSubstr("wrong checksum in its IDAT")));
}

TEST(PngCheck, SaysWhatIsWrongAndWhatToDo) {
  const malus::testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(5, 7, 3.0f));
  const auto good = read_bytes(folder / "a.png");
  auto bytes = good;
  bytes[1] ^= 1;
  EXPECT_THAT([&] { check_png(bytes, "a.png"); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("has a damaged signature"),
                                              HasSubstr("is damaged or cut off: copy or record"))));
  EXPECT_THAT([&] { check_png(Bytes(good).first(good.size() - 12), "a.png"); },
              ThrowsMessage<InputError>(HasSubstr("ends before its IEND chunk")));
}

}  // namespace
}  // namespace malus::internal
