#include "malus/io/internal/png_check.h"

#include "malus/base/error.h"
#include "malus/io/picture_file.h"

#include <string>

#include "support.h"
#include <gmock/gmock.h>

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
