#include "malus/capture/capture.h"

#include "malus/base/error.h"
#include "malus/capture/camera.h"
#include "malus/capture/internal/frame_writer.h"
#include "malus/capture/internal/loss_count.h"

#include <cstdlib>
#include <fstream>
#include <system_error>

#include "support.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

namespace malus {
namespace {

using testing::TemporaryFolder;

std::uint64_t lost_between(std::initializer_list<std::uint64_t> numbers) {
  LossCount count;
  for (const std::uint64_t number : numbers) count.add(number);
  return count.lost();
}

TEST(LossCount, GapsAreCountedAlsoWhereThe16BitCountTurns) {
  EXPECT_EQ(lost_between({7}), 0u);
  EXPECT_EQ(lost_between({7, 8, 10, 13}), 3u);
  EXPECT_EQ(lost_between({65534, 65535, 1, 2}), 0u);  // GigE Vision leaves out 0
  EXPECT_EQ(lost_between({65534, 2}), 2u);
  EXPECT_EQ(lost_between({65533, 65535, 4}), 4u);
  EXPECT_EQ(lost_between({65535, 0, 1}), 0u);
  EXPECT_EQ(lost_between({65535, 65536, 65538}), 1u);  // a 64-bit count does not turn
}

TEST(LossCount, FramesOutOfOrderAndNewBeginningsAreNoLosses) {
  EXPECT_EQ(lost_between({10, 9, 10}), 0u);
  EXPECT_EQ(lost_between({900, 1, 2}), 0u);
  EXPECT_EQ(lost_between({1u << 20, 0}), 0u);
}

// As where a container allows few threads: here their stacks find no room.
[[noreturn]] void ask_for_too_many_threads() {
  constexpr int kThreads = 100000;
  const rlimit no_more{1U << 30, 1U << 30};
  setrlimit(RLIMIT_AS, &no_more);
  try {
    const FrameWriter writer(kThreads, 4);
  } catch (const std::system_error&) {
    std::_Exit(7);
  }
  std::_Exit(0);
}

TEST(FrameWriter, ThreadsThatTheSystemRefusesAreAnErrorAndNoEnd) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  GTEST_SKIP() << "the sanitizers end where their own memory finds no room";
#endif
  EXPECT_EXIT(ask_for_too_many_threads(), ::testing::ExitedWithCode(7), "");
}

std::filesystem::path write_plan(const TemporaryFolder& folder, const std::string& text) {
  const auto path = folder / "plan.toml";
  std::ofstream(path) << text;
  return path;
}

constexpr const char* kFakePlan = R"(
[sensor]
name = "fake"
layout = "mono"
[camera]
id = "Fake_1"
width = 64
height = 32
[[capture]]
kind = "bias"
gain_db = [0, 6]
exposure_s = 0.0001
frames = 5
prompt = "cover the lens"
[[capture]]
kind = "flat"
gain_db = 6
exposure_s = [0.001, 0.002]
frames = 3
)";

std::string problem_of(const std::filesystem::path& plan) {
  try {
    load_capture_plan(plan);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(CapturePlan, ExpandsGainsAndExposures) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  ASSERT_EQ(plan.steps.size(), 4u);
  EXPECT_EQ(plan.steps[0].folder(), "bias/g0/e0.0001");
  EXPECT_EQ(plan.steps[0].prompt, "cover the lens");
  EXPECT_EQ(plan.steps[1].prompt, "");
  EXPECT_EQ(plan.steps[3].folder(), "flat/g6/e0.002_l2");
}

TEST(CapturePlan, MistakesNameTheKey) {
  const TemporaryFolder folder;
  EXPECT_NE(problem_of(write_plan(folder, "[camera]\nsettel_frames = 3\n")).find("settle_frames"),
            std::string::npos);
  EXPECT_NE(problem_of(write_plan(folder, "[camera]\n")).find("[[capture]]"), std::string::npos);
  EXPECT_NE(
      problem_of(
          write_plan(folder,
                     "[[capture]]\nkind = \"bias\"\ngain_db = 0\nexposure_s = -1\nframes = 2\n"))
          .find("exposure_s"),
      std::string::npos);
  const std::string twice =
      "[[capture]]\nkind = \"bias\"\ngain_db = [0, 0]\nexposure_s = 1\nframes = 2\n";
  EXPECT_NE(problem_of(write_plan(folder, twice)).find("twice"), std::string::npos);
  const std::string whose = "[sensor]\nblack = [64, 65, 66, 67]\n";
  EXPECT_NE(problem_of(write_plan(folder, whose)).find("has 4 values, and no layout"),
            std::string::npos);
}

TEST(CapturePlan, WhatIsOfHeaderlessFilesIsRefused) {
  const TemporaryFolder folder;
  for (const char* line : {"raw_format = \"mono12p\"\nsize = \"64x32\"\n", "size = \"64x32\"\n"}) {
    std::string plan = kFakePlan;
    plan.insert(plan.find("[camera]"), line);
    const std::string problem = problem_of(write_plan(folder, plan));
    EXPECT_NE(problem.find(line[0] == 'r' ? "raw_format" : "size"), std::string::npos) << problem;
    EXPECT_NE(problem.find("written as TIFF"), std::string::npos) << problem;
  }
}

TEST(Capture, FakeCameraGivesASessionThatLoads) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  int asked = 0;
  const auto report = capture(plan, folder / "out", {.ask = [&](const CaptureStep&) { ++asked; }},
                              silent_progress());
  EXPECT_EQ(asked, 1);
  const auto session = load_session(report.session);
  ASSERT_EQ(session.groups.size(), 4u);
  EXPECT_EQ(session.groups[0].paths.size(), 5u);
  EXPECT_EQ(session.groups[3].level, 2);
  const auto frame =
      load_frame(session.groups[3].paths[0], frame_options(session, session.groups[3]));
  EXPECT_EQ(frame.dn.rows(), 32);
  EXPECT_EQ(frame.dn.cols(), 64);
  EXPECT_EQ(frame.gain.gain_db, 6.0);
  EXPECT_NEAR(frame.exposure_s.value(), 0.002, 1e-5);
}

