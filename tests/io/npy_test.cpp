#include "malus/io/internal/npy.h"

#include "malus/base/error.h"
#include "malus/io/picture_file.h"

#include <cmath>

#include "support.h"
#include <gmock/gmock.h>

namespace malus::internal {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

// As numpy.save writes it.
std::vector<std::uint8_t> npy(const std::string& dictionary, std::string data, char version = 1) {
  std::string out = "\x93NUMPY";
  out += version;
  out += '\0';
  out += static_cast<char>(dictionary.size() & 0xff);
  out += static_cast<char>(dictionary.size() >> 8);
  if (version > 1) out += std::string(2, '\0');
  out += dictionary + data;
  return {out.begin(), out.end()};
}

std::vector<std::uint8_t> two_by_three(const std::string& type, const std::string& data,
                                       bool fortran = false) {
  return npy("{'descr': '" + type + "', 'fortran_order': " + (fortran ? "True" : "False") +
                 ", 'shape': (2, 3), }\n",
             data);
}

std::vector<float> values(const std::vector<std::uint8_t>& bytes) {
  return parse_npy(bytes, "x.npy").planes[0].values();
}

TEST(Npy, EveryTypeAndByteOrder) {
  EXPECT_THAT(values(two_by_three("|u1", {1, 2, 3, 4, 5, '\xff'})),
              ElementsAre(1, 2, 3, 4, 5, 255));
  EXPECT_THAT(values(two_by_three("|i1", {1, 2, 3, 4, 5, '\xff'})), ElementsAre(1, 2, 3, 4, 5, -1));
  EXPECT_THAT(values(two_by_three("<u2", {1, 0, 2, 0, 3, 0, 4, 0, 5, 0, '\xff', '\xff'})),
              ElementsAre(1, 2, 3, 4, 5, 65535));
  EXPECT_THAT(values(two_by_three(">u2", {0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 1, 0})),
              ElementsAre(1, 2, 3, 4, 5, 256));
  EXPECT_THAT(values(two_by_three(">i2", {0, 1, 0, 2, 0, 3, 0, 4, 0, 5, '\xff', '\xfe'})),
              ElementsAre(1, 2, 3, 4, 5, -2));
  std::string floats, doubles, longs;
  for (const double value : {0.5, -1.25, 3.0, 4e6, -5.0, 1e-3}) {
    const auto narrow = static_cast<float>(value);
    floats.append(reinterpret_cast<const char*>(&narrow), 4);
    doubles.append(reinterpret_cast<const char*>(&value), 8);
    const auto whole = static_cast<std::int64_t>(value);
    longs.append(reinterpret_cast<const char*>(&whole), 8);
  }
  EXPECT_THAT(values(two_by_three("<f4", floats)), ElementsAre(0.5f, -1.25f, 3, 4e6f, -5, 1e-3f));
  EXPECT_THAT(values(two_by_three("<f8", doubles)), ElementsAre(0.5f, -1.25f, 3, 4e6f, -5, 1e-3f));
  EXPECT_THAT(values(two_by_three("<i8", longs)), ElementsAre(0, -1, 3, 4e6f, -5, 0));
  // IEEE half: 1, -2, 65504, smallest subnormal 2^-24, infinity, 0.333251953125
  EXPECT_THAT(
      values(two_by_three("<f2", {0, 0x3c, 0, '\xc0', '\xff', 0x7b, 1, 0, 0, 0x7c, 0x55, 0x35})),
      ElementsAre(1, -2, 65504, std::ldexp(1.0f, -24), INFINITY, 0.333251953125f));
}

TEST(Npy, FortranOrderIsTransposed) {
  EXPECT_THAT(values(two_by_three("|u1", {1, 4, 2, 5, 3, 6}, true)), ElementsAre(1, 2, 3, 4, 5, 6));
}

TEST(Npy, ThreeAxesAreChannelsFirstUnlessTheLastIsShort) {
  const std::string head = "{'descr': '|u1', 'fortran_order': False, 'shape': ";
  const Decoded planar = parse_npy(npy(head + "(2, 1, 3), }", "\1\2\3\4\5\6"), "x.npy");
  EXPECT_EQ(planar.channels, 2);
  EXPECT_THAT(planar.planes[1].values(), ElementsAre(4, 5, 6));
  const Decoded pixels = parse_npy(npy(head + "(5, 1, 2), }", "abcdefghij"), "x.npy");
  EXPECT_EQ(pixels.channels, 2);
  EXPECT_THAT(pixels.planes[1].values(), ElementsAre('b', 'd', 'f', 'h', 'j'));
}

TEST(Npy, VersionsTwoAndThree) {
  const std::string dictionary = "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 2), }\n";
  EXPECT_EQ(parse_npy(npy(dictionary, "ab", 2), "x.npy").cols, 2);
  EXPECT_EQ(parse_npy(npy(dictionary, "ab", 3), "x.npy").cols, 2);
}

TEST(Npy, DamagedFilesAreRefused) {
  const std::string data = "abcdef";
  const auto refused = [](const std::vector<std::uint8_t>& bytes, const std::string& text) {
    EXPECT_THAT([&] { parse_npy(bytes, "x.npy"); }, ThrowsMessage<InputError>(HasSubstr(text)));
  };
  const auto good = two_by_three("|u1", data);
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(parse_npy({good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)}, "x"),
                 InputError)
        << length;
  refused(two_by_three("|u1", data + "g"), "needs 6 bytes, 7 are there");
  refused(two_by_three("|O", data), "type |O");
  refused(two_by_three("<c8", data), "type <c8");
  refused(npy("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (1, 1), }", data),
          "structured types");
  refused(npy("{'descr': '|u1', 'fortran_order': False, 'shape': (6,), }", data), "1 axes");
  refused(npy("{'descr': '|u1', 'fortran_order': False, 'shape': (0, 6), }", data), "0");
  refused(
      npy("{'descr': '|u1', 'fortran_order': False, 'shape': (4294967296, 4294967297), }", data),
      "its shape (4294967296, 4294967297) has an axis of more than 2147483647 values");
  // One more than rows and columns, which are ints, can count.
  refused(npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2147483648, 1), }", data),
          "more than 2147483647 values");
  refused(npy("{'descr': '|u1', 'fortran_order': Maybe, 'shape': (2, 3), }", data), "False");
  refused(npy("{'descr': '|u1', 'shape': (2, 3), }", data), "lacks");
  refused(npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3), 'x': 1}", data), "\"x\"");
  refused(npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 3), }", data, 9), "version 9");
}

