#include "malus/io/raw_format.h"

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

std::vector<float> decode(RawFormat format, const std::vector<std::uint8_t>& bytes, int rows,
                          int cols) {
  Image image(rows, cols);
  decode_raw(format, bytes, image);
  return image.values();
}

using ::testing::ElementsAre;

TEST(RawFormat, NamesRoundTripAndUnknownOnesNameTheNearest) {
  for (const auto& name : raw_format_names())
    EXPECT_EQ(raw_format_name(raw_format_named(name)), name);
  EXPECT_EQ(raw_format_names().size(), 5u);
  try {
    raw_format_named("mono12P");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("did you mean mono12p"));
  }
}

TEST(RawFormat, BytesRoundUp) {
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono8, 3, 5), 15u);
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono10p, 1, 4), 5u);
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono10p, 1, 5), 7u);
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono12p, 1, 3), 5u);
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono12Packed, 2, 2), 6u);
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono16, 2, 2), 8u);
  // beyond 32 bits
  EXPECT_EQ(raw_format_bytes(RawFormat::kMono16, 1 << 20, 1 << 20), std::size_t{1} << 41);
}

// The two 12-bit packings hold the pair 0x123, 0xABC in different bytes (PFNC 2.4, figures of
// Mono12p; GigE Vision 2.0, GVSP Mono12Packed).
TEST(RawFormat, TwelveBitPackingsDiffer) {
  const std::vector<std::uint8_t> pfnc = {0x23, 0xC1, 0xAB}, gige = {0x12, 0xC3, 0xAB};
  EXPECT_THAT(decode(RawFormat::kMono12p, pfnc, 1, 2), ElementsAre(0x123, 0xABC));
  EXPECT_THAT(decode(RawFormat::kMono12Packed, gige, 1, 2), ElementsAre(0x123, 0xABC));
}

TEST(RawFormat, TenBitPixelsFollowEachOtherFromTheLowestBit) {
  const std::uint64_t pixels[4] = {0x001, 0x2AA, 0x155, 0x3FE};
  const std::uint64_t word = pixels[0] | pixels[1] << 10 | pixels[2] << 20 | pixels[3] << 30;
  std::vector<std::uint8_t> bytes;
  for (int i = 0; i < 5; ++i) bytes.push_back(static_cast<std::uint8_t>(word >> (8 * i)));
  EXPECT_THAT(decode(RawFormat::kMono10p, bytes, 2, 2), ElementsAre(0x001, 0x2AA, 0x155, 0x3FE));
}

TEST(RawFormat, LinesAreNotPadded) {
  // 3x3 of 12 bits: pixel 3, the second row's first, begins in the middle of byte 4.
  const std::vector<std::uint8_t> bytes = {0x01, 0x20, 0x00, 0x03, 0x40, 0x00, 0x05,
                                           0x60, 0x00, 0x07, 0x80, 0x00, 0x09, 0x00};
  EXPECT_THAT(decode(RawFormat::kMono12p, bytes, 3, 3), ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9));
}

TEST(RawFormat, EightAndSixteenBits) {
  EXPECT_THAT(decode(RawFormat::kMono8, {0, 255}, 1, 2), ElementsAre(0, 255));
  EXPECT_THAT(decode(RawFormat::kMono16, {0x34, 0x12, 0xff, 0xff}, 1, 2),
              ElementsAre(0x1234, 0xffff));
}

}  // namespace
}  // namespace malus
