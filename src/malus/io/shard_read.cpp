#include "malus/io/shard_read.h"

#include "malus/base/error.h"
#include "malus/base/unreadable_file.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/tar.h"

#include <algorithm>
#include <cstring>
#include <fstream>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::kTarBlock;
constexpr const char* kRemedy = "give a shard that malus dataset wrote";

// Octal text of a ustar header field; a damaged one throws.
std::uint64_t octal(const std::string& header, std::size_t at, std::size_t length,
                    const std::filesystem::path& path) {
  std::uint64_t value = 0;
  for (std::size_t i = at; i < at + length; ++i) {
    const char c = header[i];
    if (c == '\0' || c == ' ') break;
    if (c < '0' || c > '7') throw InputError(path.string(), "has a damaged tar header", kRemedy);
    value = value * 8 + static_cast<std::uint64_t>(c - '0');
  }
  return value;
}

void check_header(const std::string& header, const std::filesystem::path& path) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < kTarBlock; ++i)
    sum += i >= 148 && i < 156 ? ' ' : static_cast<unsigned char>(header[i]);
  if (header.compare(257, 5, "ustar") != 0 || octal(header, 148, 8, path) != sum)
    throw InputError(path.string(), "is not a tar archive or is damaged", kRemedy);
}

}  // namespace

std::vector<ShardEntry> shard_entries(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in || std::filesystem::is_directory(path)) throw unreadable_file(path);
  const auto total = static_cast<std::uint64_t>(in.tellg());
  std::vector<ShardEntry> entries;
  std::string header(kTarBlock, '\0');
  for (std::uint64_t at = 0;;) {
    // A block of zeros ends an archive: one that lacks it may have lost whole files besides.
    if (total < kTarBlock || at > total - kTarBlock)
      throw InputError(path.string(), "is cut off", kRemedy);
    in.seekg(static_cast<std::streamoff>(at));
    if (!in.read(header.data(), kTarBlock))
      throw InputError(path.string(), "cannot be read", kRemedy);
    if (std::all_of(header.begin(), header.end(), [](char c) { return c == '\0'; })) return entries;
    check_header(header, path);
    const std::uint64_t size = octal(header, 124, 12, path);
    at += kTarBlock;
    if (size > total - at) throw InputError(path.string(), "is cut off", kRemedy);
    if (header[156] == '0' || header[156] == '\0')
      entries.push_back({std::string(header.c_str(), strnlen(header.c_str(), 100)), at, size});
    at += (size + kTarBlock - 1) / kTarBlock * kTarBlock;
  }
}

std::string shard_content(const std::filesystem::path& path, const ShardEntry& entry) {
  std::ifstream in(path, std::ios::binary);
  in.seekg(static_cast<std::streamoff>(entry.offset));
  std::string content(entry.size, '\0');
  in.read(content.data(), static_cast<std::streamsize>(content.size()));
  if (!in) throw InputError(path.string(), "cannot be read", kRemedy);
  return content;
}

Planes planes_of_npy(const std::string& content, const std::string& name) {
  const internal::Bytes bytes{reinterpret_cast<const std::uint8_t*>(content.data()),
                              content.size()};
  return internal::parse_npy(bytes, name, internal::NpyAxes::kChannelsFirst).planes;
}

}  // namespace malus
