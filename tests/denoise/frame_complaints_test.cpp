// What is said of a result, a model and a gain: each line where it is due, and not beside it.
#include "malus/denoise/frame_complaints.h"

#include "malus/noise/two_outputs.h"

#include <optional>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

RawFrame mono_frame() {
  RawFrame frame;
  frame.black_dn = {0.0};
  frame.source = "f.npy";
  return frame;
}

Denoised plain_result() {
  Denoised result;
  result.dn_above_black = Image(100, 100);
  result.mean_dn = {200};
  result.mean_shift_dn = {1};
  result.sigma_used_dn = {10};
  return result;
}

TEST(ResultComplaints, AreNoneOfAPlainResult) {
  EXPECT_THAT(result_complaints(mono_frame(), plain_result(), {}), IsEmpty());
}

// What has no polarizers has no DoLP.
TEST(ResultComplaints, NameWhatCutOffDarknessSpoils) {
  Denoised result = plain_result();
  result.cut_off_share = 0.02;
  EXPECT_THAT(result_complaints(mono_frame(), result, {}),
              ElementsAre(HasSubstr("cut the noise of dark places off: the light there comes out "
                                    "wrong; raise the camera's black level")));
  RawFrame polarized = mono_frame();
  polarized.layout = SensorLayout::named("polar-mono");
  EXPECT_THAT(result_complaints(polarized, result, {}),
              ElementsAre(HasSubstr("the light there and its DoLP come out wrong; raise")));
}

TEST(ResultComplaints, NameWhatWasFilled) {
  Denoised result = plain_result();
  result.defect_pixels = 101;
  EXPECT_THAT(result_complaints(mono_frame(), result, {}),
              ElementsAre(AllOf(HasSubstr("101 pixels, 1 % of the frame, are defects"),
                                HasSubstr("defects false keeps them"))));
  result.defect_pixels = 99;
  EXPECT_THAT(result_complaints(mono_frame(), result, {}), IsEmpty());
}

TEST(TileWorkComplaint, NamesTheMemoryThatWouldSaveTiles) {
  EXPECT_EQ(tile_work_complaint(12, 1.9, 238), "");
  EXPECT_THAT(tile_work_complaint(12, 5.42, 238),
              AllOf(HasSubstr("12 tiles"), HasSubstr("take 5.4 times the work"),
                    HasSubstr("for which memory 238 is enough")));
}

TEST(ResultComplaints, NameAFrameThatIsTooSmallForItsStatedError) {
  Denoised result = plain_result();
  result.dn_above_black = Image(8, 100);
  EXPECT_THAT(result_complaints(mono_frame(), result, {}), IsEmpty());
  result.variance_dn2 = Image(8, 100);
  EXPECT_THAT(result_complaints(mono_frame(), result, {}),
              ElementsAre(HasSubstr("has 8 pixels one way")));
}

TEST(ResultComplaints, NameAMeanThatMoved) {
  Denoised result = plain_result();
  result.mean_shift_dn = {-11};  // the limit is 5 % of the mean and of the deviation: 10.5
  EXPECT_THAT(result_complaints(mono_frame(), result, {}),
              ElementsAre(AllOf(HasSubstr("from 200 to 189 DN"),
                                HasSubstr("is not the model's; check gain, black and model"))));
  NoiseProfile estimated;
  estimated.estimated_from_picture = true;
  EXPECT_THAT(result_complaints(mono_frame(), result, estimated),
              ElementsAre(HasSubstr("texture was taken for noise; give the camera's model")));
  EXPECT_THAT(result_complaints(mono_frame(), result, {}, "net.safetensors"),
              ElementsAre(HasSubstr("net.safetensors does not suit the frame (see with method")));
  result.cut_off_undone = true;  // dark places come out darker, as they should
  EXPECT_THAT(result_complaints(mono_frame(), result, {}), IsEmpty());
}

