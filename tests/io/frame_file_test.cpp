#include "malus/io/frame_file.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/picture_file.h"

#include <cmath>
#include <fstream>
#include <limits>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr const char* kIntegerEndings[] = {".tif", ".png", ".fits", ".npy"};
constexpr const char* kFloatEndings[] = {".tif", ".exr", ".fits", ".npy"};

RawFrame ramp(int rows, int cols, double step) {
  RawFrame frame;
  frame.dn = Image(rows, cols);
  for (std::size_t i = 0; i < frame.dn.size(); ++i)
    frame.dn.values()[i] = static_cast<float>(static_cast<double>(i) * step);
  frame.layout = SensorLayout::named("polar-bayer-rggb");
  frame.layout_known = true;
  for (int channel = 0; channel < 16; ++channel) frame.black_dn.push_back(60.25 + channel);
  frame.black_known = true;
  frame.white_dn = 4095;
  frame.white_known = true;
  frame.gain.gain_db = 12.5;
  frame.exposure_s = 0.001;
  return frame;
}

void expect_frame_refused(const std::filesystem::path& path, const std::string& text,
                          const FrameOptions& options = {}) {
  EXPECT_THAT([&] { load_frame(path, options); },
              ThrowsMessage<InputError>(AllOf(HasSubstr(path.string()), HasSubstr(text))));
}

TEST(FrameFile, SixteenBitValuesComeBackAsTheyWere) {
  const testing::TemporaryFolder folder;
  const RawFrame frame = ramp(255, 257, 1.0);  // every 16-bit value up to 65534, odd sizes
  for (const std::string ending : kIntegerEndings) {
    const auto path = folder / ("a" + ending);
    save_frame(path, frame, {false, SampleType::kUint16});
    const FrameInfo info = load_frame_info(path);
    EXPECT_EQ(info.frame.dn.values(), frame.dn.values()) << ending;
    EXPECT_EQ(info.frame.bits, 16) << ending;
    EXPECT_EQ(info.sample, "uint16") << ending;
  }
}

TEST(FrameFile, EightBitValuesComeBackAsTheyWere) {
  const testing::TemporaryFolder folder;
  const RawFrame frame = ramp(16, 16, 1.0);
  for (const std::string ending : kIntegerEndings) {
    save_frame(folder / ("a" + ending), frame, {false, SampleType::kUint8});
    const RawFrame back = load_frame(folder / ("a" + ending));
    EXPECT_EQ(back.dn.values(), frame.dn.values()) << ending;
    EXPECT_EQ(back.bits, 8) << ending;
  }
}

TEST(FrameFile, FloatsKeepSignNanAndInfinity) {
  const testing::TemporaryFolder folder;
  RawFrame frame = ramp(9, 7, -0.3);
  frame.dn(0, 0) = std::numeric_limits<float>::quiet_NaN();
  frame.dn(0, 1) = std::numeric_limits<float>::infinity();
  frame.dn(0, 2) = 1e-30f;
  for (const std::string ending : kFloatEndings) {
    save_frame(folder / ("a" + ending), frame);
    const RawFrame back = load_frame(folder / ("a" + ending));
    EXPECT_TRUE(std::isnan(back.dn(0, 0))) << ending;
    for (std::size_t i = 1; i < frame.dn.size(); ++i)
      ASSERT_EQ(back.dn.values()[i], frame.dn.values()[i]) << ending << " " << i;
    EXPECT_EQ(back.bits, 0);
  }
}

TEST(FrameFile, FactsTravelInTheFile) {
  const testing::TemporaryFolder folder;
  RawFrame frame = ramp(8, 8, 1.0);
  const auto check = [&](const std::string& ending, SampleType type) {
    const auto path = folder / ("b" + ending);
    save_frame(path, frame, {true, type});
    for (const RawFrame& back : {load_frame(path), probe_frame(path).frame}) {
      EXPECT_EQ(back.layout, frame.layout) << ending;
      EXPECT_EQ(back.black_dn, frame.black_dn) << ending;
      EXPECT_EQ(back.white_dn, frame.white_dn) << ending;
      EXPECT_EQ(back.gain, frame.gain) << ending;
      EXPECT_EQ(back.exposure_s, frame.exposure_s) << ending;
      EXPECT_TRUE(back.layout_known && back.black_known && back.white_known) << ending;
    }
  };
  check(".tif", SampleType::kFloat);
  check(".tif", SampleType::kUint16);
  check(".png", SampleType::kUint16);
  check(".exr", SampleType::kFloat);
  check(".fits", SampleType::kUint16);
  frame.layout = SensorLayout::from_sites({{"0", "45"}, {"135", "90"}});  // mirror-handed
  frame.black_dn = {1, 2, 3, 4.5};
  frame.gain = {std::nullopt, 800.0};
  check(".tif", SampleType::kFloat);
  check(".png", SampleType::kUint8);
}

