#include "malus/io/internal/camera_raw.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/jpeg_check.h"

#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <memory>
#include <type_traits>
#include <utility>

#include <fmt/format.h>
#include <libraw/libraw.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

std::string readable_types() {
  return fmt::format(
      "read are TIFF, PNG, BMP, binary PGM, EXR, FITS, .npy, camera raw, and headerless files with "
      "{} and {}",
      setting("raw_format"), setting("size"));
}

// LibRaw moves the corner of a DNG's ActiveArea to even rows and columns, and its colours with it,
// but not its black levels, which count from that corner (DNG 1.4, BlackLevel). Only a reader that
// is a LibRaw may ask where the corner was.
class RawFile : public LibRaw {
 public:
  /// Rows and columns from the ActiveArea's corner to the shown one; 0 where it is not known.
  std::pair<unsigned, unsigned> corner_in_active_area() const {
    if (imgdata.idata.dng_version == 0) return {0, 0};
    for (const tiff_ifd_t& directory : tiff_ifd)
      if (directory.offset == libraw_internal_data.unpacker_data.data_offset)
        return {imgdata.sizes.top_margin - static_cast<unsigned>(directory.t_tm),
                imgdata.sizes.left_margin - static_cast<unsigned>(directory.t_lm)};
    return {0, 0};
  }
};

bool begins_like_tiff(const fs::path& path) {
  const auto head = read_bytes(path, 2);
  return head.size() == 2 && head[0] == head[1] && (head[0] == 'I' || head[0] == 'M');
}

// LibRaw knows hardly more of a failed opening than that it failed.
void check_open(int code, const fs::path& path) {
  if (code == LIBRAW_SUCCESS) return;
  if (begins_like_tiff(path))
    throw InputError(path.string(),
                     fmt::format("is cut off, or a TIFF or DNG of a kind that LibRaw {} cannot "
                                 "decode (JPEG XL and other new compressions, for one)",
                                 LibRaw::version()),
                     "convert it to an uncompressed DNG, or give a plain TIFF the ending .tif");
  if (begins_as_jpeg(read_bytes(path, 3)))
    throw InputError(path.string(), "is a JPEG picture, which holds no raw values",
                     "give the camera's raw frame; pictures go through malus simulate");
  throw InputError(path.string(), "is not a picture of a known type", readable_types());
}

void check_unpack(int code, const fs::path& path) {
  if (code == LIBRAW_SUCCESS) return;
  throw InputError(path.string(),
                   fmt::format("LibRaw {} cannot decode it: {}", LibRaw::version(),
                               code < 0 ? LibRaw::strerror(code) : "system error"),
                   "check that the file is whole, or convert it to an uncompressed DNG or TIFF");
}

[[noreturn]] void not_a_mosaic(const fs::path& path, std::string_view what) {
  throw InputError(path.string(),
                   fmt::format("it holds {}, not a Bayer or monochrome mosaic", what),
                   "use the camera's own undemosaiced raw");
}

SensorLayout layout_of(LibRaw& raw, const fs::path& path) {
  const auto& id = raw.imgdata.idata;
  if (id.filters == 0) {
    if (id.colors == 1) return SensorLayout::named("mono");
    not_a_mosaic(path, fmt::format("{} colours in every pixel", id.colors));
  }
  if (id.filters == 9) not_a_mosaic(path, "an X-Trans mosaic");
  if (id.filters < 1000 || raw.imgdata.sizes.raw_width == 0) not_a_mosaic(path, "a rare mosaic");
  // COLOR counts from the corner of the visible area and gives an index into cdesc ("RGBG").
  std::string pattern;
  for (int row = 0; row < 2; ++row)
    for (int col = 0; col < 2; ++col) {
      const int color = raw.COLOR(row, col);
      pattern += color >= 0 && color < 4 ? static_cast<char>(std::tolower(id.cdesc[color])) : '?';
    }
  for (const char* known : {"rggb", "bggr", "grbg", "gbrg"})
    if (pattern == known) return SensorLayout::named(fmt::format("bayer-{}", known));
  not_a_mosaic(path, fmt::format("the colour pattern {}", pattern));
}

// Shortest decimal of a float: 0.01, not 0.009999999776. In any locale, which std::stod is not.
double decimal_of(float value) {
  const std::string digits = fmt::format("{}", value);
  double decimal = 0;
  std::from_chars(digits.data(), digits.data() + digits.size(), decimal);
  return decimal;
}

// A black level is a sum of a common part, a part per colour and a pattern that repeats from (0,
// 0).
template <class Number>
double level_at(Number common, const Number* part, int color, unsigned row, unsigned col) {
  Number level = common + part[color];
  const auto rows = static_cast<unsigned>(part[4]), cols = static_cast<unsigned>(part[5]);
  if (rows > 0 && cols > 0) level += part[6 + row % rows * cols + col % cols];
  if constexpr (std::is_same_v<Number, float>) return decimal_of(level);
  return static_cast<double>(level);
}

