#include "malus/io/picture_file.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <cmath>
#include <ctime>
#include <fstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

Planes numbered(int channels, int rows, int cols) {
  Planes planes(channels, rows, cols);
  float next = 0;
  for (Image& plane : planes)
    for (float& value : plane.values()) value = next++;
  return planes;
}

void expect_same(const Planes& a, const Planes& b, const std::string& what) {
  ASSERT_EQ(a.channels(), b.channels()) << what;
  for (int k = 0; k < a.channels(); ++k) EXPECT_EQ(a[k].values(), b[k].values()) << what << k;
}

TEST(PictureFile, ChannelsAndNamesComeBack) {
  const testing::TemporaryFolder folder;
  const Planes planes = numbered(3, 5, 7);
  for (const std::string ending : {".exr", ".tif", ".fits", ".npy"}) {
    save_picture(folder / ("a" + ending), planes, {});
    expect_same(load_picture(folder / ("a" + ending)).planes, planes, ending);
  }
  save_picture(folder / "a.png", planes, {}, {false, SampleType::kUint8});
  const Picture png = load_picture(folder / "a.png");
  expect_same(png.planes, planes, "png");
  EXPECT_EQ(png.white, 255);
  EXPECT_THAT(png.names, ElementsAre("R", "G", "B"));
}

TEST(PictureFile, SixteenNamedPlanesInOneExr) {
  const testing::TemporaryFolder folder;
  const auto names = SensorLayout::named("polar-bayer-rggb").channel_names();
  const Planes planes = numbered(16, 4, 3);
  save_picture(folder / "a.exr", planes, names);
  const Picture back = load_picture(folder / "a.exr");
  // EXR keeps channels by name, not in order.
  ASSERT_EQ(back.names.size(), 16u);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto found = std::find(back.names.begin(), back.names.end(), names[i]);
    ASSERT_NE(found, back.names.end()) << names[i];
    EXPECT_EQ(back.planes[static_cast<int>(found - back.names.begin())].values(),
              planes[static_cast<int>(i)].values());
  }
}

TEST(PictureFile, WhatThePlanesHoldIsKept) {
  const testing::TemporaryFolder folder;
  SaveOptions save;
  for (const std::string ending : {".exr", ".tif", ".fits"}) {
    save.holds.clear();
    save_picture(folder / ("plain" + ending), numbered(4, 4, 3), {}, save);
    EXPECT_EQ(load_picture(folder / ("plain" + ending)).holds, "") << ending;
    save.holds = kHoldsVariance;
    save_picture(folder / ("a" + ending), numbered(4, 4, 3), {}, save);
    EXPECT_EQ(load_picture(folder / ("a" + ending)).holds, kHoldsVariance) << ending;
  }
}

TEST(PictureFile, AlphaDoesNotTouchTheColours) {
  const testing::TemporaryFolder folder;
  Planes planes(4, 1, 1);
  for (int k = 0; k < 3; ++k) planes[k](0, 0) = static_cast<float>(100 + k);
  planes[3](0, 0) = 51;
  for (const std::string ending : {".png", ".tif"}) {
    save_picture(folder / ("a" + ending), planes, {}, {false, SampleType::kUint8});
    expect_same(load_picture(folder / ("a" + ending)).planes, planes, ending);
  }
}

TEST(PictureFile, IntegersRoundToNearestAndStayInRange) {
  const testing::TemporaryFolder folder;
  Image image(1, 6);
  image.values() = {-3.0f, 0.5f, 1.5f, 254.6f, 300.0f, std::nanf("")};
  for (const std::string ending : {".png", ".tif", ".fits", ".npy"}) {
    save_picture(folder / ("a" + ending), image, {false, SampleType::kUint8});
    EXPECT_THAT(load_picture(folder / ("a" + ending)).planes[0].values(),
                ElementsAre(0, 0, 2, 255, 255, 0))
        << ending;
  }
}

TEST(PictureFile, HalfKeepsElevenBits) {
  const testing::TemporaryFolder folder;
  Image image(1, 3);
  image.values() = {2047.0f, 2049.0f, -0.333251953125f};
  save_picture(folder / "a.exr", image, {false, SampleType::kHalf});
  EXPECT_THAT(load_picture(folder / "a.exr").planes[0].values(),
              ElementsAre(2047, 2048, -0.333251953125f));
}

