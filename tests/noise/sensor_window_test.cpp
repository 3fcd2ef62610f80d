#include "malus/noise/sensor_window.h"

#include "malus/base/error.h"

#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

NoiseProfile profile_of_sensor() {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("bayer-rggb");
  profile.row_group = 4;
  profile.defects = {32, 24, {{0, 0}, {9, 5}, {12, 6}, {31, 23}}};
  FixedPattern pattern{Image(32, 24), {}, Image(2, 24)};
  for (int r = 0; r < 32; ++r)
    for (int c = 0; c < 24; ++c) pattern.dark_dn(r, c) = static_cast<float>(100 * r + c);
  for (int c = 0; c < 24; ++c) pattern.dark_columns_dn(1, c) = static_cast<float>(c);
  pattern.dark_columns_kept = 0.5;
  profile.pattern = std::make_shared<const FixedPattern>(std::move(pattern));
  return profile;
}

TEST(SensorWindow, CutsDefectsAndMaps) {
  NoiseProfile profile = profile_of_sensor();
  EXPECT_THAT(left_out_of_window(profile, 16, 8),
              HasSubstr("8 x 16 pixels of a sensor of 24 x 32"));
  cut_to_window(profile, {8, 2}, 16, 8, "f.tif");
  EXPECT_EQ(left_out_of_window(profile, 16, 8), "");
  ASSERT_EQ(profile.defects.places.size(), 2u);
  EXPECT_EQ(profile.defects.places[0].row, 1);
  EXPECT_EQ(profile.defects.places[0].col, 3);
  EXPECT_EQ(profile.defects.places[1].row, 4);
  EXPECT_EQ(profile.defects.rows, 16);
  ASSERT_EQ(profile.pattern->dark_dn.cols(), 8);
  EXPECT_EQ(profile.pattern->dark_dn(3, 5), 1107.0F);
  EXPECT_TRUE(profile.pattern->response.empty());
  ASSERT_EQ(profile.pattern->dark_columns_dn.cols(), 8);
  EXPECT_EQ(profile.pattern->dark_columns_dn(1, 5), 7.0F);
  EXPECT_EQ(profile.pattern->dark_columns_kept, 0.5);
}

TEST(SensorWindow, RefusesWhatIsNoPartOfTheSensor) {
  NoiseProfile profile = profile_of_sensor();
  const auto at = [&](int row, int col) { cut_to_window(profile, {row, col}, 16, 8, "f.tif"); };
  EXPECT_THAT([&] { at(2, 0); }, ThrowsMessage<InputError>(HasSubstr("not a multiple of 4 rows")));
  EXPECT_THAT([&] { at(4, 3); }, ThrowsMessage<InputError>(HasSubstr("and 2 columns")));
  EXPECT_THAT([&] { at(20, 0); }, ThrowsMessage<InputError>(HasSubstr("f.tif: 8 x 16 pixels")));
  EXPECT_THAT([&] { at(0, 18); }, ThrowsMessage<InputError>(HasSubstr("reach beyond")));
}

TEST(SensorWindow, NoOriginHelpsAFrameLargerThanTheSensor) {
  NoiseProfile profile = profile_of_sensor();
  for (const auto& [rows, cols] : {std::pair(24, 32), {32, 26}, {36, 24}}) {
    const auto cut_out = [&, rows = rows, cols = cols] {
      cut_to_window(profile, {0, 0}, rows, cols, "f.tif");
    };
    const std::string said = left_out_of_window(profile, rows, cols);
    EXPECT_THAT(said, HasSubstr("more than the model's sensor has, 24 x 32: its 4 defect pixels"));
    EXPECT_THAT(said, HasSubstr("use the model of this sensor"));
    EXPECT_THAT(said, ::testing::Not(HasSubstr("origin")));
    EXPECT_THAT(cut_out, ThrowsMessage<InputError>(HasSubstr("f.tif: ")));
    EXPECT_THAT(cut_out, ThrowsMessage<InputError>(HasSubstr("more than the model's sensor has")));
  }
  EXPECT_THAT(left_out_of_window(profile, 32, 22), HasSubstr("origin"));
}

TEST(SensorWindow, AFrameIsCutOrToldOf) {
  RawFrame frame;
  frame.dn = Image(16, 8);
  for (const bool fill_defects : {true, false}) {
    NoiseProfile whole = profile_of_sensor(), cut = profile_of_sensor();
    EXPECT_THAT(fit_to_sensor(whole, frame, std::nullopt, fill_defects),
                HasSubstr(fill_defects ? "4 defect pixels and maps" : "model's maps"));
    EXPECT_EQ(whole.pattern->dark_dn.rows(), 32);
    EXPECT_EQ(fit_to_sensor(cut, frame, SensorPlace{8, 2}, fill_defects), "");
    EXPECT_EQ(cut.pattern->dark_dn.rows(), 16);
    EXPECT_EQ(cut.defects.places.size(), fill_defects ? 2u : 0u);
  }
}

TEST(SensorWindow, AModelThatKnowsNoPlacesLeavesNothingOut) {
  NoiseProfile profile;
  profile.layout = SensorLayout::named("mono");
  EXPECT_EQ(left_out_of_window(profile, 16, 8), "");
  cut_to_window(profile, {5, 7}, 16, 8, "f.tif");
  EXPECT_TRUE(profile.defects.places.empty());
}

}  // namespace
}  // namespace malus
