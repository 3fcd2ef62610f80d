#include "malus/io/frame_stack.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"

#include <chrono>
#include <fstream>

#include "support.h"
#include "tiff_directory.h"
#include "tiff_stack.h"
#include <fmt/format.h>
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;
using testing::TiffPage;
using testing::TiffStack;
namespace fs = std::filesystem;

constexpr int kFrames = 5;

std::vector<TiffPage> pages_of_frames(bool deflate = false) {
  std::vector<TiffPage> pages;
  for (int k = 0; k < kFrames; ++k)
    pages.push_back({.first_value = static_cast<std::uint16_t>(1000 * k), .deflate = deflate});
  return pages;
}

Image frame_of_page(int k, int rows = 4, int cols = 6) {
  Image dn(rows, cols);
  for (std::size_t i = 0; i < dn.size(); ++i)
    dn.values()[i] = static_cast<float>(1000 * k) + static_cast<float>(i);
  return dn;
}

// Stacks of the same frames.
std::vector<fs::path> write_stacks(const testing::TemporaryFolder& folder) {
  write_file(folder / "plain.tif", TiffStack(pages_of_frames()).bytes(), false);
  write_file(folder / "deflate.tiff", TiffStack(pages_of_frames(true)).bytes(), false);
  write_file(folder / "big.tif", TiffStack(pages_of_frames(), true).bytes(), false);
  Planes planes(kFrames, 4, 6);
  for (int k = 0; k < kFrames; ++k) planes[k] = frame_of_page(k);
  for (const char* name : {"cube.npy", "cube.fits"})
    save_picture(folder / name, planes, {}, {.type = SampleType::kUint16});
  return {folder / "plain.tif", folder / "deflate.tiff", folder / "big.tif", folder / "cube.npy",
          folder / "cube.fits"};
}

void expect_stack_refused(const fs::path& path, const std::string& text) {
  EXPECT_THAT([&] { count_frames(path); },
              ThrowsMessage<InputError>(AllOf(HasSubstr(path.string()), HasSubstr(text))));
  EXPECT_THAT([&] { load_frame(path); }, ThrowsMessage<InputError>(HasSubstr(text)));
  EXPECT_THAT([&] { load_frame(frame_name(path, 0)); }, ThrowsMessage<InputError>(HasSubstr(text)));
}

TEST(FrameStack, EveryFrameIsReadByItsName) {
  const testing::TemporaryFolder folder;
  for (const fs::path& path : write_stacks(folder)) {
    EXPECT_EQ(count_frames(path), kFrames) << path;
    const auto names = frame_names(path);
    ASSERT_EQ(names.size(), static_cast<std::size_t>(kFrames)) << path;
    for (const int k : {4, 0, 2, 3, 1}) {
      const fs::path& name = names[static_cast<std::size_t>(k)];
      EXPECT_EQ(name, path.string() + fmt::format("[{}]", k));
      const FrameInfo info = load_frame_info(name);
      EXPECT_EQ(info.frame.dn.values(), frame_of_page(k).values()) << name;
      EXPECT_EQ(info.frame.source, name.string());
      EXPECT_EQ(info.frame.bits, 16) << name;
      EXPECT_EQ(info.frames_in_file, kFrames);
      const FrameInfo probed = probe_frame(name);
      EXPECT_EQ(probed.rows, 4) << name;
      EXPECT_EQ(probed.cols, 6) << name;
      EXPECT_EQ(load_picture(name).planes[0].values(), frame_of_page(k).values()) << name;
      EXPECT_THAT(frame_names(name), ElementsAre(name));
    }
  }
}

TEST(FrameStack, AFrameHasToBeNamedAndToBeThere) {
  const testing::TemporaryFolder folder;
  for (const fs::path& path : write_stacks(folder)) {
    const std::string refusal =
        path.string() + fmt::format(": it holds 5 frames; name one of them, from {0}[0] to {0}[4]",
                                    path.filename().string());
    EXPECT_THAT([&] { load_frame(path); }, ThrowsMessage<InputError>(refusal));
    EXPECT_THAT([&] { probe_frame(path); }, ThrowsMessage<InputError>(refusal));
    for (const std::string index : {"[5]", "[99999999999999999999]"})
      EXPECT_THAT([&] { load_frame(path.string() + index); },
                  ThrowsMessage<InputError>(
                      HasSubstr("]: the file holds 5 frames; frames are counted from [0] to [4]")));
    EXPECT_THAT([&] { frame_names(path.string() + "[5]"); },
                ThrowsMessage<InputError>(HasSubstr("the file holds 5 frames")));
    for (const std::string no_index : {"[]", "[-1]", "[1", "[0-9]", "[ 1]"})
      EXPECT_THAT([&] { load_frame(path.string() + no_index); },
                  ThrowsMessage<InputError>(HasSubstr("does not exist")));
  }
}