TEST(PictureFile, WhatAFormatCannotHoldIsRefused) {
  const testing::TemporaryFolder folder;
  const auto refused = [&](const std::string& name, const Planes& planes, SampleType type,
                           const std::string& text) {
    EXPECT_THAT(
        [&] {
          save_picture(folder / name, planes, {}, {false, type});
        },
        ThrowsMessage<InputError>(HasSubstr(text)));
    EXPECT_FALSE(std::filesystem::exists(folder / name));
  };
  refused("a.png", Planes(1, 2, 2), SampleType::kFloat, "PNG holds no floating-point");
  refused("a.png", Planes(5, 2, 2), SampleType::kUint8, "up to 4 channels, not 5");
  refused("a.exr", Planes(1, 2, 2), SampleType::kUint16, "EXR holds no 8 or 16 bit");
  refused("a.tif", Planes(1, 2, 2), SampleType::kHalf, "EXR only");
  refused("a.bmp", Planes(1, 2, 2), SampleType::kUint8, "\".bmp\" cannot be written");
}

TEST(PictureFile, ExistingOutputsNeedForce) {
  const testing::TemporaryFolder folder;
  for (const std::string ending : {".png", ".tif", ".exr", ".fits", ".npy"}) {
    const auto path = folder / ("a" + ending);
    save_picture(path, Image(2, 2, 1.0f));
    EXPECT_THAT([&] { save_picture(path, Image(2, 2, 2.0f)); },
                ThrowsMessage<InputError>(HasSubstr("use force true")));
    EXPECT_EQ(load_picture(path).planes[0](0, 0), 1.0f);
    SaveOptions options;
    options.force = true;
    save_picture(path, Image(2, 2, 2.0f), options);
    EXPECT_EQ(load_picture(path).planes[0](0, 0), 2.0f);
  }
}

// Reproducible runs compare files, not pictures: no time stamps.
TEST(PictureFile, TheSamePictureGivesTheSameBytes) {
  const testing::TemporaryFolder folder;
  const Planes planes = numbered(3, 40, 30);
  const auto bytes = [&](const std::string& name) {
    std::ifstream in(folder / name, std::ios::binary);
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  const std::time_t now = std::time(nullptr);
  const std::string year = std::to_string(std::localtime(&now)->tm_year + 1900);
  for (const std::string ending : {".tif", ".exr", ".fits", ".npy", ".png"}) {
    for (const char* name : {"a", "b"})
      save_picture(folder / (name + ending), planes, {},
                   {false, ending == ".png" ? SampleType::kUint16 : SampleType::kFloat});
    EXPECT_TRUE(bytes("a" + ending) == bytes("b" + ending)) << ending;
    for (const std::string& date : {year + ":", year + "-", std::string("tIME")})
      EXPECT_EQ(bytes("a" + ending).find(date), std::string::npos) << ending;
  }
}

// Of light without noise too: whatever else reads them need not undo anything.
TEST(PictureFile, FloatsOfTiffAndExrLieInTheFileAsTheyAre) {
  const testing::TemporaryFolder folder;
  for (const char* name : {"even.tif", "even.exr"}) {
    save_picture(folder / name, Image(64, 64, 1.0f), {});
    EXPECT_GE(std::filesystem::file_size(folder / name), 64 * 64 * sizeof(float)) << name;
  }
}

// /dev/full takes every open and fails every write.
TEST(PictureFile, AFullDiskIsSaidAndLeavesNothing) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "needs /dev/full";
  const testing::TemporaryFolder folder;
  for (const std::string ending : {".png", ".tif", ".exr", ".fits", ".npy"}) {
    const auto path = folder / ("full" + ending);
    std::filesystem::create_symlink("/dev/full", path);
    SaveOptions options;
    options.force = true;
    EXPECT_THAT([&] { save_picture(path, Image(200, 200, 1.0f), options); },
                ThrowsMessage<InputError>(HasSubstr("cannot be written")))
        << ending;
  }
}

TEST(PictureFile, GraphicsPicturesAreRead) {
  MALUS_NEEDS_SHARED("exr/Desk.exr");
  const Picture desk = load_picture(testing::shared_data() / "exr" / "Desk.exr");
  EXPECT_EQ(desk.planes.rows(), 874);
  EXPECT_EQ(desk.planes.cols(), 644);
  EXPECT_THAT(desk.names, ElementsAre("R", "G", "B", "A"));
  EXPECT_EQ(desk.bits, 0);
}

}  // namespace
}  // namespace malus
