#include "malus/io/internal/netpbm.h"

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

Decoded parsed(const std::string& text, bool pixels = true) {
  return parse_netpbm({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, "x.pgm",
                      pixels);
}

TEST(Netpbm, TwelveBitsArriveAsStored) {
  const Decoded grey = parsed(std::string("P5\n2 2\n4095\n\x0f\xff\0\1\1\0\0\0", 20));
  EXPECT_THAT(grey.planes[0].values(), ElementsAre(4095, 1, 256, 0));
  EXPECT_EQ(grey.bits, 12);
  EXPECT_EQ(grey.sample, "uint16");
  EXPECT_EQ(grey.channels, 1);
  EXPECT_FALSE(grey.white_dn);
}

TEST(Netpbm, EightBitsCommentsAndALargestValueOfItsOwn) {
  const Decoded grey = parsed("P5 # by a camera\n# 2 3\n 3\t1\r\n200\n\x01\xc8\n");
  EXPECT_THAT(grey.planes[0].values(), ElementsAre(1, 200, '\n'));
  EXPECT_EQ(grey.sample, "uint8");
  EXPECT_EQ(grey.bits, 8);
  EXPECT_EQ(grey.white_dn, 200.0);
}

TEST(Netpbm, ColoursAreSeparated) {
  const Decoded colour = parsed("P6\n2 1\n255\nabcdef");
  ASSERT_EQ(colour.planes.channels(), 3);
  EXPECT_THAT(colour.planes[0].values(), ElementsAre('a', 'd'));
  EXPECT_THAT(colour.planes[2].values(), ElementsAre('c', 'f'));
}

TEST(Netpbm, AProbeNeedsTheHeaderAlone) {
  const Decoded grey = parsed("P5\n2448 2048\n255\n", false);
  EXPECT_EQ(grey.rows, 2048);
  EXPECT_EQ(grey.planes.channels(), 0);
}

TEST(Netpbm, EveryCutIsFound) {
  const std::string good = "P5\n# c\n3 2\n255\nabcdef";
  EXPECT_NO_THROW(parsed(good));
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(parsed(good.substr(0, length)), InputError) << length;
}

TEST(Netpbm, SaysWhatIsWrongAndWhatToDo) {
  const auto of = [](const std::string& text) { return [text] { parsed(text); }; };
  EXPECT_THAT(of("P5\n3 2\n255\nabc"),
              ThrowsMessage<InputError>(AllOf(HasSubstr("has 14 bytes, 3x2 pixels need 17"),
                                              HasSubstr("copy or record it again"))));
  EXPECT_THAT(of("P5\n3 1\n255\nabcdef"),
              ThrowsMessage<InputError>(HasSubstr("store one picture")));
  EXPECT_THAT(of("P5\n3 x\n255\nabc"), ThrowsMessage<InputError>(HasSubstr("no whole number")));
  EXPECT_THAT(of("P5\n-3 1\n255\nabc"), ThrowsMessage<InputError>(HasSubstr("no whole number")));
  EXPECT_THAT(of("P5\n3 1\n70000\nabc"),
              ThrowsMessage<InputError>(HasSubstr("declares values up to 70000")));
  EXPECT_THAT(of("P5\n3 1\n98\nabc"),
              ThrowsMessage<InputError>(HasSubstr("holds 99, it declares up to 98")));
  EXPECT_THROW(parsed("P5\n0 1\n255\n"), InputError);
  EXPECT_THROW(parsed("P5\n99999999 99999999\n255\n"), InputError);
}

TEST(Netpbm, AByteTooManyShiftsNoPixels) {
  const std::string windows = "P5\r\n3 1\r\n255\r\n";
  EXPECT_THAT([&] { parsed(windows + "abc"); },
              ThrowsMessage<InputError>(HasSubstr("shifts its pixels by one")));
  // Its first pixel is 10.
  EXPECT_THAT(parsed("P5\n3 1\n255\r\nab").planes[0].values(), ElementsAre('\n', 'a', 'b'));
  EXPECT_THAT(parsed("P5\n3 1\n255\nabc\n").planes[0].values(), ElementsAre('a', 'b', 'c'));
  EXPECT_THAT([&] { parsed("P5\n3 1\n255\nabc\x07"); },
              ThrowsMessage<InputError>(HasSubstr("goes on after its picture")));
}

TEST(Netpbm, FramesAndPicturesAreReadByTheirFirstBytes) {
  const malus::testing::TemporaryFolder folder;
  std::ofstream(folder / "frame.raw", std::ios::binary) << "P5\n2 1\n1000\n"
                                                        << '\1' << '\2' << '\3' << '\4';
  const FrameInfo info = load_frame_info(folder / "frame.raw", {});
  EXPECT_EQ(info.format, "pgm");
  EXPECT_EQ(info.frame.white_dn, 1000.0);
  EXPECT_TRUE(info.frame.white_known);
  EXPECT_THAT(info.frame.dn.values(), ElementsAre(258, 772));
  std::ofstream(folder / "colour.ppm", std::ios::binary) << "P6\n1 1\n255\nabc";
  EXPECT_EQ(load_picture(folder / "colour.ppm").planes.channels(), 3);
}

}  // namespace
}  // namespace malus::internal