TEST(FrameStack, AFileOfTheWholeNameIsMeant) {
  const testing::TemporaryFolder folder;
  write_stacks(folder);
  save_picture(folder / "x.npy", frame_of_page(7), {.type = SampleType::kUint16});
  fs::rename(folder / "x.npy", folder / "cube.npy[1]");
  EXPECT_EQ(load_frame(folder / "cube.npy[1]").dn.values(), frame_of_page(7).values());
  EXPECT_EQ(load_frame(folder / "cube.npy[2]").dn.values(), frame_of_page(2).values());
  EXPECT_EQ(load_frame(folder / "cube.npy[1][0]").dn.values(), frame_of_page(7).values());
}

TEST(FrameStack, OneFrameIsNoStack) {
  const testing::TemporaryFolder folder;
  write_file(folder / "one.tif", TiffStack(std::vector<TiffPage>{{.first_value = 1000}}).bytes(),
             false);
  save_picture(folder / "one.png", frame_of_page(1), {.type = SampleType::kUint16});
  std::string cube = "\x93NUMPY\x01";
  const std::string head = "{'descr': '|u1', 'fortran_order': True, 'shape': (1, 2, 3)}";
  cube += '\0';
  cube += {static_cast<char>(head.size()), '\0'};
  write_file(folder / "one.npy", cube + head + "adbecf", false);
  for (const char* name : {"one.tif", "one.png"})
    for (const std::string index : {"", "[0]"})
      EXPECT_EQ(load_frame(folder / (name + index)).dn.values(), frame_of_page(1).values());
  for (const std::string index : {"", "[0]"})
    EXPECT_THAT(load_frame(folder / ("one.npy" + index)).dn.values(),
                ElementsAre('a', 'b', 'c', 'd', 'e', 'f'));
  EXPECT_THAT([&] { load_frame(folder / "one.png[1]"); },
              ThrowsMessage<InputError>(HasSubstr("one.png[1]: the file holds 1 frame")));
  EXPECT_EQ(frame_identity(folder / "one.png[0]"), frame_identity(folder / "one.png"));
}

TEST(FrameStack, ThumbnailsAreNoFrames) {
  const testing::TemporaryFolder folder;
  const TiffPage thumbnail{.rows = 2, .cols = 3, .subfile = 1}, mask{.subfile = 4};
  std::vector<TiffPage> pages;
  for (const TiffPage& page : pages_of_frames()) pages.insert(pages.end(), {thumbnail, page, mask});
  write_file(folder / "a.tif", TiffStack(pages).bytes(), false);
  EXPECT_EQ(count_frames(folder / "a.tif"), kFrames);
  EXPECT_EQ(load_frame(folder / "a.tif[3]").dn.values(), frame_of_page(3).values());
  // A camera's usual file.
  for (const auto& both : {std::vector<TiffPage>{{.first_value = 2000}, thumbnail},
                           {thumbnail, {.first_value = 2000}}}) {
    write_file(folder / "b.tif", TiffStack(both).bytes(), true);
    EXPECT_EQ(load_frame(folder / "b.tif").dn.values(), frame_of_page(2).values());
  }
  write_file(folder / "c.tif", TiffStack(std::vector<TiffPage>{thumbnail}).bytes(), false);
  EXPECT_EQ(load_frame(folder / "c.tif").dn.rows(), 2);
  write_file(folder / "d.tif", TiffStack(std::vector<TiffPage>{thumbnail, thumbnail}).bytes(),
             false);
  expect_stack_refused(folder / "d.tif", "none of its 2 pages is a frame of full size");
}

TEST(FrameStack, FramesOfOneFileAreAlike) {
  const testing::TemporaryFolder folder;
  const auto refused = [&](const TiffPage& other, const std::string& text) {
    auto pages = pages_of_frames();
    pages[3] = other;
    write_file(folder / "a.tif", TiffStack(pages).bytes(), true);
    EXPECT_THAT([&] { count_frames(folder / "a.tif"); },
                ThrowsMessage<InputError>(AllOf(HasSubstr("a.tif[3]: has " + text),
                                                HasSubstr("of its file 6x4 pixels of uint16"))));
    EXPECT_THROW(load_frame(folder / "a.tif[0]"), InputError);
  };
  refused({.rows = 6, .cols = 4}, "4x6 pixels of uint16");
  refused({.cols = 12, .bits = 8}, "12x4 pixels of uint8");
  refused({.photometric = 0}, "6x4 pixels of uint16, 0 is white");
}

