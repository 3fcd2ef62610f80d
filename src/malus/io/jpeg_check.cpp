#include "malus/io/internal/jpeg_check.h"

#include "malus/base/error.h"

#include <algorithm>
#include <string>
#include <string_view>

#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// Markers, the byte after 0xff (T.81, table B.1).
constexpr std::uint8_t kStart = 0xd8, kEnd = 0xd9, kScan = 0xda;

[[noreturn]] void damaged_jpeg(const fs::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the JPEG file {}", what),
                   "the file is damaged or cut off: copy or record it again");
}

[[noreturn]] void unfit_jpeg(const fs::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the JPEG file {}", what),
                   "save it as grey or RGB of 8 bits, or as PNG");
}

bool restarts(std::uint8_t marker) { return marker >= 0xd0 && marker <= 0xd7; }

// SOF0 to SOF15 but for the tables and the extension among them.
bool begins_frame(std::uint8_t marker) {
  return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
}

// A frame header's content: precision, rows, columns, channels.
JpegSize size_of(Bytes header, const fs::path& path) {
  if (header.size() < 6) damaged_jpeg(path, "has a frame header that is too short");
  const JpegSize size{load_number<std::uint16_t>(header, 1, true),
                      load_number<std::uint16_t>(header, 3, true), header[5]};
  if (header[0] != 8) unfit_jpeg(path, fmt::format("has samples of {} bits, not 8", header[0]));
  if (size.channels != 1 && size.channels != 3)
    unfit_jpeg(path, fmt::format("has {} channels, not 1 or 3", size.channels));
  if (size.rows == 0 || size.cols == 0) damaged_jpeg(path, "declares no pixels");
  return size;
}

// Where the marker after a scan's coded pixels begins; there 0xff is followed by 0 or a restart.
std::size_t end_of_scan(Bytes bytes, std::size_t at) {
  while (true) {
    const auto found =
        std::find(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.end(), 0xff);
    at = static_cast<std::size_t>(found - bytes.begin());
    if (at + 1 >= bytes.size()) return bytes.size();
    const std::uint8_t next = bytes[at + 1];
    if (next != 0 && next != 0xff && !restarts(next)) return at;
    at += next == 0xff ? 1 : 2;
  }
}

}  // namespace

bool begins_as_jpeg(Bytes bytes) {
  return bytes.size() >= 3 && bytes[0] == 0xff && bytes[1] == kStart && bytes[2] == 0xff;
}

JpegSize check_jpeg(Bytes bytes, const fs::path& path) {
  if (!begins_as_jpeg(bytes)) damaged_jpeg(path, "does not begin as one");
  // Encoders write about ten; thousands would be a file that keeps a decoder busy for hours.
  constexpr int kMostScans = 200;
  JpegSize size;
  int scans = 0;
  for (std::size_t at = 2;;) {
    if (at >= bytes.size()) damaged_jpeg(path, "ends before its end marker");
    if (bytes[at] != 0xff) damaged_jpeg(path, "has bytes between its segments");
    while (at < bytes.size() && bytes[at] == 0xff) ++at;
    if (at >= bytes.size()) damaged_jpeg(path, "ends before its end marker");
    const std::uint8_t marker = bytes[at++];
    if (marker == kEnd) break;
    if (marker < 0xc0 || marker == kStart || restarts(marker))
      damaged_jpeg(path, fmt::format("has the marker {:02x} where none may stand", marker));
    if (bytes.size() - at < 2) damaged_jpeg(path, "ends before its end marker");
    const std::size_t length = load_number<std::uint16_t>(bytes, at, true);
    if (length < 2 || length > bytes.size() - at)
      damaged_jpeg(path, fmt::format("ends inside its segment {:02x}", marker));
    if (begins_frame(marker)) {
      if (size.channels != 0) damaged_jpeg(path, "has two frame headers");
      size = size_of(bytes.subspan(at + 2, length - 2), path);
    }
    at += length;
    if (marker != kScan) continue;
    if (size.channels == 0) damaged_jpeg(path, "has pixels before their frame header");
    if (++scans > kMostScans) damaged_jpeg(path, fmt::format("has more than {} scans", kMostScans));
    at = end_of_scan(bytes, at);
  }
  if (scans == 0) damaged_jpeg(path, "has no pixels");
  return size;
}

}  // namespace malus::internal
