#include "malus/io/internal/npy.h"

#include "malus/base/error.h"
#include "malus/io/internal/stored_value.h"
#include "malus/io/picture_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMagic = "\x93NUMPY";
constexpr std::size_t kMaxNpyHeader = std::size_t{1} << 20;

[[noreturn]] void damaged_npy(const fs::path& path, std::string_view problem) {
  throw InputError(path.string(), fmt::format("is not a usable .npy file: {}", problem),
                   "save it again with numpy.save");
}

// The header is a Python dict literal with the three keys that numpy writes; this reads just that.
class HeaderText {
 public:
  HeaderText(std::string_view text, const fs::path& path) : rest_(text), path_(path) {}

  void skip_space() {
    while (!rest_.empty() && (rest_.front() == ' ' || rest_.front() == '\n' ||
                              rest_.front() == '\t' || rest_.front() == '\r'))
      rest_.remove_prefix(1);
  }
  bool accept(std::string_view token) {
    skip_space();
    if (!rest_.starts_with(token)) return false;
    rest_.remove_prefix(token.size());
    return true;
  }
  void expect(std::string_view token) {
    if (!accept(token)) damaged_npy(path_, fmt::format("its header has no \"{}\" in place", token));
  }
  std::string_view quoted() {
    skip_space();
    if (rest_.empty() || (rest_.front() != '\'' && rest_.front() != '"'))
      damaged_npy(path_,
                  "its header has no text where one belongs (structured types are not read)");
    const char quote = rest_.front();
    const auto end = rest_.find(quote, 1);
    if (end == std::string_view::npos) damaged_npy(path_, "its header is cut off");
    const std::string_view text = rest_.substr(1, end - 1);
    rest_.remove_prefix(end + 1);
    return text;
  }
  std::int64_t integer() {
    skip_space();
    std::int64_t value = -1;
    const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), value);
    if (error != std::errc() || value < 0) damaged_npy(path_, "its shape is not made of numbers");
    rest_.remove_prefix(static_cast<std::size_t>(end - rest_.data()));
    return value;
  }
  bool done() {
    skip_space();
    return rest_.empty();
  }

 private:
  std::string_view rest_;
  const fs::path& path_;
};

void parse_type(std::string_view descr, NpyHeader& header, const fs::path& path) {
  const auto unsupported = [&] {
    damaged_npy(
        path, fmt::format("it holds values of type {}; read are bool, integers and floats", descr));
  };
  if (descr.size() != 3) unsupported();
  const char order = descr[0];
  if (order != '<' && order != '>' && order != '|' && order != '=') unsupported();
  header.big_endian = order == '>';
  header.kind = descr[1];
  header.item_bytes = descr[2] - '0';
  const std::string_view sizes = header.kind == 'b'                         ? "1"
                                 : header.kind == 'u' || header.kind == 'i' ? "1248"
                                 : header.kind == 'f'                       ? "248"
                                                                            : "";
  if (sizes.find(descr[2]) == std::string_view::npos) unsupported();
}

std::vector<std::int64_t> parse_shape(HeaderText& text, const fs::path& path) {
  std::vector<std::int64_t> shape;
  text.expect("(");
  while (!text.accept(")")) {
    if (shape.size() == 8) damaged_npy(path, "its shape has too many axes");
    shape.push_back(text.integer());
    if (!text.accept(",")) {
      text.expect(")");
      break;
    }
  }
  return shape;
}

NpyHeader parse_dictionary(std::string_view dictionary, const fs::path& path) {
  NpyHeader header;
  HeaderText text(dictionary, path);
  bool has_type = false, has_order = false, has_shape = false;
  text.expect("{");
  while (!text.accept("}")) {
    const std::string_view key = text.quoted();
    text.expect(":");
    if (key == "descr") {
      parse_type(text.quoted(), header, path);
      has_type = true;
    } else if (key == "fortran_order") {
      header.fortran_order = text.accept("True");
      if (!header.fortran_order) text.expect("False");
      has_order = true;
    } else if (key == "shape") {
      header.shape = parse_shape(text, path);
      has_shape = true;
    } else {
      damaged_npy(path, fmt::format("its header has an unknown key \"{}\"", key));
    }
    if (!text.accept(",")) {
      text.expect("}");
      break;
    }
  }
  if (!has_type || !has_order || !has_shape || !text.done())
    damaged_npy(path, "its header lacks descr, fortran_order or shape, or has more");
  return header;
}

