#include "malus/io/internal/file_bytes.h"

#include "malus/base/error.h"
#include "malus/base/large_pages.h"
#include "malus/base/text.h"
#include "malus/base/unreadable_file.h"
#include "malus/io/frame_stack.h"
#include "malus/io/internal/decoded.h"

#include <cerrno>
#include <cstdio>
#include <memory>
#include <system_error>

#include <fmt/format.h>

namespace malus::internal {

namespace fs = std::filesystem;

namespace {

OpenFile open_file(const fs::path& path) {
  OpenFile file(std::fopen(path.c_str(), "rb"));
  if (!file)
    throw InputError(path.string(), fmt::format("cannot be opened: {}", std::strerror(errno)),
                     "check its permissions");
  return file;
}

}  // namespace

std::uintmax_t require_file(const fs::path& path) {
  std::error_code error;
  const auto status = fs::status(path, error);
  if (!fs::exists(status) || fs::is_directory(status)) throw unreadable_file(path);
  if (!fs::is_regular_file(status))
    throw InputError(path.string(), "is not a regular file", "copy it to a file first");
  const std::uintmax_t size = fs::file_size(path, error);
  if (error)
    throw InputError(path.string(), fmt::format("cannot be read: {}", error.message()),
                     "check its permissions");
  open_file(path);
  if (size == 0)
    throw InputError(path.string(), "the file is empty (0 bytes)", "copy or record it again");
  return size;
}

std::vector<std::uint8_t> read_bytes(const fs::path& path, std::uintmax_t limit) {
  const std::uintmax_t size = std::min(require_file(path), limit);
  return read_part(path, 0, static_cast<std::size_t>(size));
}

bool begins_with(Bytes bytes, std::string_view text) {
  return bytes.size() >= text.size() && std::memcmp(bytes.data(), text.data(), text.size()) == 0;
}

std::string read_text(const fs::path& path, std::string_view what) {
  constexpr std::uintmax_t kMaxBytes = 64 << 20;
  if (require_file(path) > kMaxBytes)
    throw InputError(path.string(), fmt::format("is too large for {}", what),
                     "name the right file");
  const auto bytes = read_bytes(path);
  return {bytes.begin(), bytes.end()};
}

std::vector<std::uint8_t> read_part(const fs::path& path, std::uintmax_t at, std::size_t bytes) {
  const OpenFile file = open_file(path);
  std::vector<std::uint8_t> part;
  part.reserve(bytes);
  prepare_pages(part.data(), bytes);
  part.resize(bytes);
  if (fseeko(file.get(), static_cast<off_t>(at), SEEK_SET) != 0 ||
      std::fread(part.data(), 1, part.size(), file.get()) != part.size())
    throw InputError(path.string(), fmt::format("cannot be read: {}", std::strerror(errno)),
                     "check the disk");
  return part;
}

void check_picture_size(const fs::path& path, std::int64_t rows, std::int64_t cols,
                        std::int64_t channels) {
  const std::string text =
      fmt::format("{}x{} pixels and {}", cols, rows, counted(channels, "channel"));
  if (rows < 1 || cols < 1 || channels < 1)
    throw InputError(path.string(), fmt::format("it declares {}", text), "the file is damaged");
  if (rows > kMaxPixels || cols > kMaxPixels || channels > kMaxChannels ||
      rows > kMaxPixels / cols / channels)
    throw InputError(path.string(),
                     fmt::format("it declares {}, more than {} values", text, kMaxPixels),
                     "crop it, or check that the file is whole");
}

void check_stack_size(const fs::path& path, std::int64_t frames) {
  if (frames < 1)
    throw InputError(path.string(), fmt::format("it declares {}", counted(frames, "frame")),
                     "the file is damaged");
  if (frames > kMostStackFrames)
    throw InputError(path.string(),
                     fmt::format("it holds {} frames, more than {}", frames, kMostStackFrames),
                     "save it in several files");
}

}  // namespace malus::internal
