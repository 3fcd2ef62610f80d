#include "malus/io/internal/bmp_check.h"

#include "malus/base/error.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"

#include <fstream>
#include <string>

#include "support.h"
#include <gmock/gmock.h>

namespace malus::internal {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

void put(std::string& bytes, std::size_t at, std::uint32_t value, int count) {
  for (int k = 0; k < count; ++k)
    bytes[at + static_cast<std::size_t>(k)] = static_cast<char>(value >> (8 * k));
}

// 3x2 pixels of 8 bits with a grey palette, as camera programs write them: rows of four bytes, the
// last first.
std::string grey_bmp() {
  std::string bytes(54 + 4 * 256, '\0');
  bytes[0] = 'B';
  bytes[1] = 'M';
  put(bytes, 10, 54 + 4 * 256, 4);
  put(bytes, 14, 40, 4);
  put(bytes, 18, 3, 4);
  put(bytes, 22, 2, 4);
  put(bytes, 26, 1, 2);
  put(bytes, 28, 8, 2);
  for (int k = 0; k < 256; ++k)
    put(bytes, static_cast<std::size_t>(54 + 4 * k), static_cast<std::uint32_t>(k) * 0x010101, 4);
  bytes += std::string("\x04\x05\x06\0\x01\x02\xff\0", 8);
  put(bytes, 2, static_cast<std::uint32_t>(bytes.size()), 4);
  return bytes;
}

void check(const std::string& bytes) {
  check_bmp({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, bytes.size(),
            "x.bmp");
}

TEST(BmpCheck, GreyCodesArriveAsStored) {
  const malus::testing::TemporaryFolder folder;
  std::ofstream(folder / "a.bmp", std::ios::binary) << grey_bmp();
  const FrameInfo info = load_frame_info(folder / "a.bmp", {});
  EXPECT_EQ(info.format, "bmp");
  EXPECT_EQ(info.sample, "uint8");
  EXPECT_THAT(info.frame.dn.values(), ElementsAre(1, 2, 255, 4, 5, 6));
}

// A negative height: rows from the top.
TEST(BmpCheck, RowsFromTheTop) {
  const malus::testing::TemporaryFolder folder;
  std::string bytes = grey_bmp();
  put(bytes, 22, static_cast<std::uint32_t>(-2), 4);
  std::ofstream(folder / "a.bmp", std::ios::binary) << bytes;
  EXPECT_THAT(load_frame(folder / "a.bmp", {}).dn.values(), ElementsAre(4, 5, 6, 1, 2, 255));
}

// A palette that is not of greys: its colours. A number beyond it is damage.
TEST(BmpCheck, PalettesComeAsTheirColours) {
  const malus::testing::TemporaryFolder folder;
  std::string bytes = grey_bmp();
  put(bytes, 54 + 4 * 255, 0x102030, 4);
  std::ofstream(folder / "a.bmp", std::ios::binary) << bytes;
  const Picture picture = load_picture(folder / "a.bmp");
  ASSERT_EQ(picture.planes.channels(), 3);
  EXPECT_THAT(picture.planes[0].values(), ElementsAre(1, 2, 0x10, 4, 5, 6));
  EXPECT_THAT(picture.planes[1].values(), ElementsAre(1, 2, 0x20, 4, 5, 6));
  EXPECT_THAT(picture.planes[2].values(), ElementsAre(1, 2, 0x30, 4, 5, 6));
  put(bytes, 46, 255, 4);
  std::ofstream(folder / "b.bmp", std::ios::binary) << bytes;
  EXPECT_THAT([&] { load_picture(folder / "b.bmp"); },
              ThrowsMessage<InputError>(HasSubstr("not in its palette")));
}

// Blue, green, red and, of 32 bits, alpha; rows of whole four bytes.
TEST(BmpCheck, ColoursOf24And32Bits) {
  const malus::testing::TemporaryFolder folder;
  for (const int channels : {3, 4}) {
    std::string bytes = grey_bmp().substr(0, 54);
    put(bytes, 10, 54, 4);
    put(bytes, 18, 1, 4);
    put(bytes, 28, static_cast<std::uint32_t>(8 * channels), 2);
    for (int r = 0; r < 2; ++r) {
      std::string row = {static_cast<char>(10 * r + 1), static_cast<char>(10 * r + 2),
                         static_cast<char>(10 * r + 3), static_cast<char>(10 * r + 4)};
      if (channels == 3) row[3] = 0;
      bytes += row;
    }
    std::ofstream(folder / "a.bmp", std::ios::binary | std::ios::trunc) << bytes;
    const Picture picture = load_picture(folder / "a.bmp");
    ASSERT_EQ(picture.planes.channels(), channels);
    EXPECT_THAT(picture.planes[0].values(), ElementsAre(13, 3));
    EXPECT_THAT(picture.planes[2].values(), ElementsAre(11, 1));
    if (channels == 4) {
      EXPECT_THAT(picture.planes[3].values(), ElementsAre(14, 4));
    }
  }
}

TEST(BmpCheck, EveryCutIsFound) {
  const std::string good = grey_bmp();
  EXPECT_NO_THROW(check(good));
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(check(good.substr(0, length)), InputError) << length;
}

TEST(BmpCheck, SaysWhatIsWrongAndWhatToDo) {
  const auto with = [](std::size_t at, std::uint32_t value, int count) {
    return [=] {
      std::string bytes = grey_bmp();
      put(bytes, at, value, count);
      check(bytes);
    };
  };
  EXPECT_THAT(with(18, 1000, 4),
              ThrowsMessage<InputError>(AllOf(HasSubstr("has 1086 bytes, 1000x2 pixels need 3078"),
                                              HasSubstr("copy or record it again"))));
  EXPECT_THAT(with(30, 1, 4), ThrowsMessage<InputError>(AllOf(HasSubstr("is compressed"),
                                                              HasSubstr("save it uncompressed"))));
  EXPECT_THAT(with(28, 16, 2), ThrowsMessage<InputError>(HasSubstr("has 16 bits per pixel")));
  EXPECT_THAT(with(14, 12, 4), ThrowsMessage<InputError>(HasSubstr("has a header of 12 bytes")));
  EXPECT_THROW(with(22, 0, 4)(), InputError);
  EXPECT_THROW(with(22, 0x80000000u, 4)(), InputError);
  EXPECT_THROW(with(18, 0xffffffffu, 4)(), InputError);
  EXPECT_THROW(with(10, 20, 4)(), InputError);
}

}  // namespace
}  // namespace malus::internal
