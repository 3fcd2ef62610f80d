// What other programs' EXR files hold: OpenEXR writes them here by itself.
#include "malus/base/error.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/picture_file.h"

#include <fstream>
#include <string>
#include <vector>

#include "support.h"
#include <OpenEXR/ImfArray.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfMultiPartOutputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfOutputPart.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStringVectorAttribute.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr int kExrCols = 9, kExrRows = 5;

// One value per pixel and channel, the same in all tests.
std::vector<float> values_of(int channel) {
  std::vector<float> values;
  for (int i = 0; i < kExrRows * kExrCols; ++i)
    values.push_back(static_cast<float>(100 * channel + i));
  return values;
}

Imf::Header header_of(const Imath::Box2i& window, const std::vector<std::string>& names,
                      Imf::PixelType type = Imf::FLOAT) {
  Imf::Header header(window, window);
  for (const std::string& name : names) header.channels().insert(name, Imf::Channel(type));
  return header;
}

TEST(ExrKinds, AnyWindowCompressionAndTilesGiveThePixels) {
  const testing::TemporaryFolder folder;
  const std::vector<std::string> names = {"B", "G", "R", "A", "depth"};
  std::vector<std::vector<float>> values;
  for (int k = 0; k < 5; ++k) values.push_back(values_of(k));
  for (const Imath::V2i& corner : {Imath::V2i(0, 0), Imath::V2i(-7, 300)})
    for (const Imf::Compression compression :
         {Imf::NO_COMPRESSION, Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION})
      for (const bool tiled : {false, true}) {
        const Imath::Box2i window(corner, corner + Imath::V2i(kExrCols - 1, kExrRows - 1));
        Imf::Header header = header_of(window, names);
        header.compression() = compression;
        Imf::FrameBuffer buffer;
        for (std::size_t k = 0; k < names.size(); ++k)
          buffer.insert(names[k], Imf::Slice::Make(Imf::FLOAT, values[k].data(), window));
        const std::string path = (folder / "a.exr").string();
        if (tiled) {
          header.setTileDescription(Imf::TileDescription(4, 4));
          Imf::TiledOutputFile file(path.c_str(), header);
          file.setFrameBuffer(buffer);
          file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
        } else {
          Imf::OutputFile file(path.c_str(), header);
          file.setFrameBuffer(buffer);
          file.writePixels(kExrRows);
        }
        const Picture picture = load_picture(path);
        ASSERT_THAT(picture.names, ElementsAre("R", "G", "B", "A", "depth"));
        const int stored[] = {2, 1, 0, 3, 4};
        for (int k = 0; k < 5; ++k)
          EXPECT_EQ(picture.planes[k].values(), values_of(stored[k])) << compression << tiled << k;
      }
}

TEST(ExrKinds, ChannelsComeInTheirUsualOrder) {
  const testing::TemporaryFolder folder;
  const std::vector<std::vector<std::string>> usual = {
      {"R", "G", "B", "A", "Z"}, {"X", "Y", "Z"}, {"Y", "A"}, {"C00", "C01", "C02"}};
  SaveOptions forced;
  forced.force = true;
  for (const std::vector<std::string>& names : usual) {
    Planes planes(static_cast<int>(names.size()), 2, 3);
    for (int k = 0; k < planes.channels(); ++k)
      for (float& value : planes[k].values()) value = static_cast<float>(k);
    save_picture(folder / "a.exr", planes, names, forced);
    const Picture back = load_picture(folder / "a.exr");
    EXPECT_EQ(back.names, names);
    for (int k = 0; k < planes.channels(); ++k)
      EXPECT_EQ(back.planes[k].values(), planes[k].values());
  }
}