TEST(Npy, IntegersBeyondFloatAreRefused) {
  std::string data(8, '\0');
  data[3] = 1;  // 2^24: exact
  const std::string dictionary = "{'descr': '<u4', 'fortran_order': False, 'shape': (1, 2), }";
  EXPECT_EQ(values(npy(dictionary, data))[0], 16777216.0f);
  data[0] = 1;
  EXPECT_THAT([&] { parse_npy(npy(dictionary, data), "x.npy"); },
              ThrowsMessage<InputError>(HasSubstr("16777217")));
}

TEST(Npy, TheSignOfAnIntegerIsNoneOfItsBits) {
  const auto bits = [](const std::string& type, std::size_t bytes) {
    return parse_npy(npy("{'descr': '" + type + "', 'fortran_order': False, 'shape': (1, 1), }",
                         std::string(bytes, '\0')),
                     "x.npy")
        .bits;
  };
  EXPECT_EQ(bits("<u2", 2), 16);
  EXPECT_EQ(bits("<i2", 2), 15);
  EXPECT_EQ(bits("|i1", 1), 7);
  EXPECT_EQ(bits("<i4", 4), 24);
}

TEST(Npy, WhatIsWrittenIsReadBack) {
  Planes planes(2, 3, 2);
  for (int k = 0; k < 2; ++k)
    for (int i = 0; i < 6; ++i)
      planes[k].values()[static_cast<std::size_t>(i)] = static_cast<float>(100 * k + 10 * i);
  for (const NpySample sample : {NpySample::kUint8, NpySample::kUint16, NpySample::kFloat}) {
    const std::string content = npy_content(planes, sample);
    const std::vector<std::uint8_t> bytes(content.begin(), content.end());
    EXPECT_EQ(parse_npy_header(bytes, "x").data_offset % 64, 0u);
    const Decoded back = parse_npy(bytes, "x");
    ASSERT_EQ(back.channels, 2);
    for (int k = 0; k < 2; ++k) EXPECT_EQ(back.planes[k].values(), planes[k].values());
  }
}

}  // namespace
}  // namespace malus::internal