float half_to_float(std::uint16_t half) {
  const int exponent = (half >> 10) & 0x1f, mantissa = half & 0x3ff;
  float magnitude;
  if (exponent == 31)
    magnitude =
        mantissa ? std::numeric_limits<float>::quiet_NaN() : std::numeric_limits<float>::infinity();
  else if (exponent == 0)
    magnitude = std::ldexp(static_cast<float>(mantissa), -24);
  else
    magnitude = std::ldexp(static_cast<float>(mantissa | 0x400), exponent - 25);
  return half & 0x8000 ? -magnitude : magnitude;
}

double item(Bytes bytes, std::size_t offset, const NpyHeader& header) {
  const bool big = header.big_endian;
  switch (header.kind) {
    case 'f':
      if (header.item_bytes == 2)
        return static_cast<double>(half_to_float(load_number<std::uint16_t>(bytes, offset, big)));
      if (header.item_bytes == 4)
        return static_cast<double>(load_number<float>(bytes, offset, big));
      return load_number<double>(bytes, offset, big);
    case 'i':
      if (header.item_bytes == 1) return load_number<std::int8_t>(bytes, offset, big);
      if (header.item_bytes == 2) return load_number<std::int16_t>(bytes, offset, big);
      if (header.item_bytes == 4) return load_number<std::int32_t>(bytes, offset, big);
      return static_cast<double>(load_number<std::int64_t>(bytes, offset, big));
    default:
      if (header.item_bytes == 1) return load_number<std::uint8_t>(bytes, offset, big);
      if (header.item_bytes == 2) return load_number<std::uint16_t>(bytes, offset, big);
      if (header.item_bytes == 4) return load_number<std::uint32_t>(bytes, offset, big);
      return static_cast<double>(load_number<std::uint64_t>(bytes, offset, big));
  }
}

// How the array's axes lie in the picture, in elements.
struct Axes {
  std::int64_t rows, cols, channels;
  std::int64_t row_step, col_step, channel_step;
};

Axes axes_of(const NpyHeader& header, const fs::path& path, NpyAxes order) {
  const auto& shape = header.shape;
  if (shape.size() != 2 && shape.size() != 3)
    damaged_npy(path, fmt::format("its shape ({}) has {} axes; a picture has 2 or 3",
                                  fmt::join(shape, ", "), shape.size()));
  for (const std::int64_t extent : shape)
    if (extent > kMaxPixels)
      throw InputError(path.string(),
                       fmt::format("its shape ({}) has an axis of more than {} values",
                                   fmt::join(shape, ", "), kMaxPixels),
                       "crop it, or check that the file is whole");
  std::vector<std::int64_t> step(shape.size(), 1);
  if (header.fortran_order)
    for (std::size_t a = 1; a < shape.size(); ++a) step[a] = step[a - 1] * shape[a - 1];
  else
    for (std::size_t a = shape.size() - 1; a > 0; --a) step[a - 1] = step[a] * shape[a];
  Axes axes{};
  if (shape.size() == 2)
    axes = {shape[0], shape[1], 1, step[0], step[1], 0};
  else if (order == NpyAxes::kOfPictures && shape[2] <= 4 && shape[0] > 4)
    axes = {shape[0], shape[1], shape[2], step[0], step[1], step[2]};
  else
    axes = {shape[1], shape[2], shape[0], step[1], step[2], step[0]};
  return axes;
}

