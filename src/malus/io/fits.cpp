#include "malus/io/internal/fits.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/picture_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <map>
#include <string_view>

#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxFitsHeader = kFitsBlock * 1024;

[[noreturn]] void damaged_fits(const fs::path& path, std::string_view problem) {
  throw InputError(path.string(), fmt::format("is not a usable FITS image: {}", problem),
                   "save it again as a plain 2-D FITS image");
}

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(' ');
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(' ') - first + 1);
}

struct Header {
  std::map<std::string, std::string, std::less<>> values;
  std::string comment;
  std::size_t data_offset = 0;
};

// Standard 4.0, section 4.1: keyword in columns 1-8, "= " in 9-10, then text in quotes or a number,
// then "/ comment".
std::string card_value(std::string_view field) {
  field = trimmed(field);
  if (field.starts_with('\'')) {
    const auto end = field.find('\'', 1);
    return std::string(
        trimmed(field.substr(1, (end == std::string_view::npos ? field.size() : end) - 1)));
  }
  return std::string(trimmed(field.substr(0, field.find('/'))));
}

bool is_end_card(Bytes bytes, std::size_t at) {
  return trimmed({reinterpret_cast<const char*>(bytes.data()) + at, 8}) == "END";
}

std::size_t whole_blocks(std::size_t bytes) {
  return (bytes + kFitsBlock - 1) / kFitsBlock * kFitsBlock;
}

// None where the bytes hold no END card.
std::optional<Header> cards_in(Bytes bytes) {
  Header header;
  for (std::size_t at = 0;; at += kFitsCard) {
    if (at + kFitsCard > bytes.size() || at > kMaxFitsHeader) return std::nullopt;
    const std::string_view card(reinterpret_cast<const char*>(bytes.data()) + at, kFitsCard);
    const std::string_view keyword = trimmed(card.substr(0, 8));
    if (is_end_card(bytes, at)) {
      header.data_offset = whole_blocks(at + kFitsCard);
      return header;
    }
    if (keyword == "COMMENT")
      header.comment += card.substr(8);
    else if (card.substr(8, 2) == "= ")
      header.values.emplace(keyword, card_value(card.substr(10)));
  }
}

Header parse_header(Bytes bytes, const fs::path& path) {
  if (bytes.size() >= kFitsCard && !begins_with(bytes, "SIMPLE "))
    damaged_fits(path, "it does not begin with SIMPLE");
  auto header = cards_in(bytes);
  if (!header) damaged_fits(path, "its header is cut off (no END card)");
  return std::move(*header);
}

std::optional<double> number(const Header& header, std::string_view key) {
  const auto found = header.values.find(key);
  if (found == header.values.end()) return std::nullopt;
  std::string text = found->second;
  // Fortran's double exponent, which many write as programming languages do.
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == 'D' || c == 'd'; }, 'E');
  const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
  double value = 0;
  const auto [end, error] = std::from_chars(first, text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    return std::nullopt;
  return value;
}

// Pixels would come out wrong without a word if a value that cannot be read counted as none.
double number_or(const Header& header, std::string_view key, double value, const fs::path& path) {
  if (!header.values.contains(std::string(key))) return value;
  const auto stored = number(header, key);
  if (!stored) damaged_fits(path, fmt::format("{} is no finite number", key));
  return *stored;
}

std::int64_t required_integer(const Header& header, std::string_view key, const fs::path& path) {
  const auto value = number(header, key);
  if (!value || *value != std::floor(*value) || std::abs(*value) > 1e15)
    damaged_fits(path, fmt::format("{} is missing or not a whole number", key));
  return static_cast<std::int64_t>(*value);
}

