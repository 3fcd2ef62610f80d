#include "malus/io/shard.h"

#include "malus/base/error.h"
#include "malus/io/internal/glob.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/tar.h"

#include <array>
#include <cstring>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::kTarBlock;

// The ustar header (IEEE Std 1003.1-1988, "pax", Table 4-13): numbers are octal text.
std::string header_of(std::string_view name, std::size_t size) {
  std::string h(kTarBlock, '\0');
  const auto put = [&h](std::size_t at, std::string_view text) {
    std::memcpy(h.data() + at, text.data(), text.size());
  };
  put(0, name);
  put(100, "0000644");
  put(108, "0000000");
  put(116, "0000000");
  put(124, fmt::format("{:011o}", size));
  put(136, "00000000000");
  put(148, "        ");  // the checksum counts itself as blanks
  put(156, "0");
  put(257, std::string_view("ustar\0"
                            "00",
                            8));
  unsigned sum = 0;
  for (const char c : h) sum += static_cast<unsigned char>(c);
  put(148, fmt::format("{:06o}", sum));
  h[154] = '\0';
  return h;
}

}  // namespace

std::string npy_bytes(const Planes& planes) {
  return internal::npy_content(planes, internal::NpySample::kFloat);
}

std::vector<std::filesystem::path> files_matching(const std::filesystem::path& folder,
                                                  const std::string& pattern) {
  return internal::expand_glob(folder, pattern);
}

TarShard::TarShard(const std::filesystem::path& path, bool force)
    : file_(path, force), stream_(file_.temporary(), std::ios::binary) {
  if (!stream_) file_.fail();
}

void TarShard::write(std::string_view bytes) {
  stream_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  if (!stream_) file_.fail();
}

void TarShard::add(std::string_view name, std::string_view content) {
  MALUS_REQUIRE(!name.empty() && name.size() <= 100 && content.size() < (std::size_t{1} << 33));
  write(header_of(name, content.size()));
  write(content);
  const std::size_t rest = content.size() % kTarBlock;
  if (rest > 0) write(std::string(kTarBlock - rest, '\0'));
}

void TarShard::commit() {
  write(std::string(2 * kTarBlock, '\0'));
  stream_.close();
  if (!stream_) file_.fail();
  file_.commit();
}

}  // namespace malus
