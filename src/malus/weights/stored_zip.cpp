#include "malus/weights/internal/stored_zip.h"

#include "malus/base/error.h"

#include <algorithm>
#include <optional>

#include <fmt/format.h>
#include <zlib.h>

namespace malus {
namespace {

constexpr std::uint32_t kLocalHeader = 0x04034b50, kCentralHeader = 0x02014b50, kEnd = 0x06054b50,
                        kEnd64 = 0x06064b50, kEnd64Locator = 0x07064b50;
constexpr std::uint64_t kEndSize = 22, kLocatorSize = 20, kEnd64Size = 56, kCentralSize = 46,
                        kLocalSize = 30;
constexpr std::uint64_t kLongestComment = 0xffff;
constexpr std::uint16_t kZip64Extra = 1;
constexpr std::uint32_t kIn64 = 0xffffffff;  // the value is in the ZIP64 part

class Reader {
 public:
  Reader(std::span<const std::byte> bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  std::map<std::string, ZipEntry> entries() const {
    const auto [at, size, count] = directory();
    std::map<std::string, ZipEntry> found;
    std::uint64_t place = at;
    for (std::uint64_t i = 0; i < count; ++i) place = read_entry(place, at + size, found);
    return found;
  }

 private:
  struct Directory {
    std::uint64_t at, size, count;
  };

  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(name_, problem, "copy the file again, or save it again with torch.save");
  }
  std::span<const std::byte> part(std::uint64_t at, std::uint64_t size) const {
    if (at > bytes_.size() || size > bytes_.size() - at) fail("is no whole archive");
    return bytes_.subspan(static_cast<std::size_t>(at), static_cast<std::size_t>(size));
  }
  // Little-endian.
  std::uint64_t number(std::uint64_t at, std::uint64_t size) const {
    const auto bytes = part(at, size);
    std::uint64_t value = 0;
    for (std::size_t i = bytes.size(); i-- > 0;)
      value = value << 8 | std::to_integer<std::uint64_t>(bytes[i]);
    return value;
  }

  // The record at the end may have a comment behind it.
  std::uint64_t find_end() const {
    if (bytes_.size() >= kEndSize) {
      const std::uint64_t last = bytes_.size() - kEndSize;
      const std::uint64_t first = last - std::min(last, kLongestComment);
      for (std::uint64_t at = last + 1; at-- > first;)
        if (number(at, 4) == kEnd && number(at + 20, 2) == bytes_.size() - at - kEndSize) return at;
    }
    fail("is no whole archive");
  }

  Directory directory() const {
    const std::uint64_t end = find_end();
    Directory found{number(end + 16, 4), number(end + 12, 4), number(end + 10, 2)};
    if (end >= kLocatorSize && number(end - kLocatorSize, 4) == kEnd64Locator) {
      const std::uint64_t end64 = number(end - kLocatorSize + 8, 8);
      part(end64, kEnd64Size);
      if (number(end64, 4) != kEnd64) fail("is no whole archive");
      found = {number(end64 + 48, 8), number(end64 + 40, 8), number(end64 + 32, 8)};
    }
    part(found.at, found.size);
    if (found.count > found.size / kCentralSize) fail("has a directory that does not fit");
    return found;
  }

  // Adds the entry whose header is at place; result: where the next one is.
  std::uint64_t read_entry(std::uint64_t place, std::uint64_t end,
                           std::map<std::string, ZipEntry>& found) const {
    if (place > end || end - place < kCentralSize || number(place, 4) != kCentralHeader)
      fail("has a directory that does not fit");
    const std::uint64_t name_size = number(place + 28, 2), extra_size = number(place + 30, 2),
                        comment_size = number(place + 32, 2);
    const std::uint64_t name_at = place + kCentralSize, extra_at = name_at + name_size,
                        next = extra_at + extra_size + comment_size;
    if (next > end) fail("has a directory that does not fit");
    const auto letters = part(name_at, name_size);
    const std::string entry{reinterpret_cast<const char*>(letters.data()), letters.size()};
    std::uint64_t size = number(place + 24, 4), packed = number(place + 20, 4),
                  local = number(place + 42, 4);
    read_zip64(extra_at, extra_size, {&size, &packed, &local});
    constexpr std::uint64_t kEncrypted = 1;
    if (number(place + 10, 2) != 0 || size != packed || (number(place + 8, 2) & kEncrypted) != 0)
      fail("holds packed entries, which torch.save does not write");
    if (number(local, 4) != kLocalHeader) fail("is no whole archive");
    const std::uint64_t data = local + kLocalSize + number(local + 26, 2) + number(local + 28, 2);
    const ZipEntry value{part(data, size), static_cast<std::uint32_t>(number(place + 16, 4))};
    if (!found.emplace(entry, value).second) fail("holds two entries of one name");
    return next;
  }

  // Those of the values that do not fit into 32 bits stand in an extra field, in this order.
  void read_zip64(std::uint64_t at, std::uint64_t size,
                  std::initializer_list<std::uint64_t*> values) const {
    const std::uint64_t end = at + size;
    while (end - at >= 4) {
      const std::uint64_t tag = number(at, 2), length = number(at + 2, 2);
      at += 4;
      if (length > end - at) fail("has a directory that does not fit");
      std::uint64_t inside = at;
      at += length;
      if (tag != kZip64Extra) continue;
      for (std::uint64_t* value : values) {
        if (*value != kIn64) continue;
        if (at - inside < 8) fail("has a directory that does not fit");
        *value = number(inside, 8);
        inside += 8;
      }
    }
  }

  std::span<const std::byte> bytes_;
  const std::string& name_;
};

}  // namespace

std::map<std::string, ZipEntry> parse_stored_zip(std::span<const std::byte> archive,
                                                 const std::string& name) {
  return Reader(archive, name).entries();
}

bool intact(const ZipEntry& entry) {
  const auto* bytes = reinterpret_cast<const Bytef*>(entry.bytes.data());
  return crc32_z(crc32_z(0, nullptr, 0), bytes, entry.bytes.size()) == entry.crc32;
}

}  // namespace malus