struct Layout {
  int bitpix = 0;
  std::int64_t rows = 0, cols = 0, channels = 1;
  double zero = 0, scale = 1;
  std::optional<double> blank;
  bool bottom_up = false;
  /// Scaled integers are whole numbers still.
  bool whole() const { return bitpix > 0 && scale == 1 && zero == std::floor(zero); }
  bool is_unsigned_64() const { return bitpix == 64 && scale == 1 && zero == 0x1p63; }
  std::size_t item_bytes() const { return static_cast<std::size_t>(std::abs(bitpix)) / 8; }
  std::size_t frame_bytes() const {
    return static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols) * item_bytes();
  }
};

// A colour filter's rows would be others without a word where the order cannot be read.
bool is_bottom_up(const Header& header, const fs::path& path) {
  const auto told = header.values.find("ROWORDER");
  if (told == header.values.end() || told->second.empty()) return false;
  const std::string order = lower_case(told->second);
  if (order != "bottom-up" && order != "top-down")
    damaged_fits(path,
                 fmt::format("ROWORDER is \"{}\", neither TOP-DOWN nor BOTTOM-UP", told->second));
  return order == "bottom-up";
}

Layout picture_layout(const Header& header, const fs::path& path) {
  Layout layout;
  const std::int64_t bitpix = required_integer(header, "BITPIX", path);
  if (bitpix != 8 && bitpix != 16 && bitpix != 32 && bitpix != 64 && bitpix != -32 && bitpix != -64)
    damaged_fits(path, fmt::format("BITPIX {} does not exist", bitpix));
  layout.bitpix = static_cast<int>(bitpix);
  const std::int64_t axes = required_integer(header, "NAXIS", path);
  if (axes != 2 && axes != 3)
    damaged_fits(path, axes == 0 ? "its first image is empty, and extensions are not read"
                                 : fmt::format("it has {} axes; a picture has 2 or 3", axes));
  layout.cols = required_integer(header, "NAXIS1", path);
  layout.rows = required_integer(header, "NAXIS2", path);
  if (axes == 3) layout.channels = required_integer(header, "NAXIS3", path);
  layout.zero = number_or(header, "BZERO", 0.0, path);
  layout.scale = number_or(header, "BSCALE", 1.0, path);
  if (layout.bitpix > 0) layout.blank = number(header, "BLANK");
  // A double holds no more integers one by one, and of their difference none is left.
  constexpr double kMostShift = 0x1p52;
  if (layout.bitpix == 64 && layout.whole() && std::abs(layout.zero) > kMostShift &&
      !layout.is_unsigned_64())
    damaged_fits(path, fmt::format("BZERO {:g} moves 64-bit integers too far", layout.zero));
  layout.bottom_up = is_bottom_up(header, path);
  return layout;
}

double stored(Bytes bytes, std::size_t offset, int bitpix) {
  switch (bitpix) {
    case 8:
      return bytes[offset];
    case 16:
      return load_number<std::int16_t>(bytes, offset, true);
    case 32:
      return load_number<std::int32_t>(bytes, offset, true);
    case 64:
      return static_cast<double>(load_number<std::int64_t>(bytes, offset, true));
    case -32:
      return static_cast<double>(load_number<float>(bytes, offset, true));
    default:
      return load_number<double>(bytes, offset, true);
  }
}

// BZERO 2^63 is the sign's bit turned over; as numbers, 2^63 swallows what is added to it.
double unsigned_64(Bytes bytes, std::size_t offset) {
  return static_cast<double>(load_number<std::uint64_t>(bytes, offset, true) ^ std::uint64_t{1}
                                                                                   << 63);
}

void require_fits_bytes(const Layout& layout, std::size_t data_offset, std::uintmax_t file_bytes,
                        const fs::path& path) {
  const std::size_t needed = layout.frame_bytes() * static_cast<std::size_t>(layout.channels);
  const std::uintmax_t present = file_bytes > data_offset ? file_bytes - data_offset : 0;
  if (present < needed)
    damaged_fits(path,
                 fmt::format("its size needs {} bytes of data, {} are there", needed, present));
}