// Throws unless the data are as long as the shape says.
void require_npy_bytes(const NpyHeader& header, const Axes& axes, const fs::path& path,
                       std::uintmax_t present) {
  const auto needed =
      static_cast<std::uintmax_t>(axes.rows * axes.cols * axes.channels * header.item_bytes);
  if (present != needed)
    damaged_npy(path, fmt::format("its shape ({}) needs {} bytes, {} are there",
                                  fmt::join(header.shape, ", "), needed, present));
}

Axes picture_axes(const NpyHeader& header, const fs::path& path, NpyAxes order) {
  const Axes axes = axes_of(header, path, order);
  check_picture_size(path, axes.rows, axes.cols, axes.channels);
  return axes;
}

// Whether the first axis counts frames; else the array is one picture.
bool is_npy_stack(const NpyHeader& header, const Axes& axes) {
  return header.shape.size() == 3 && axes.channels == header.shape[0];
}

// Of a stack, whose channels are frames.
void check_npy_stack(const NpyHeader& header, const Axes& axes, const fs::path& path) {
  check_picture_size(path, axes.rows, axes.cols, 1);
  check_stack_size(path, axes.channels);
  require_npy_bytes(header, axes, path, require_file(path) - header.data_offset);
  if (header.fortran_order && axes.channels > 1)
    throw InputError(path.string(),
                     fmt::format("its {} frames are stored in Fortran order, each spread over the "
                                 "whole file",
                                 axes.channels),
                     "save it with numpy.save(name, numpy.ascontiguousarray(stack))");
}

Decoded describe(const NpyHeader& header, const Axes& axes) {
  Decoded decoded;
  decoded.format = "npy";
  decoded.rows = static_cast<int>(axes.rows);
  decoded.cols = static_cast<int>(axes.cols);
  decoded.channels = static_cast<int>(axes.channels);
  const int item_bits = 8 * header.item_bytes;
  decoded.bits = bits_of_numbers(header.kind, header.item_bytes);
  decoded.sample = header.kind == 'b' ? "bool"
                   : header.kind == 'f'
                       ? (item_bits == 16   ? "half"
                          : item_bits == 32 ? "float"
                                            : "double")
                       : fmt::format("{}int{}", header.kind == 'u' ? "u" : "", item_bits);
  return decoded;
}

Decoded decode_npy(Bytes bytes, const NpyHeader& header, const Axes& axes, const fs::path& path) {
  Decoded decoded = describe(header, axes);
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  const bool whole = header.kind != 'f';
  const auto item_bytes = static_cast<std::size_t>(header.item_bytes);
  for (int k = 0; k < decoded.channels; ++k)
    for (int r = 0; r < decoded.rows; ++r) {
      float* row = decoded.planes[k].row(r);
      const std::int64_t first = k * axes.channel_step + r * axes.row_step;
      for (int c = 0; c < decoded.cols; ++c) {
        const auto index = static_cast<std::size_t>(first + c * axes.col_step);
        const double value = item(bytes, header.data_offset + index * item_bytes, header);
        if (whole) require_exact(path, value);
        row[c] = static_cast<float>(value);
      }
    }
  return decoded;
}

// Where the header's text begins, and how long it is.
std::pair<std::size_t, std::size_t> header_text(Bytes bytes, const fs::path& path) {
  if (bytes.size() < 10 || !begins_as_npy(bytes)) damaged_npy(path, "it does not begin as one");
  const int version = bytes[6];
  if (version < 1 || version > 3)
    damaged_npy(path, fmt::format("format version {} is not known", version));
  const std::size_t prefix = version == 1 ? 10 : 12;
  if (bytes.size() < prefix) damaged_npy(path, "its header is cut off");
  const std::size_t length = version == 1 ? load_number<std::uint16_t>(bytes, 8, false)
                                          : load_number<std::uint32_t>(bytes, 8, false);
  if (length > kMaxNpyHeader) damaged_npy(path, "its header is cut off");
  return {prefix, length};
}

