#include "malus/io/internal/netpbm.h"

#include "malus/base/error.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <string_view>

#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxNetpbmHeader = 4096;  // comments among its numbers
constexpr std::uint32_t kLargest = 65535;

[[noreturn]] void damaged_netpbm(const fs::path& path, std::string_view problem) {
  throw InputError(path.string(), fmt::format("the PGM file {}", problem),
                   "the file is damaged or cut off: copy or record it again");
}

struct NetpbmHeader {
  std::uint32_t cols = 0, rows = 0, largest = 0;
  std::size_t data_offset = 0;
  bool ends_in_two = false;  // carriage return and line feed, of which one is a pixel
};

bool is_netpbm_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

// Numbers with white space before them, among which comments run from # to the line's end.
class NetpbmNumbers {
 public:
  NetpbmNumbers(std::string_view text, const fs::path& path) : text_(text), path_(path) {}

  std::uint32_t next() {
    skip_space();
    std::uint32_t value = 0;
    const char* const last = text_.data() + text_.size();
    const auto [end, error] = std::from_chars(text_.data() + at_, last, value);
    if (error != std::errc()) damaged_netpbm(path_, "has no whole number in its header's place");
    at_ = static_cast<std::size_t>(end - text_.data());
    return value;
  }
  /// Of the first byte of pixels: one white space ends the header.
  std::size_t end() {
    if (at_ == text_.size() || !is_netpbm_space(text_[at_]))
      damaged_netpbm(path_, "ends in its header");
    return at_ + 1;
  }

 private:
  void skip_space() {
    const std::size_t before = at_;
    while (at_ < text_.size() && (is_netpbm_space(text_[at_]) || text_[at_] == '#')) {
      if (text_[at_] == '#') at_ = std::min(text_.find('\n', at_), text_.size() - 1);
      ++at_;
    }
    if (at_ == before || at_ == text_.size()) damaged_netpbm(path_, "ends in its header");
  }

  std::string_view text_;
  const fs::path& path_;
  std::size_t at_ = 2;  // after the magic
};

NetpbmHeader parse_header(Bytes bytes, const fs::path& path) {
  const std::size_t length = std::min(bytes.size(), kMaxNetpbmHeader);
  NetpbmNumbers numbers({reinterpret_cast<const char*>(bytes.data()), length}, path);
  NetpbmHeader header;
  header.cols = numbers.next();
  header.rows = numbers.next();
  header.largest = numbers.next();
  header.data_offset = numbers.end();
  header.ends_in_two = header.data_offset < length && bytes[header.data_offset - 1] == '\r' &&
                       bytes[header.data_offset] == '\n';
  if (header.largest < 1 || header.largest > kLargest)
    damaged_netpbm(path, fmt::format("declares values up to {}", header.largest));
  return header;
}

template <class T>
void decode_netpbm(Bytes bytes, const NetpbmHeader& header, const fs::path& path, Planes& planes) {
  std::size_t at = header.data_offset;
  for (int r = 0; r < planes[0].rows(); ++r)
    for (int c = 0; c < planes[0].cols(); ++c)
      for (Image& plane : planes) {
        const T stored = load_number<T>(bytes, at, true);
        if (stored > header.largest)
          damaged_netpbm(path,
                         fmt::format("holds {}, it declares up to {}", stored, header.largest));
        plane(r, c) = static_cast<float>(stored);
        at += sizeof(T);
      }
}

}  // namespace

Decoded parse_netpbm(Bytes bytes, const fs::path& path, bool pixels) {
  if (bytes.size() < 2 || bytes[0] != 'P' || (bytes[1] != '5' && bytes[1] != '6'))
    damaged_netpbm(path, "does not begin with P5 or P6");
  const NetpbmHeader header = parse_header(bytes, path);
  Decoded decoded;
  decoded.channels = bytes[1] == '5' ? 1 : 3;
  check_picture_size(path, header.rows, header.cols, decoded.channels);
  const std::size_t item = header.largest < 256 ? 1 : 2;
  decoded.format = decoded.channels == 1 ? "pgm" : "ppm";
  decoded.rows = static_cast<int>(header.rows);
  decoded.cols = static_cast<int>(header.cols);
  decoded.sample = item == 1 ? "uint8" : "uint16";
  decoded.bits = std::bit_width(header.largest);
  if (!std::has_single_bit(header.largest + 1)) decoded.white_dn = header.largest;
  if (!pixels) return decoded;
  const std::size_t needed =
      std::size_t{header.rows} * header.cols * item * static_cast<std::size_t>(decoded.channels) +
      header.data_offset;
  if (bytes.size() < needed)
    damaged_netpbm(path, fmt::format("has {} bytes, {}x{} pixels need {}", bytes.size(),
                                     header.cols, header.rows, needed));
  const std::size_t beyond = bytes.size() - needed;
  if (beyond == 1 && header.ends_in_two)
    throw InputError(path.string(), "its header ends in two bytes, which shifts its pixels by one",
                     "write its header's lines with \\n alone");
  if (beyond > 1 || (beyond == 1 && bytes.back() != '\n'))  // a line's end
    throw InputError(path.string(), "it goes on after its picture",
                     "store one picture in a PGM file");
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  if (item == 1)
    decode_netpbm<std::uint8_t>(bytes, header, path, decoded.planes);
  else
    decode_netpbm<std::uint16_t>(bytes, header, path, decoded.planes);
  return decoded;
}

void refuse_other_netpbm(Bytes head, const fs::path& path) {
  if (head.size() < 3 || head[0] != 'P' ||
      (head[2] != '#' && !is_netpbm_space(static_cast<char>(head[2]))))
    return;
  const char kind = static_cast<char>(head[1]);
  if (kind >= '1' && kind <= '3')
    throw InputError(path.string(),
                     fmt::format("is a Netpbm picture written in digits (ASCII, P{})", kind),
                     "convert it to binary PGM (P5)");
  if (kind == '4' || kind == '7')
    throw InputError(path.string(), fmt::format("is a Netpbm picture of kind P{}", kind),
                     "convert it to binary PGM (P5)");
}

Decoded read_netpbm(const fs::path& path, bool pixels) {
  return pixels ? parse_netpbm(read_bytes(path), path)
                : parse_netpbm(read_bytes(path, kMaxNetpbmHeader), path, false);
}

}  // namespace malus::internal