// An interrupted run leaves a gap; a new one keeps what is whole and takes the rest: nothing lost,
// nothing doubled.
TEST(Capture, ContinuesAfterAnInterruption) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  capture(plan, folder / "out", {}, silent_progress());
  const auto kept = folder / "out" / "bias/g0/e0.0001/f000001.tif";
  const auto time = std::filesystem::last_write_time(kept);
  std::filesystem::remove(folder / "out" / "bias/g0/e0.0001/f000003.tif");
  std::filesystem::remove(folder / "out" / "session.toml");
  const auto report = capture(plan, folder / "out", {}, silent_progress());
  EXPECT_EQ(report.steps[0].kept, 2);
  EXPECT_EQ(report.steps[0].taken, 3);
  EXPECT_EQ(report.steps[1].taken, 0);
  EXPECT_EQ(std::filesystem::last_write_time(kept), time);
  EXPECT_EQ(load_session(report.session).groups[0].paths.size(), 5u);
}

// As a machine that lost its power leaves them.
TEST(Capture, TakesDamagedFramesAgain) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  capture(plan, folder / "out", {}, silent_progress());
  const auto bias = folder / "out" / "bias/g0/e0.0001";
  const auto whole = std::filesystem::file_size(bias / "f000001.tif");
  for (const std::uintmax_t left : {std::uintmax_t{0}, std::uintmax_t{100}, whole / 2}) {
    std::filesystem::resize_file(bias / "f000004.tif", left);
    const auto report = capture(plan, folder / "out", {}, silent_progress());
    EXPECT_EQ(report.steps[0].kept, 3) << left;
    EXPECT_EQ(report.steps[0].taken, 2) << left;
    EXPECT_EQ(std::filesystem::file_size(bias / "f000004.tif"), whole);
  }
}

TEST(Capture, OneRunWritesIntoAFolderAtATime) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  std::string refused;
  const auto again = [&](const CaptureStep&) {
    try {
      capture(plan, folder / "out", {}, silent_progress());
    } catch (const InputError& error) {
      refused = error.problem();
    }
  };
  capture(plan, folder / "out", {.ask = again}, silent_progress());
  EXPECT_EQ(refused, "another capture is writing into this folder");
  EXPECT_FALSE(std::filesystem::exists(folder / "out" / ".lock"));
}

TEST(Capture, RefusesTheFolderOfAnotherPlanAndImpossibleSettings) {
  const TemporaryFolder folder;
  capture(load_capture_plan(write_plan(folder, kFakePlan)), folder / "out", {}, silent_progress());
  std::string other = kFakePlan;
  other.replace(other.find("frames = 5"), 10, "frames = 6");
  EXPECT_THROW(
      capture(load_capture_plan(write_plan(folder, other)), folder / "out", {}, silent_progress()),
      InputError);
  other.replace(other.find("[0, 6]"), 6, "[0, 600]");
  EXPECT_THROW(
      capture(load_capture_plan(write_plan(folder, other)), folder / "new", {}, silent_progress()),
      InputError);
  EXPECT_THROW(Camera("Fake_99"), InputError);
}

// Features are set after the size, as binning is, and change it here as a camera's own steps would.
TEST(Capture, RefusesASizeThatTheCameraDoesNotTake) {
  const TemporaryFolder folder;
  std::string plan = kFakePlan;
  plan.replace(plan.find("[[capture]]"), 0, "[camera.features]\nWidth = \"48\"\n");
  try {
    capture(load_capture_plan(write_plan(folder, plan)), folder / "out", {}, silent_progress());
    FAIL() << "took frames of another size";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("asks for frames of 64 x 32 pixels, the camera "
                                                   "takes 48 x 32"));
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "out"));
}

// A prompt asks for work at the camera: nobody is asked for frames that are there.
TEST(Capture, AsksForWhatIsLeftToTake) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  std::vector<std::string> asked;
  const CaptureWatcher watcher{
      .ask = [&](const CaptureStep& step) { asked.push_back(step.prompt); }};
  capture(plan, folder / "out", watcher, silent_progress());
  EXPECT_EQ(asked.size(), 1u);
  std::filesystem::remove(folder / "out" / "flat/g6/e0.001_l1/f000002.tif");
  capture(plan, folder / "out", watcher, silent_progress());
  EXPECT_EQ(asked.size(), 1u);  // the flats have no prompt
  std::filesystem::remove(folder / "out" / "bias/g6/e0.0001/f000002.tif");  // the second step
  capture(plan, folder / "out", watcher, silent_progress());
  EXPECT_EQ(asked, std::vector<std::string>(2, "cover the lens"));
}

TEST(Capture, RefusesAPlanInThePlaceOfItsCopy) {
  const TemporaryFolder folder;
  const auto plan = load_capture_plan(write_plan(folder, kFakePlan));
  EXPECT_THROW(capture(plan, folder.path(), {}, silent_progress()), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "bias"));
}

TEST(Capture, ListsTheFakeCameraWithItsFormats) {
  const auto camera = describe_camera("Fake_1");
  EXPECT_FALSE(camera.pixel_formats.empty());
}

}  // namespace
}  // namespace malus