TEST(ExrKinds, WhatIsNoOnePictureOfFloatsIsRefused) {
  const testing::TemporaryFolder folder;
  const Imath::Box2i window(Imath::V2i(0, 0), Imath::V2i(kExrCols - 1, kExrRows - 1));
  const auto refused = [&](const char* name, const std::string& why) {
    EXPECT_THAT([&] { load_picture(folder / name); }, ThrowsMessage<InputError>(HasSubstr(why)));
  };
  {
    std::vector<unsigned> numbers(kExrRows * kExrCols, 3);
    Imf::OutputFile file((folder / "uint.exr").c_str(), header_of(window, {"id"}, Imf::UINT));
    Imf::FrameBuffer buffer;
    buffer.insert("id", Imf::Slice::Make(Imf::UINT, numbers.data(), window));
    file.setFrameBuffer(buffer);
    file.writePixels(kExrRows);
  }
  refused("uint.exr", "uint32 channels are not read; store half or float");
  {
    std::vector<Imf::Header> headers;
    for (const char* name : {"left", "right"}) {
      headers.push_back(header_of(window, {"Y"}));
      headers.back().setName(name);
      headers.back().setType(Imf::SCANLINEIMAGE);
    }
    Imf::MultiPartOutputFile file((folder / "parts.exr").c_str(), headers.data(), 2);
    std::vector<float> values = values_of(0);
    for (int part = 0; part < 2; ++part) {
      Imf::OutputPart output(file, part);
      Imf::FrameBuffer buffer;
      buffer.insert("Y", Imf::Slice::Make(Imf::FLOAT, values.data(), window));
      output.setFrameBuffer(buffer);
      output.writePixels(kExrRows);
    }
  }
  refused("parts.exr", "several pictures");
  {
    Imf::Header header(8, 4);
    header.channels().insert("RY", Imf::Channel(Imf::FLOAT, 2, 2));
    std::vector<float> values(8);
    Imf::OutputFile file((folder / "few.exr").c_str(), header);
    Imf::FrameBuffer buffer;
    buffer.insert("RY", Imf::Slice(Imf::FLOAT, reinterpret_cast<char*>(values.data()),
                                   sizeof(float), 4 * sizeof(float), 2, 2));
    file.setFrameBuffer(buffer);
    file.writePixels(4);
  }
  refused("few.exr", "the channel RY has fewer pixels");
}

// OpenEXR takes memory for a text of any length before it finds the file to end.
TEST(ExrKinds, LengthsBeyondTheFileAreRefusedBeforeMemoryIsTaken) {
  const testing::TemporaryFolder folder;
  save_picture(folder / "a.exr", Image(2, 3, 1.0f));
  const std::string bytes = internal::read_text(folder / "a.exr", "a picture");
  constexpr std::size_t kHead = 8;  // magic number and version
  const std::string beyond("\xf0\xff\xff\x7f", 4), inside("\x0a\0\0\0", 4), one("\x02\0\0\0ab", 6);
  for (const std::string& attribute :
       {"t" + std::string("\0string\0", 8) + beyond,
        "t" + std::string("\0stringvector\0", 14) + inside + one + beyond}) {
    std::ofstream(folder / "b.exr", std::ios::binary)
        << bytes.substr(0, kHead) << attribute << bytes.substr(kHead);
    EXPECT_THAT([&] { load_picture(folder / "b.exr"); },
                ThrowsMessage<InputError>(HasSubstr("it ends inside its header")));
  }
  // One that is as long as it says.
  const Imath::Box2i window(Imath::V2i(0, 0), Imath::V2i(kExrCols - 1, kExrRows - 1));
  Imf::Header header = header_of(window, {"Y"});
  header.insert("t", Imf::StringVectorAttribute({"ab", "", "cde"}));
  {
    std::vector<float> values = values_of(0);
    Imf::OutputFile file((folder / "c.exr").c_str(), header);
    Imf::FrameBuffer buffer;
    buffer.insert("Y", Imf::Slice::Make(Imf::FLOAT, values.data(), window));
    file.setFrameBuffer(buffer);
    file.writePixels(kExrRows);
  }
  EXPECT_EQ(load_picture(folder / "c.exr").planes[0].values(), values_of(0));
}

}  // namespace
}  // namespace malus
