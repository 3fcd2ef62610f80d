#include "malus/io/internal/fits.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <cmath>

#include "support.h"
#include <gmock/gmock.h>

namespace malus::internal {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

std::vector<std::uint8_t> fits(const std::vector<std::string>& cards, const std::string& data) {
  std::string out;
  for (std::string card : cards) {
    card.resize(80, ' ');
    out += card;
  }
  out += "END";
  out.resize((out.size() + 2879) / 2880 * 2880, ' ');
  out += data;
  return {out.begin(), out.end()};
}

std::vector<std::string> header(int bitpix, int cols, int rows) {
  return {"SIMPLE  = T", "BITPIX  = " + std::to_string(bitpix), "NAXIS   = 2",
          "NAXIS1  = " + std::to_string(cols), "NAXIS2  = " + std::to_string(rows)};
}

std::vector<std::string> with(std::vector<std::string> cards, const std::string& card) {
  cards.push_back(card);
  return cards;
}

TEST(Fits, SignedAndShiftedSixteenBits) {
  const std::string data = {'\x80', 0, '\xff', '\xff', 0, 0, '\x7f', '\xff'};
  const Decoded plain = parse_fits(fits(header(16, 2, 2), data), "x.fits");
  EXPECT_THAT(plain.planes[0].values(), ElementsAre(-32768, -1, 0, 32767));
  EXPECT_EQ(plain.bits, 15);
  const Decoded shifted = parse_fits(
      fits(with(header(16, 2, 2), "BZERO   =  3.2768E4 / makes it unsigned"), data), "x");
  EXPECT_THAT(shifted.planes[0].values(), ElementsAre(0, 32767, 32768, 65535));
  EXPECT_EQ(shifted.bits, 16);
  EXPECT_EQ(shifted.sample, "uint16");
}

TEST(Fits, FirstStoredRowIsTheFirstUnlessTold) {
  const auto top = fits(header(8, 1, 3), "abc");
  EXPECT_THAT(parse_fits(top, "x").planes[0].values(), ElementsAre('a', 'b', 'c'));
  const auto bottom = fits(with(header(8, 1, 3), "ROWORDER= 'BOTTOM-UP'"), "abc");
  EXPECT_THAT(parse_fits(bottom, "x").planes[0].values(), ElementsAre('c', 'b', 'a'));
}

TEST(Fits, RowOrderIsReadInAnyCaseAndNoOtherIsPassedOver) {
  const auto bottom = fits(with(header(8, 1, 3), "ROWORDER= 'bottom-up'"), "abc");
  EXPECT_THAT(parse_fits(bottom, "x").planes[0].values(), ElementsAre('c', 'b', 'a'));
  const auto other = fits(with(header(8, 1, 3), "ROWORDER= 'upwards'"), "abc");
  EXPECT_THAT([&] { parse_fits(other, "x"); },
              ThrowsMessage<InputError>(HasSubstr("ROWORDER is \"upwards\"")));
}

TEST(Fits, UnsignedSixtyFourBits) {
  const std::string data("\x80\0\0\0\0\0\x01\xf5\x80\0\0\0\0\0\0\0", 16);  // 501, 0
  for (const char* zero : {"BZERO   = 9223372036854775808", "BZERO   = 9.223372036854775808E18"}) {
    const Decoded decoded = parse_fits(fits(with(header(64, 2, 1), zero), data), "x");
    EXPECT_THAT(decoded.planes[0].values(), ElementsAre(501, 0));
    EXPECT_EQ(decoded.sample, "uint64");
  }
  const auto far = fits(with(header(64, 2, 1), "BZERO   = 9223372036854775000"), data);
  EXPECT_THAT([&] { parse_fits(far, "x"); }, ThrowsMessage<InputError>(HasSubstr("too far")));
  const auto large = fits(with(header(64, 1, 1), "BZERO   = 9223372036854775808"),
                          std::string("\0\0\0\0\0\0\0\0", 8));
  EXPECT_THAT([&] { parse_fits(large, "x"); }, ThrowsMessage<InputError>(HasSubstr("above 2^24")));
}

TEST(Fits, ExponentsAreReadInEitherCase) {
  auto cards = with(header(16, 1, 1), "BZERO   = 3.2768d4");
  cards.push_back("EXPTIME = 1.5d-3");
  const Decoded decoded = parse_fits(fits(cards, {0, 1}), "x");
  EXPECT_EQ(decoded.planes[0].values()[0], 32769);
  EXPECT_DOUBLE_EQ(decoded.exposure_s.value(), 0.0015);
}

// Standard 4.0, section 4.2.4.
TEST(Fits, ExponentsAreWrittenInUpperCase) {
  const Image one(1, 1, 7);
  const std::string content = fits_content({&one, 1}, FitsSample::kUint16, "", 3e-5);
  EXPECT_THAT(content, HasSubstr("EXPTIME =                3E-05"));
}

TEST(Fits, FramesInImageExtensionsAreToldOf) {
  const malus::testing::TemporaryFolder folder;
  const auto extension = [](const std::string& kind, int bitpix, int cols) {
    auto cards = header(bitpix, cols, 2);
    cards[0] = "XTENSION= '" + kind + "'";
    cards.emplace_back("PCOUNT  = 0");
    cards.emplace_back("GCOUNT  = 1");
    return cards;
  };
  const auto frames_of = [&](const std::vector<std::vector<std::string>>& units) {
    std::vector<std::uint8_t> file;
    for (const auto& cards : units) {
      const auto unit = fits(cards, std::string(2880, 'a'));  // all data fit into a block
      file.insert(file.end(), unit.begin(), unit.end());
    }
    write_file(folder / "f.fits", std::string(file.begin(), file.end()), true);
    return fits_frames(folder / "f.fits");
  };
  const auto first = header(16, 3, 2), mask = extension("IMAGE   ", 8, 3),
             table = extension("BINTABLE", 16, 3), small = extension("IMAGE   ", 16, 2),
             frame = extension("IMAGE   ", 16, 3);
  EXPECT_EQ(frames_of({first, mask, table, small}), 1);
  EXPECT_EQ(frames_of({first, std::vector<std::string>{"what no standard knows"}}), 1);
  const auto refused = ThrowsMessage<InputError>(HasSubstr("more frames, as image extensions"));
  EXPECT_THAT([&] { frames_of({first, frame}); }, refused);
  EXPECT_THAT([&] { frames_of({first, table, mask, frame, frame}); }, refused);
  EXPECT_THAT([&] { read_fits(folder / "f.fits", true); }, refused);
}

TEST(Fits, ScaleBlankAndFacts) {
  auto cards = with(header(16, 2, 1), "BSCALE  = 0.5");
  cards.push_back("BLANK   = -1");
  cards.push_back("EXPTIME = 2.5D-3 / s");
  cards.push_back("INSTRUME= 'Camera 7 ' / name");
  const Decoded decoded = parse_fits(fits(cards, {0, 3, '\xff', '\xff'}), "x");
  EXPECT_EQ(decoded.planes[0].values()[0], 1.5f);
  EXPECT_TRUE(std::isnan(decoded.planes[0].values()[1]));
  EXPECT_EQ(decoded.bits, 0);
  EXPECT_DOUBLE_EQ(decoded.exposure_s.value(), 0.0025);
  EXPECT_EQ(decoded.camera, "Camera 7");
}

TEST(Fits, AScaleThatIsNoNumberIsRefused) {
  for (const std::string card : {"BSCALE  = nan", "BZERO   = 'none'"})
    EXPECT_THAT([&] { parse_fits(fits(with(header(8, 1, 1), card), "a"), "x"); },
                ThrowsMessage<InputError>(HasSubstr("is no finite number")))
        << card;
}

TEST(Fits, ExposuresBelowZeroTellNothing) {
  auto cards = with(header(8, 1, 1), "EXPTIME = -1.0");
  EXPECT_FALSE(parse_fits(fits(cards, "a"), "x").exposure_s);
  cards.push_back("EXPOSURE= 0.5");
  EXPECT_EQ(parse_fits(fits(cards, "a"), "x").exposure_s, 0.5);
}

TEST(Fits, BlankMayLieOutsideWhatAFloatHoldsExactly) {
  const auto cards = with(header(32, 2, 1), "BLANK   = -2147483648");
  const Decoded decoded = parse_fits(fits(cards, {0, 0, 0, 7, '\x80', 0, 0, 0}), "x");
  EXPECT_EQ(decoded.planes[0].values()[0], 7.0f);
  EXPECT_TRUE(std::isnan(decoded.planes[0].values()[1]));
}

TEST(Fits, DamagedFilesAreRefused) {
  const auto refused = [](const std::vector<std::uint8_t>& bytes, const std::string& text) {
    EXPECT_THAT([&] { parse_fits(bytes, "x.fits"); }, ThrowsMessage<InputError>(HasSubstr(text)));
  };
  refused(fits(header(16, 2, 2), "1234567"), "needs 8 bytes of data, 7 are there");
  refused(fits(header(12, 2, 2), "12345678"), "BITPIX 12");
  refused(fits(header(16, 0, 2), ""), "0x2");
  refused(fits(header(8, 1 << 20, 1 << 20), ""), "more than");
  refused(fits({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 0"}, ""), "extensions are not read");
  refused(fits({"SIMPLE  = T", "BITPIX  = 8", "NAXIS   = 2", "NAXIS1  = x", "NAXIS2  = 1"}, ""),
          "NAXIS1 is missing or not a whole number");
  auto cut = fits(header(8, 1, 1), "a");
  cut.resize(160);
  refused(cut, "cut off");
}

TEST(Fits, WhatIsWrittenIsReadBack) {
  Planes planes(2, 2, 3);
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < 6; ++i)
      planes[k].values()[static_cast<std::size_t>(i)] = static_cast<float>(k + 50 * i);
  const std::string note(200, 'n');  // longer than a card
  for (const FitsSample sample : {FitsSample::kUint8, FitsSample::kUint16, FitsSample::kFloat}) {
    const std::string content = fits_content(planes, sample, note, 0.25);
    EXPECT_EQ(content.size() % 2880, 0u);
    const Decoded back =
        parse_fits({reinterpret_cast<const std::uint8_t*>(content.data()), content.size()}, "x");
    ASSERT_EQ(back.channels, 2);
    for (int k = 0; k < 2; ++k) EXPECT_EQ(back.planes[k].values(), planes[k].values());
    EXPECT_THAT(back.description, HasSubstr(note));
    EXPECT_EQ(back.exposure_s, 0.25);
  }
}

}  // namespace
}  // namespace malus::internal
