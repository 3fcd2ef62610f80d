#include "malus/noise/same_sensor.h"

#include "malus/base/error.h"

#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

RawFrame frame_of(const char* layout) {
  RawFrame frame;
  frame.source = "f.dng";
  frame.layout = SensorLayout::named(layout);
  frame.layout_known = true;
  frame.black_dn.assign(static_cast<std::size_t>(frame.layout.channels()), 64.0);
  return frame;
}

TEST(SameSensor, AModelsLayoutIsForFramesThatDoNotKnowTheirs) {
  const SensorLayout grbg = SensorLayout::named("bayer-grbg");
  RawFrame other = frame_of("bayer-rggb"), own = frame_of("bayer-grbg"), unknown = frame_of("mono");
  EXPECT_THAT([&] { take_layout_of_model(other, grbg); },
              ThrowsMessage<InputError>(
                  HasSubstr("f.dng: has the layout bayer-rggb, the noise model bayer-grbg")));
  take_layout_of_model(own, grbg);
  EXPECT_EQ(own.black_dn, std::vector<double>(4, 64.0));
  unknown.layout_known = false;
  take_layout_of_model(unknown, grbg);
  EXPECT_EQ(unknown.layout, grbg);
  EXPECT_EQ(unknown.black_dn, std::vector<double>(4, 64.0));
}

TEST(SameSensor, ADeclarationAgainstTheFileIsNoted) {
  RawFrame frame = frame_of("bayer-rggb");
  EXPECT_EQ(declaration_note(frame), "");
  frame.file_layout = "bayer-grbg";
  EXPECT_THAT(declaration_note(frame),
              HasSubstr("its layout is bayer-grbg as the file says, taken as bayer-rggb"));
}

}  // namespace
}  // namespace malus
