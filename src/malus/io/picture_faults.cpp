#include "malus/io/internal/picture_faults.h"

#include "malus/base/error.h"
#include "malus/io/internal/file_bytes.h"

#include <fmt/format.h>

namespace malus::internal {

namespace fs = std::filesystem;

void unreadable_picture(const fs::path& path, std::string detail) {
  while (!detail.empty() && (detail.back() == '\n' || detail.back() == '.')) detail.pop_back();
  throw InputError(path.string(),
                   fmt::format("cannot be decoded{}{}", detail.empty() ? "" : ": ", detail),
                   "the file is damaged or cut off: copy or record it again");
}

// Deflate cannot shrink by more than 1032, the strongest of the codecs (JPEG spends a bit on each
// block of a scan, of 256 pixels at most where colours are halved: 1024): a file that declares more
// is damaged, and would only waste memory.
void check_plausible(const fs::path& path, std::uintmax_t file_bytes, std::int64_t rows,
                     std::int64_t cols, std::int64_t channels, int bits) {
  check_picture_size(path, rows, cols, channels);
  constexpr std::uintmax_t kMaxRatio = 1100, kSlack = 1 << 20;
  const auto samples = static_cast<std::uintmax_t>(rows * cols * channels);
  if (samples / 8 * static_cast<std::uintmax_t>(bits) > kMaxRatio * file_bytes + kSlack)
    throw InputError(path.string(),
                     fmt::format("{} bytes cannot hold the {}x{} pixels of {} channels it declares",
                                 file_bytes, cols, rows, channels),
                     "check that the file is whole");
}

void unwritable_picture(const fs::path& path, const std::string& detail) {
  throw InputError(path.string(), fmt::format("cannot be encoded: {}", detail),
                   "use another format");
}

}  // namespace malus::internal