// Of a cube, whose channels are frames.
void check_fits_stack(const Layout& layout, std::size_t data_offset, const fs::path& path) {
  check_picture_size(path, layout.rows, layout.cols, 1);
  check_stack_size(path, layout.channels);
  require_fits_bytes(layout, data_offset, require_file(path), path);
}

// Contract: the pixels are there.
void decode_pixels(Bytes bytes, const Layout& layout, std::size_t data_offset, const fs::path& path,
                   Decoded& decoded) {
  const std::size_t item = layout.item_bytes();
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  std::size_t offset = data_offset;
  for (Image& plane : decoded.planes)
    for (int r = 0; r < plane.rows(); ++r) {
      float* row = plane.row(layout.bottom_up ? plane.rows() - 1 - r : r);
      for (int c = 0; c < plane.cols(); ++c, offset += item) {
        const double raw = stored(bytes, offset, layout.bitpix);
        const double value =
            layout.is_unsigned_64() ? unsigned_64(bytes, offset) : layout.zero + layout.scale * raw;
        const bool blank = layout.blank && raw == *layout.blank;
        if (layout.whole() && !blank) require_exact(path, value);
        row[c] = blank ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(value);
      }
    }
}

Decoded describe_fits(const Header& header, const Layout& layout) {
  Decoded decoded;
  decoded.format = "fits";
  decoded.rows = static_cast<int>(layout.rows);
  decoded.cols = static_cast<int>(layout.cols);
  decoded.channels = static_cast<int>(layout.channels);
  if (layout.whole()) {
    // A signed type is unsigned when BZERO moves its lower end to zero (standard 4.0, table 11).
    const bool is_unsigned =
        layout.bitpix == 8 || layout.zero >= std::ldexp(1.0, layout.bitpix - 1);
    decoded.bits = std::min(layout.bitpix - (is_unsigned ? 0 : 1), 24);
    decoded.sample = fmt::format("{}int{}", is_unsigned ? "u" : "", layout.bitpix);
  } else {
    decoded.sample = layout.bitpix == -64 ? "double" : "float";
  }
  for (const char* key : {"EXPOSURE", "EXPTIME"})
    if (const auto told = number(header, key); told && *told >= 0) decoded.exposure_s = told;
  if (const auto camera = header.values.find("INSTRUME"); camera != header.values.end())
    decoded.camera = camera->second;
  decoded.description = header.comment;
  return decoded;
}

constexpr std::size_t kUsualHeader = 4 * kFitsBlock;

// Of a file, whose pixels may be many.
Header read_fits_header(const fs::path& path) {
  const auto begin = read_bytes(path, kUsualHeader);
  for (std::size_t at = 0; at + kFitsCard <= begin.size(); at += kFitsCard)
    if (is_end_card(begin, at)) return parse_header(begin, path);
  return parse_header(read_bytes(path, kMaxFitsHeader + kFitsBlock), path);
}

// The header of an extension at this place; none where something else stands there, which the
// standard allows behind the last (section 3.5).
std::optional<Header> extension_at(const fs::path& path, std::uintmax_t at,
                                   std::uintmax_t file_bytes) {
  for (const std::size_t most : {kUsualHeader, kMaxFitsHeader}) {
    const auto bytes = read_part(
        path, at, static_cast<std::size_t>(std::min<std::uintmax_t>(most, file_bytes - at)));
    if (!begins_with(bytes, "XTENSION")) return std::nullopt;
    if (auto header = cards_in(bytes)) return header;
  }
  return std::nullopt;
}

// Section 4.4.1: of an extension's data, padding left out. None of a header that makes no sense.
std::optional<double> extension_bytes(const Header& header) {
  double values = 1;
  const double axes = number(header, "NAXIS").value_or(-1);
  for (int axis = 1; axis <= axes; ++axis)
    values *= number(header, fmt::format("NAXIS{}", axis)).value_or(-1);
  const double bytes = std::abs(number(header, "BITPIX").value_or(-1)) / 8 *
                       number(header, "GCOUNT").value_or(1) *
                       (number(header, "PCOUNT").value_or(0) + (axes > 0 ? values : 0));
  if (axes < 0 || axes > 999 || !(bytes >= 0)) return std::nullopt;
  return bytes;
}