TEST(FrameStack, ChainsThatLeadNowhereAreRefused) {
  const testing::TemporaryFolder folder;
  const TiffStack stack(pages_of_frames());
  const fs::path path = folder / "a.tif";
  write_file(path, stack.ending_with(stack.directory_at(2)), true);
  expect_stack_refused(path, "page 5 leads back to an earlier page");
  const TiffStack one(std::vector<TiffPage>{{}});
  write_file(path, one.ending_with(one.directory_at(0)), true);
  expect_stack_refused(path, "page 1 leads back to an earlier page");
  write_file(path, stack.ending_with(stack.bytes().size() + 2), true);
  expect_stack_refused(path, "the TIFF file ends before its page 6");
  for (std::size_t page = 1; page < kFrames; ++page) {
    write_file(path, stack.bytes().substr(0, stack.directory_at(page)), true);
    expect_stack_refused(path, fmt::format("the TIFF file ends before its page {};", page + 1));
    write_file(path, stack.bytes().substr(0, stack.directory_at(page) + 30), true);
    expect_stack_refused(path,
                         fmt::format("the TIFF file ends before its page {}'s end", page + 1));
  }
}

// As it writes stacks of more than 4 GB: the others would be lost without a word.
TEST(FrameStack, ImagesWithoutAPageAreRefused) {
  const testing::TemporaryFolder folder;
  const auto with_description = [&](const std::string& text) {
    testing::TiffDirectory directory;
    directory.longs(256, {2});
    directory.longs(257, {1});
    directory.shorts(258, {8});
    directory.shorts(259, {1});
    directory.shorts(262, {1});
    directory.text(270, text);
    directory.longs(273, {8});
    directory.shorts(277, {1});
    directory.longs(278, {1});
    directory.longs(279, {2});
    write_file(folder / "a.tif", std::string("II*\0\x0c\0\0\0abcd", 12) + directory.write(12),
               true);
    return folder / "a.tif";
  };
  expect_stack_refused(with_description("ImageJ=1.53t\nimages=500\nslices=500\n"),
                       "it holds 500 images of ImageJ, but one page");
  expect_stack_refused(with_description(R"({"truncated": true, "shape": [8, 1, 2]})"),
                       "it holds 8 images of tifffile, but one page");
  // The second: a frame that somebody cut out of a stack.
  for (const char* text : {R"({"shape": [1, 1, 2], "truncated": true})", R"({"shape": [8, 1, 2]})",
                           R"({"truncated": true, "shape": {"a": "b"}})",
                           R"({"truncated": true, "shape": [1e300, 1e300, 0]})", "{", "{}",
                           "ImageJ=1.53t\nimages=1\n", "ImageJ=1.53t\n", "a\nimages=2", "x"})
    EXPECT_EQ(load_frame(with_description(text)).dn.values(), (std::vector<float>{'a', 'b'}));
}

TEST(FrameStack, DamageOfOnePageIsItsOwn) {
  const testing::TemporaryFolder folder;
  const fs::path path = folder / "a.tif";
  const TiffStack deflated(pages_of_frames(true));
  std::string bytes = deflated.bytes();
  char& byte = bytes[deflated.directory_at(2) - 3];  // of the checksum, or before it
  byte = static_cast<char>(byte ^ 0x55);
  write_file(path, bytes, true);
  EXPECT_EQ(load_frame(folder / "a.tif[3]").dn.values(), frame_of_page(3).values());
  EXPECT_THAT([&] { load_frame(folder / "a.tif[2]"); },
              ThrowsMessage<InputError>(AllOf(HasSubstr("a.tif[2]: cannot be decoded"),
                                              HasSubstr("strip 1 of 1 is damaged"))));
  // Pixels that are said to lie behind the file's end.
  const TiffStack plain(pages_of_frames());
  bytes = plain.bytes();
  const std::size_t place_of_strip = plain.directory_at(1) + 2 + 12 * 6 + 8;
  bytes[place_of_strip + 2] = '\x7f';
  write_file(path, bytes, true);
  EXPECT_EQ(load_frame(folder / "a.tif[0]").dn.values(), frame_of_page(0).values());
  EXPECT_THAT([&] { load_frame(folder / "a.tif[1]"); },
              ThrowsMessage<InputError>(HasSubstr("a.tif[1]: cannot be decoded")));
}

