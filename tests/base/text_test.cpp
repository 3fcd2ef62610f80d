// What is suggested for words that are not known.
#include "malus/base/text.h"

#include <string>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(NearestName, IsNearOrNone) {
  const std::vector<std::string> commands{"info",    "calibrate", "model",
                                          "denoise", "stokes",    "train"};
  const std::vector<std::string> layouts{"mono",       "bayer-rggb",       "bayer-bggr",
                                         "polar-mono", "polar-bayer-rggb", "polar-bayer-bggr"};
  const std::vector<std::string> keys{"width", "steps", "data", "pictures"};
  const std::vector<std::string> formats{"tif", "png", "exr"};
  const std::vector<std::string>* where[] = {&commands, &layouts, &keys, &formats};
  const struct {
    int of;
    const char *name, *nearest;
  } cases[] = {{0, "calibrat", "calibrate"},
               {0, "Denoise", "denoise"},
               {0, "denoising", "denoise"},
               {0, "models", "model"},
               {0, "help", ""},
               {0, "training", "train"},
               {0, "calibration", "calibrate"},
               {0, "import", ""},
               {0, "xyz", ""},
               {1, "rggb", "bayer-rggb"},
               {1, "polar", "polar-mono"},
               {1, "polar-bayer", "polar-bayer-rggb"},
               {1, "BGGR", "bayer-bggr"},
               {1, "bayer-rgb", "bayer-rggb"},
               {1, "quad", ""},
               {1, "mono8", "mono"},
               {2, "widht", "width"},
               {2, "step", "steps"},
               {2, "foo", ""},
               {3, "tiff2", "tif"},
               {3, "tifpicture", ""},
               {2, "dtaa", "data"},
               {2, "", ""}};
  for (const auto& [of, name, nearest] : cases) {
    EXPECT_EQ(nearest_name(name, *where[of]), nearest) << name;
    EXPECT_EQ(did_you_mean(name, *where[of]).empty(), std::string(nearest).empty()) << name;
  }
  EXPECT_EQ(did_you_mean("widht", keys), "did you mean width? ");
  EXPECT_EQ(did_you_mean("widht", keys, true), "did you mean \"width\"? ");
  EXPECT_EQ(nearest_name("info", {}), "");
}

TEST(DecimalNumber, IsTheWholeTextAndDecimal) {
  for (const auto& [text, value] : {std::pair<const char*, double>{"12", 12},
                                    {"+12", 12},
                                    {"-0.5", -0.5},
                                    {".5", 0.5},
                                    {"5.", 5},
                                    {"1e3", 1000},
                                    {"2.5E-1", 0.25},
                                    {"010", 10}})
    EXPECT_EQ(decimal_number(text), value) << text;
  for (const char* text : {"", "0x10", "0x1p4", "1_000", "1,5", "12 ", " 12", "12dB", "+-1", "--1",
                           "inf", "nan", "1e400", "1e", "+"})
    EXPECT_FALSE(decimal_number(text)) << text;
}

// The limits of Unicode's table of well-formed byte sequences, from both sides.
TEST(Utf8, IsToldFromOtherBytes) {
  for (const char* text : {"", "plain", "caf\xc3\xa9", "\xc2\x80", "\xdf\xbf", "\xe0\xa0\x80",
                           "\xed\x9f\xbf", "\xee\x80\x80", "\xf0\x90\x80\x80", "\xf4\x8f\xbf\xbf"})
    EXPECT_TRUE(is_utf8(text)) << text;
  for (const char* text :
       {"caf\xe9", "\x80", "\xc3", "\xc1\xbf", "\xc3(", "\xe0\x9f\xbf", "\xe2\x82", "\xed\xa0\x80",
        "\xf0\x8f\xbf\xbf", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff"})
    EXPECT_FALSE(is_utf8(text)) << text;
}

TEST(Counted, OneHasNoPlural) {
  EXPECT_EQ(counted(0, "pixel") + ", " + counted(1, "pixel") + ", " + counted(2, "pixel"),
            "0 pixels, 1 pixel, 2 pixels");
  EXPECT_EQ(counted_are(1, "pixel"), "1 pixel is");
  EXPECT_EQ(counted_are(2, "pixel"), "2 pixels are");
}

TEST(PercentText, HasTwoDigitsAndNoExponent) {
  EXPECT_EQ(percent_text(0), "0");
  EXPECT_EQ(percent_text(2e-7), "0.00002");  // one pixel of five million
  EXPECT_EQ(percent_text(3e-10), "0.00000003");
  EXPECT_EQ(percent_text(1.2e-6), "0.00012");
  EXPECT_EQ(percent_text(3.4e-4), "0.034");
  EXPECT_EQ(percent_text(0.123), "12");
  EXPECT_EQ(percent_text(1), "100");
}

}  // namespace
}  // namespace malus