TEST(FrameFile, DefaultsAreFlaggedAsAssumed) {
  const testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(4, 4, 7.0f));
  const RawFrame frame = load_frame(folder / "a.png");
  EXPECT_EQ(frame.layout.name(), "mono");
  EXPECT_EQ(frame.black_dn, std::vector<double>{0.0});
  EXPECT_EQ(frame.white_dn, 65535);
  EXPECT_FALSE(frame.layout_known || frame.black_known || frame.white_known);
  save_picture(folder / "b.tif", Image(4, 4, 7.5f));
  EXPECT_EQ(load_frame(folder / "b.tif").white_dn, 7.5);
}

TEST(FrameFile, OptionsWinOverTheFile) {
  const testing::TemporaryFolder folder;
  save_frame(folder / "a.tif", ramp(8, 8, 1.0));
  FrameOptions options;
  options.layout = SensorLayout::named("polar-mono");
  options.black_dn = {5};
  options.white_dn = 255;
  options.gain.iso = 100;
  options.exposure_s = 2;
  const RawFrame frame = load_frame(folder / "a.tif", options);
  EXPECT_EQ(frame.layout.name(), "polar-mono");
  EXPECT_EQ(frame.black_dn, (std::vector<double>{5, 5, 5, 5}));
  EXPECT_EQ(frame.white_dn, 255);
  EXPECT_EQ(frame.gain.text(), "ISO 100");
  EXPECT_EQ(frame.exposure_s, 2.0);
  EXPECT_EQ(frame.file_layout, "polar-bayer-rggb");
  // The file's sixteen black levels do not fit into four places, and are not dropped silently.
  options.black_dn.clear();
  expect_frame_refused(folder / "a.tif", "tells 16 black levels for its layout polar-bayer-rggb",
                       options);
}

TEST(FrameFile, BlackKeepsItsPlaceInTheCellOfADeclaredLayout) {
  const testing::TemporaryFolder folder;
  RawFrame frame = ramp(8, 8, 1.0);
  frame.layout = SensorLayout::named("bayer-grbg");
  frame.black_dn = {60, 61, 62, 63};
  save_frame(folder / "a.tif", frame);
  FrameOptions options;
  for (const char* name : {"bayer-rggb", "polar-mono"}) {
    options.layout = SensorLayout::named(name);
    const RawFrame declared = load_frame(folder / "a.tif", options);
    EXPECT_TRUE(declared.black_known);
    EXPECT_EQ(declared.black_dn, frame.black_dn);
    EXPECT_EQ(declared.file_layout, "bayer-grbg");
  }
  options.layout = SensorLayout::named("polar-bayer-rggb");
  const RawFrame larger = load_frame(folder / "a.tif", options);
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) EXPECT_EQ(larger.black_at(r, c), frame.black_at(r, c));
  options.layout = SensorLayout::named("mono");
  expect_frame_refused(folder / "a.tif", "which mono has no place for", options);
  frame.black_dn.assign(4, 64.5);
  save_frame(folder / "b.tif", frame);
  EXPECT_EQ(load_frame(folder / "b.tif", options).black_dn, std::vector<double>{64.5});
  options.layout = frame.layout;
  EXPECT_EQ(load_frame(folder / "b.tif", options).file_layout, "");
}

TEST(FrameFile, HeaderlessNeedsItsSizeAndExactlyItsBytes) {
  const testing::TemporaryFolder folder;
  const auto path = folder / "a.raw";
  write_file(path, std::string({'\x23', '\xC1', '\xAB'}), false);
  FrameOptions options;
  options.raw_format = RawFormat::kMono12p;
  expect_frame_refused(path, "needs its size", options);
  options.rows = 2;
  options.cols = 2;
  expect_frame_refused(path, "it has 3 bytes, 2x2 pixels of mono12p need 6", options);
  options.rows = 1;
  const FrameInfo info = load_frame_info(path, options);
  EXPECT_EQ(info.frame.dn.values(), (std::vector<float>{0x123, 0xABC}));
  EXPECT_EQ(info.frame.bits, 12);
  EXPECT_EQ(info.frame.white_dn, 4095);
  EXPECT_EQ(info.format, "mono12p");
}

TEST(FrameFile, BadFilesAreRefusedInOneLine) {
  const testing::TemporaryFolder folder;
  expect_frame_refused(folder / "none.png", "does not exist");
  expect_frame_refused(folder.path(), "is a folder");
  write_file(folder / "empty.tif", "", false);
  expect_frame_refused(folder / "empty.tif", "the file is empty");
  write_file(folder / "text.png", "hello, this is no picture at all", false);
  expect_frame_refused(folder / "text.png", "is not a picture of a known type");
  write_file(folder / "tiny", "x", false);
  expect_frame_refused(folder / "tiny", "is not a picture of a known type");
  write_file(folder / "ascii.pgm", "P2\n2 1\n255\n7 9\n", false);
  expect_frame_refused(folder / "ascii.pgm", "written in digits (ASCII, P2)");
  expect_frame_refused(folder / "ascii.pgm", "convert it to binary PGM (P5)");
  write_file(folder / "a.pam", "P7\nWIDTH 2\nHEIGHT 1\n", false);
  expect_frame_refused(folder / "a.pam", "of kind P7");
  write_file(folder / "P2 is no magic.tif", "P2P is a word", false);
  expect_frame_refused(folder / "P2 is no magic.tif", "is not a picture of a known type");
  save_picture(folder / "rgb.png", Planes(3, 4, 4), {});
  expect_frame_refused(folder / "rgb.png", "3 channels, a raw mosaic has one");
  save_picture(folder / "stack.npy", Planes(5, 6, 7), {});
  expect_frame_refused(folder / "stack.npy", "it holds 5 frames; name one of them");
  save_picture(folder / "ok.png", Image(4, 6));
  FrameOptions options;
  options.rows = 6;
  options.cols = 4;
  expect_frame_refused(folder / "ok.png", "it is 6x4 pixels, 4x6 were declared", options);
}