// Of a position counted from the corner of what LibRaw shows.
double black_at(RawFile& raw, int row, int col) {
  const auto& color = raw.imgdata.color;
  const int channel = raw.imgdata.idata.filters != 0 ? raw.COLOR(row, col) : 0;
  const auto [below, right] = raw.corner_in_active_area();
  const auto r = static_cast<unsigned>(row) + below, c = static_cast<unsigned>(col) + right;
  const double whole = level_at(color.black, color.cblack, channel, r, c);
  if (raw.imgdata.idata.dng_version == 0) return whole;
  // LibRaw rounds a DNG's fractions, two or three times in one sum; where it has set the levels
  // itself they are further apart.
  constexpr double kRounding = 2;
  const auto& dng = color.dng_levels;
  const double exact = level_at(dng.dng_fblack, dng.dng_fcblack, channel, r, c);
  return std::abs(exact - whole) < kRounding ? exact : whole;
}

void read_metadata(RawFile& raw, Decoded& decoded, const fs::path& path) {
  const auto& data = raw.imgdata;
  decoded.format = "camera raw";
  decoded.sample = "uint16";
  decoded.channels = 1;
  decoded.names = {"Y"};
  decoded.camera = fmt::format("{} {}", data.idata.make, data.idata.model);
  decoded.layout = layout_of(raw, path);
  for (int row = 0; row < decoded.layout->rows(); ++row)
    for (int col = 0; col < decoded.layout->cols(); ++col)
      decoded.black_dn.push_back(black_at(raw, row, col));
  if (data.color.maximum > 0) {
    decoded.white_dn = data.color.maximum;
    decoded.bits = std::bit_width(data.color.maximum);
  } else {
    decoded.bits = 16;
  }
  if (data.other.iso_speed > 0 && std::isfinite(data.other.iso_speed))
    decoded.gain.iso = decimal_of(data.other.iso_speed);
  if (data.other.shutter > 0 && std::isfinite(data.other.shutter))
    decoded.exposure_s = decimal_of(data.other.shutter);
}

}  // namespace

Decoded read_camera_raw(const fs::path& path, bool pixels) {
  const std::uintmax_t file_bytes = require_file(path);
  const auto raw = std::make_unique<RawFile>();  // too large for the stack
  raw->set_dataerror_handler(nullptr, nullptr);  // its default prints
  check_open(raw->open_file(path.c_str()), path);
  const auto& sizes = raw->imgdata.sizes;
  check_picture_size(path, sizes.raw_height, sizes.raw_width, 1);
  // Lossy raw compression stays far below 1:100; a damaged header asks for more.
  constexpr std::uintmax_t kMaxPixelsPerByte = 100;
  if (std::uintmax_t{sizes.raw_width} * sizes.raw_height > kMaxPixelsPerByte * file_bytes)
    throw InputError(path.string(),
                     fmt::format("{} bytes cannot hold the {}x{} pixels it declares", file_bytes,
                                 sizes.raw_width, sizes.raw_height),
                     "check that the file is whole");
  check_unpack(raw->unpack(), path);  // black levels are final only now
  const std::uint16_t* mosaic = raw->imgdata.rawdata.raw_image;
  if (!mosaic) not_a_mosaic(path, "several colours in every pixel");
  if (raw->imgdata.process_warnings & LIBRAW_WARN_RAWSPEED_PROBLEM)
    throw InputError(path.string(), "its pixel data are damaged", "copy it again from the camera");

  Decoded decoded;
  read_metadata(*raw, decoded, path);
  const int top = sizes.top_margin, left = sizes.left_margin;
  decoded.rows = sizes.height;
  decoded.cols = sizes.width;
  if (decoded.rows < 1 || decoded.cols < 1 || top + decoded.rows > sizes.raw_height ||
      left + decoded.cols > sizes.raw_width)
    throw InputError(path.string(), "its visible area lies outside of the sensor",
                     "the file is damaged or of an unusual sensor");
  if (!pixels) return decoded;
  decoded.planes = Planes(1, decoded.rows, decoded.cols);
  const std::size_t pitch = sizes.raw_pitch / sizeof(std::uint16_t);
  for (int r = 0; r < decoded.rows; ++r) {
    const std::uint16_t* source = mosaic + static_cast<std::size_t>(top + r) * pitch + left;
    float* row = decoded.planes[0].row(r);
    for (int c = 0; c < decoded.cols; ++c) row[c] = static_cast<float>(source[c]);
  }
  return decoded;
}

}  // namespace malus::internal