// Programs write stacks as image extensions, too. An image of another size or type (a mask, what a
// preview is made of) is no frame beside the first.
bool is_another_frame(const Header& header, const Layout& first) {
  const auto is = [&](const char* key, double value) { return number(header, key) == value; };
  const auto kind = header.values.find("XTENSION");
  return kind != header.values.end() && kind->second == "IMAGE" &&
         number(header, "NAXIS").value_or(0) >= 2 && is("BITPIX", first.bitpix) &&
         is("NAXIS1", static_cast<double>(first.cols)) &&
         is("NAXIS2", static_cast<double>(first.rows));
}

void refuse_frames_in_extensions(const Header& first, const Layout& layout, const fs::path& path) {
  constexpr int kMostExtensions = 1000;
  const std::uintmax_t file_bytes = require_file(path);
  std::uintmax_t at = first.data_offset + whole_blocks(layout.frame_bytes() *
                                                       static_cast<std::size_t>(layout.channels));
  for (int i = 0; i < kMostExtensions && at < file_bytes; ++i) {
    const auto header = extension_at(path, at, file_bytes);
    if (!header) return;
    if (is_another_frame(*header, layout))
      throw InputError(path.string(), "it holds more frames, as image extensions",
                       "save the frames as one FITS cube (NAXIS = 3) or as single files");
    const auto bytes = extension_bytes(*header);
    if (!bytes || *bytes > static_cast<double>(file_bytes)) return;
    at += header->data_offset + whole_blocks(static_cast<std::size_t>(*bytes));
  }
}

}  // namespace

Decoded parse_fits(Bytes bytes, const fs::path& path, bool pixels) {
  const Header header = parse_header(bytes, path);
  const Layout layout = picture_layout(header, path);
  check_picture_size(path, layout.rows, layout.cols, layout.channels);
  Decoded decoded = describe_fits(header, layout);
  if (!pixels) return decoded;
  require_fits_bytes(layout, header.data_offset, bytes.size(), path);
  decode_pixels(bytes, layout, header.data_offset, path, decoded);
  return decoded;
}

bool begins_as_fits(Bytes head) { return begins_with(head, "SIMPLE"); }

int fits_frames(const fs::path& path) {
  const Header header = read_fits_header(path);
  const Layout layout = picture_layout(header, path);
  if (layout.channels != 1) check_fits_stack(layout, header.data_offset, path);
  check_picture_size(path, layout.rows, layout.cols, 1);  // the rest is checked as it is read
  refuse_frames_in_extensions(header, layout, path);
  return static_cast<int>(layout.channels);
}

Decoded read_fits(const fs::path& path, bool pixels, std::optional<int> frame) {
  const Header header = read_fits_header(path);
  Layout layout = picture_layout(header, path);
  if (!frame) {
    check_picture_size(path, layout.rows, layout.cols, layout.channels);
    refuse_frames_in_extensions(header, layout, path);
    return pixels ? parse_fits(read_bytes(path), path) : describe_fits(header, layout);
  }
  check_fits_stack(layout, header.data_offset, path);
  MALUS_REQUIRE(*frame >= 0 && *frame < layout.channels);
  layout.channels = 1;
  Decoded decoded = describe_fits(header, layout);
  if (!pixels) return decoded;
  const std::size_t bytes = layout.frame_bytes();
  const auto place = header.data_offset + static_cast<std::size_t>(*frame) * bytes;
  decode_pixels(read_part(path, place, bytes), layout, 0, path, decoded);
  return decoded;
}

}  // namespace malus::internal