TEST(FrameStack, FilesHoldTheFramesThatTheyDeclare) {
  const testing::TemporaryFolder folder;
  write_stacks(folder);
  fs::resize_file(folder / "cube.npy", fs::file_size(folder / "cube.npy") - 1);
  expect_stack_refused(folder / "cube.npy", "needs 240 bytes, 239 are there");
  fs::resize_file(folder / "cube.fits", 2880 + 239);
  expect_stack_refused(folder / "cube.fits", "its size needs 240 bytes of data, 239 are there");
  const auto npy = [&](const std::string& shape, const std::string& fortran) {
    const std::string head =
        "{'descr': '|u1', 'fortran_order': " + fortran + ", 'shape': " + shape + "}";
    std::string bytes = std::string("\x93NUMPY\x01\0", 8);
    bytes += {static_cast<char>(head.size()), '\0'};
    write_file(folder / "a.npy", bytes + head + "abcdef", true);
    return folder / "a.npy";
  };
  expect_stack_refused(npy("(2, 1, 3)", "True"), "stored in Fortran order");
  expect_stack_refused(npy("(0, 1, 6)", "False"), "0 frames");
  expect_stack_refused(npy("(1000001, 1, 6)", "False"), "more than 1000000");
  expect_stack_refused(npy("(1000000, 2000000, 1000)", "False"), "needs 2000000000000000 bytes");
}

// Sparse: 8 GB that nobody can read in the time of a test.
TEST(FrameStack, OtherFramesAreNotRead) {
  const testing::TemporaryFolder folder;
  const std::string head = "{'descr': '<u2', 'fortran_order': False, 'shape': (4000, 1000, 1000)}";
  std::string bytes = std::string("\x93NUMPY\x01\0", 8);
  bytes += {static_cast<char>(head.size()), '\0'};
  write_file(folder / "a.npy", bytes + head, false);
  std::string fits;
  for (std::string card : {"SIMPLE  = T", "BITPIX  = 16", "NAXIS   = 3", "NAXIS1  = 1000",
                           "NAXIS2  = 1000", "NAXIS3  = 4000", "END"}) {
    card.resize(80, ' ');
    fits += card;
  }
  fits.resize(2880, ' ');
  write_file(folder / "a.fits", fits, false);
  for (const char* name : {"a.npy", "a.fits"}) {
    const std::uintmax_t size = fs::file_size(folder / name) + 8'000'000'000;
    fs::resize_file(folder / name, size);
    std::fstream file(folder / name, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(size - 2));
    file.write("\x07\x07", 2);
    file.close();
    EXPECT_EQ(count_frames(folder / name), 4000);
    EXPECT_EQ(load_frame(folder / (std::string(name) + "[3999]")).dn(999, 999), 0x707) << name;
  }
}

TEST(FrameStack, AFileThatWasReplacedIsReadAnew) {
  const testing::TemporaryFolder folder;
  const fs::path path = folder / "a.tif";
  for (int round = 0; round < 4; ++round) {
    auto pages = pages_of_frames();
    if (round % 2 == 1) std::swap(pages[1].rows, pages[1].cols);
    if (round % 2 == 1) pages[1].subfile = 1;
    write_file(path, TiffStack(pages).bytes(), true);
    if (round > 1)  // so old that the places of its pages are kept
      fs::last_write_time(path, fs::file_time_type::clock::now() - std::chrono::hours(round));
    EXPECT_EQ(count_frames(path), round % 2 == 1 ? 4 : 5);
    EXPECT_EQ(load_frame(folder / "a.tif[1]").dn.values(),
              frame_of_page(round % 2 == 1 ? 2 : 1).values());
  }
}

TEST(FrameStack, HeaderlessFilesHoldOneFrame) {
  const testing::TemporaryFolder folder;
  write_file(folder / "a.raw", "abcdef", false);
  FrameOptions options;
  options.raw_format = RawFormat::kMono8;
  options.rows = 2;
  options.cols = 3;
  EXPECT_EQ(load_frame(folder / "a.raw", options).dn(1, 2), 'f');
  EXPECT_THAT(frame_names(folder / "a.raw", true), ElementsAre(folder / "a.raw"));
  EXPECT_THAT([&] { load_frame(folder / "a.raw[0]", options); },
              ThrowsMessage<InputError>(HasSubstr("a headerless file is one frame")));
}

}  // namespace
}  // namespace malus