TEST(ExtrapolationComplaint, IsOfGainsOutside) {
  const NoiseModel model = load_model("builtin:imx250myr-simulated");  // 0 to 30 dB
  for (const double inside : {0.0, 7.5, 30.0})
    EXPECT_EQ(extrapolation_complaint(model, {inside, std::nullopt}), "");
  for (const double outside : {-1.0, 31.0})
    EXPECT_THAT(extrapolation_complaint(model, {outside, std::nullopt}),
                AllOf(HasSubstr("extrapolated to"), HasSubstr("range 0 dB to 30 dB")));
  EXPECT_EQ(extrapolation_complaint(model, {}), "");
  NoiseModel darks_above = model;  // without K at its highest gain, where nothing is fitted
  darks_above.physics.back().K.mean.clear();
  darks_above.joint = fit_joint_model(darks_above.physics).value();
  const double lower_db = *(model.physics.end() - 2)->gain.gain_db;
  EXPECT_THAT(extrapolation_complaint(darks_above, {lower_db + 1, std::nullopt}),
              HasSubstr(fmt::format("range 0 dB to {:g} dB", lower_db)));
  EXPECT_EQ(extrapolation_complaint(darks_above, {lower_db, std::nullopt}), "");
  NoiseModel nameless = model;
  nameless.physics.resize(1);
  nameless.physics[0].gain = {};
  EXPECT_EQ(extrapolation_complaint(nameless, {12.0, std::nullopt}),
            "does not say its gain; it is taken for 12 dB");
  EXPECT_EQ(extrapolation_complaint(nameless, {}), "");
}

TEST(CutOffComplaints, AreOfTheGainAlone) {
  NoiseModel model = load_model("builtin:imx250myr-simulated");
  const GainSetting first = model.physics[0].gain;
  EXPECT_THAT(cut_off_complaints(model, first, true), IsEmpty());
  model.physics[0].dark_zero_share.assign(16, 0.0);
  model.physics[0].dark_zero_share[3] = 0.25;
  model.physics[0].mu.mean[3] = 2.5;
  EXPECT_THAT(cut_off_complaints(model, first, true),
              ElementsAre(AllOf(HasSubstr("25 % of the dark pixels"), HasSubstr("2.5 DN"),
                                HasSubstr("is worked out as of normal noise"))));
  EXPECT_THAT(cut_off_complaints(model, first, false),
              ElementsAre(HasSubstr("light comes out about as much too dark")));
  EXPECT_THAT(cut_off_complaints(model, model.physics[1].gain, true), IsEmpty());
  // A profile is undone where that is said, and nowhere else.
  const double first_db = *first.gain_db, second_db = *model.physics[1].gain.gain_db;
  for (const double db : {first_db, (first_db + second_db) / 2, second_db, second_db + 1}) {
    const GainSetting gain{db, {}};
    EXPECT_EQ(model.profile_at(gain).dark_was_cut_off, db < second_db) << db;
    EXPECT_EQ(cut_off_complaints(model, gain, true).empty(), db >= second_db) << db;
  }
}

TEST(TwoOutputsComplaints, AreOfTheGainAlone) {
  NoiseModel model = load_model("builtin:imx250myr-simulated");
  const GainSetting first = model.physics[0].gain, second = model.physics[1].gain;
  model.physics[0].warnings = {"something else", std::string(kTwoOutputsFinding) + ", 0.7 DN"};
  EXPECT_THAT(two_outputs_complaints(model, first), ElementsAre(HasSubstr("own, 0.7 DN")));
  EXPECT_THAT(two_outputs_complaints(model, second), IsEmpty());
  EXPECT_EQ(complaints_at_gain(model, first, true), two_outputs_complaints(model, first));
  const GainSetting between{(*first.gain_db + *second.gain_db) / 2, {}};
  EXPECT_THAT(two_outputs_complaints(model, between), ElementsAre(HasSubstr("own, 0.7 DN")));
}

}  // namespace
}  // namespace malus