// The header alone.
NpyHeader read_npy_header(const fs::path& path) {
  constexpr std::uintmax_t kLongestPrefix = 12;
  const auto [prefix, length] = header_text(read_bytes(path, kLongestPrefix), path);
  return parse_npy_header(read_bytes(path, prefix + length), path);
}

}  // namespace

bool begins_as_npy(Bytes head) { return begins_with(head, kMagic); }

NpyHeader parse_npy_header(Bytes bytes, const fs::path& path) {
  const auto [prefix, length] = header_text(bytes, path);
  if (length > bytes.size() - prefix) damaged_npy(path, "its header is cut off");
  NpyHeader header =
      parse_dictionary({reinterpret_cast<const char*>(bytes.data()) + prefix, length}, path);
  header.data_offset = prefix + length;
  return header;
}

Decoded parse_npy(Bytes bytes, const fs::path& path, NpyAxes order) {
  const NpyHeader header = parse_npy_header(bytes, path);
  const Axes axes = picture_axes(header, path, order);
  require_npy_bytes(header, axes, path, bytes.size() - header.data_offset);
  return decode_npy(bytes, header, axes, path);
}

int npy_frames(const fs::path& path) {
  const NpyHeader header = read_npy_header(path);
  const Axes axes = axes_of(header, path, NpyAxes::kOfPictures);
  if (!is_npy_stack(header, axes)) return 1;
  check_npy_stack(header, axes, path);
  return static_cast<int>(axes.channels);
}

Decoded read_npy(const fs::path& path, bool pixels, std::optional<int> frame) {
  const NpyHeader header = read_npy_header(path);
  const Axes axes = axes_of(header, path, NpyAxes::kOfPictures);
  if (!frame || !is_npy_stack(header, axes)) {
    if (pixels) return parse_npy(read_bytes(path), path);
    check_picture_size(path, axes.rows, axes.cols, axes.channels);
    return describe(header, axes);
  }
  check_npy_stack(header, axes, path);
  MALUS_REQUIRE(*frame >= 0 && *frame < axes.channels);
  Axes one = axes;
  one.channels = 1;
  if (!pixels) return describe(header, one);
  const auto bytes = static_cast<std::size_t>(axes.rows * axes.cols * header.item_bytes);
  NpyHeader alone = header;
  alone.data_offset = 0;
  return decode_npy(
      read_part(path, header.data_offset + static_cast<std::size_t>(*frame) * bytes, bytes), alone,
      one, path);
}

namespace {

template <class T>
void append(std::string& out, std::span<const Image> planes) {
  for (const Image& plane : planes)
    for (const float value : plane.values()) {
      const T item = stored_value<T>(value);
      char raw[sizeof(T)];
      std::memcpy(raw, &item, sizeof(T));
      if constexpr (std::endian::native == std::endian::big) std::reverse(raw, raw + sizeof(T));
      out.append(raw, sizeof(T));
    }
}

}  // namespace

std::string npy_content(std::span<const Image> planes, NpySample sample) {
  const char* type = sample == NpySample::kUint8    ? "|u1"
                     : sample == NpySample::kUint16 ? "<u2"
                                                    : "<f4";
  const std::string shape =
      planes.size() == 1
          ? fmt::format("({}, {})", planes[0].rows(), planes[0].cols())
          : fmt::format("({}, {}, {})", planes.size(), planes[0].rows(), planes[0].cols());
  std::string header =
      fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", type, shape);
  // The data begin at a multiple of 64 bytes.
  header.append(63 - (10 + header.size()) % 64, ' ');
  header += '\n';
  std::string out(kMagic);
  out += '\x01';
  out += '\0';
  out += static_cast<char>(header.size() & 0xff);
  out += static_cast<char>(header.size() >> 8);
  out += header;
  switch (sample) {
    case NpySample::kUint8:
      append<std::uint8_t>(out, planes);
      break;
    case NpySample::kUint16:
      append<std::uint16_t>(out, planes);
      break;
    case NpySample::kFloat:
      append<float>(out, planes);
      break;
  }
  return out;
}

}  // namespace malus::internal