TEST(FrameFile, LevelsThatMakeNoSenseAreRefused) {
  const testing::TemporaryFolder folder;
  save_picture(folder / "a.png", Image(4, 4));
  FrameOptions options;
  options.black_dn = {100};
  options.white_dn = 100;
  expect_frame_refused(folder / "a.png", "black 100 DN is not below white 100 DN", options);
  options.white_dn.reset();
  options.black_dn = {70000};
  expect_frame_refused(folder / "a.png", "not below white 65535 DN", options);
  options.black_dn = {1, 2, 3};
  expect_frame_refused(folder / "a.png", "3 black levels for the 1 channel of", options);
  options.black_dn = {std::nan("")};
  expect_frame_refused(folder / "a.png", "not below white", options);
}

// Whatever is cut off, the answer is an InputError: never a crash, never silently missing pixels.
TEST(FrameFile, TruncatedFilesOfEveryFormatAreRefused) {
  const testing::TemporaryFolder folder;
  const RawFrame frame = ramp(64, 48, 1.7);
  for (const std::string ending : {".tif", ".png", ".exr", ".fits", ".npy"}) {
    const auto whole = folder / ("whole" + ending), cut = folder / ("cut" + ending);
    save_frame(whole, frame, {false, ending == ".exr" ? SampleType::kFloat : SampleType::kUint16});
    std::ifstream in(whole, std::ios::binary);
    const std::string content{std::istreambuf_iterator<char>(in), {}};
    // FITS pads its last block: only the pixels count.
    const std::size_t used = ending == ".fits" ? content.size() - 2880 : content.size();
    for (int part = 1; part < 20; ++part) {
      write_file(cut, content.substr(0, used * static_cast<std::size_t>(part) / 20), true);
      EXPECT_THROW(load_frame(cut), InputError) << ending << " " << part << "/20";
    }
  }
}

TEST(FrameFile, DamagedHeadersNeverCrash) {
  const testing::TemporaryFolder folder;
  const RawFrame frame = ramp(24, 20, 1.0);
  for (const std::string ending : {".tif", ".png", ".exr", ".fits", ".npy"}) {
    const auto whole = folder / ("whole" + ending), bad = folder / ("bad" + ending);
    save_frame(whole, frame, {false, ending == ".exr" ? SampleType::kFloat : SampleType::kUint16});
    std::ifstream in(whole, std::ios::binary);
    const std::string content{std::istreambuf_iterator<char>(in), {}};
    for (std::size_t at = 0; at < std::min<std::size_t>(content.size(), 160); ++at) {
      std::string damaged = content;
      damaged[at] = static_cast<char>(damaged[at] ^ 0xff);
      write_file(bad, damaged, true);
      try {
        const RawFrame read = load_frame(bad);
        EXPECT_LE(read.dn.size(), std::size_t{1} << 22) << ending << " " << at;
      } catch (const InputError&) {
        // the expected answer to most of them
      }
    }
  }
}

TEST(FrameFile, RealFramesAreReadAsPublished) {
  MALUS_NEEDS_SHARED("polar-mono-raw/camera.png");
  const FrameInfo info = load_frame_info(testing::shared_data() / "polar-mono-raw" / "camera.png");
  EXPECT_EQ(info.rows, 2048);
  EXPECT_EQ(info.cols, 2448);
  EXPECT_EQ(info.frame.bits, 8);
  MALUS_NEEDS_SHARED("emva001/images/d_s_000_snap_000.png");
  const RawFrame dark =
      load_frame(testing::shared_data() / "emva001" / "images" / "d_s_000_snap_000.png");
  double sum = 0;
  for (const float value : dark.dn.values()) sum += static_cast<double>(value);
  EXPECT_NEAR(sum / static_cast<double>(dark.dn.size()), 14.76, 0.5);  // data/SOURCES.md
}

TEST(FrameSize, WidthComesFirst) {
  EXPECT_EQ(parse_frame_size("2448x2048"), std::make_pair(2048, 2448));
  for (const char* bad : {"", "x", "3x", "x4", "3x4 ", "3,4", "0x4", "3x-1", "3x4x5", "9999999x2"})
    EXPECT_THROW(parse_frame_size(bad), InputError) << bad;
}

}  // namespace
}  // namespace malus
