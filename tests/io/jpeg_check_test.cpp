#include "malus/io/internal/jpeg_check.h"

#include "malus/base/error.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"

#include <fstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus::internal {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

std::filesystem::path seed(const char* name) {
  return std::filesystem::path(MALUS_SOURCE_DIR) / "fuzz/corpus/jpeg_check" / name;
}

void write_bytes(const std::filesystem::path& path, Bytes bytes) {
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
}

TEST(JpegCheck, TellsTheDeclaredSize) {
  for (const auto& [name, channels] : {std::pair{"grey.jpg", 1}, {"rgb_progressive.jpg", 3}}) {
    const JpegSize size = check_jpeg(read_bytes(seed(name)), name);
    EXPECT_EQ(size.rows, 20) << name;
    EXPECT_EQ(size.cols, 28) << name;
    EXPECT_EQ(size.channels, channels) << name;
  }
}

TEST(JpegCheck, AnyCutIsFound) {
  for (const char* name : {"grey.jpg", "rgb_progressive.jpg"}) {
    const auto good = read_bytes(seed(name));
    for (std::size_t length = 0; length < good.size(); ++length)
      EXPECT_THROW(check_jpeg(Bytes(good).first(length), "a.jpg"), InputError) << length;
    auto longer = good;
    longer.insert(longer.end(), 100, 7);  // phones append a film
    EXPECT_NO_THROW(check_jpeg(longer, "a.jpg"));
  }
}

TEST(JpegCheck, EndlessScansAreRefused) {
  const auto good = read_bytes(seed("rgb_progressive.jpg"));
  const std::uint8_t scan[] = {0xff, 0xda, 0, 8, 1, 1, 0, 0, 0, 0};
  auto many = good;
  many.resize(good.size() - 2);
  for (int i = 0; i < 300; ++i) many.insert(many.end(), std::begin(scan), std::end(scan));
  many.insert(many.end(), {0xff, 0xd9});
  EXPECT_THAT([&] { check_jpeg(many, "a.jpg"); },
              ThrowsMessage<InputError>(HasSubstr("more than 200 scans")));
}

TEST(JpegPicture, IsCleanMaterialAndNothingElse) {
  const Picture picture = load_clean_picture(seed("rgb_progressive.jpg"));
  EXPECT_THAT(picture.names, ElementsAre("R", "G", "B"));
  EXPECT_EQ(picture.bits, 8);
  EXPECT_EQ(picture.white, 255);
  for (int r = 0; r < 20; ++r)
    for (int c = 0; c < 28; ++c) {
      EXPECT_NEAR(picture.planes[0](r, c), 40 + 6 * r + 2 * c, 12);
      EXPECT_NEAR(picture.planes[1](r, c), 215 - 6 * r - 2 * c, 12);
      EXPECT_NEAR(picture.planes[2](r, c), 90, 12);
    }
  EXPECT_THAT(load_clean_picture(seed("grey.jpg")).names, ElementsAre("Y"));
  EXPECT_THROW(load_picture(seed("grey.jpg")), InputError);
  EXPECT_THAT([] { load_frame(seed("grey.jpg")); },
              ThrowsMessage<InputError>(HasSubstr("is a JPEG picture, which holds no raw values")));
  // By whatever name: the first bytes decide.
  const testing::TemporaryFolder folder;
  for (const char* name : {"a.png", "a.tif", "a.dng"}) {
    std::filesystem::copy_file(seed("grey.jpg"), folder / name);
    EXPECT_THROW(load_frame(folder / name), InputError) << name;
    EXPECT_THROW(load_picture(folder / name), InputError) << name;
  }
}

TEST(JpegPicture, DamageIsSaid) {
  EXPECT_THAT([] { load_clean_picture(seed("bad_truncated.jpg")); },
              ThrowsMessage<InputError>(HasSubstr("ends before its end marker")));
  EXPECT_THAT([] { load_clean_picture(seed("huge.jpg")); },
              ThrowsMessage<InputError>(HasSubstr("cannot hold the 40000x40000 pixels")));
  EXPECT_THAT([] { load_clean_picture(seed("bad_cmyk.jpg")); },
              ThrowsMessage<InputError>(HasSubstr("has 4 channels, not 1 or 3")));
  // Whole to the eye, with coded pixels that break off: decoders fill up with grey.
  const testing::TemporaryFolder folder;
  for (const char* name : {"grey.jpg", "rgb_progressive.jpg"}) {
    auto bytes = read_bytes(seed(name));
    bytes.resize(bytes.size() - 12);
    bytes.insert(bytes.end(), {0xff, 0xd9});
    write_bytes(folder / name, bytes);
    EXPECT_THAT([&] { load_clean_picture(folder / name); },
                ThrowsMessage<InputError>(HasSubstr("cannot be decoded")))
        << name;
  }
}

}  // namespace
}  // namespace malus::internal
