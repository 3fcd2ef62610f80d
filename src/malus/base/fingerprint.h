// Contents told apart by 64 bits.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

#include <fmt/format.h>

namespace malus {

/// FNV-1a of bytes that are added one after the other (Fowler, Noll, Vo). It keeps nobody from
/// forging them.
class Fingerprint {
 public:
  void add(std::string_view bytes) {
    for (const char byte : bytes)
      value_ = (value_ ^ static_cast<unsigned char>(byte)) * 0x100000001b3u;
  }
  /// 16 hexadecimal digits.
  std::string text() const { return fmt::format("{:016x}", value_); }

 private:
  std::uint64_t value_ = 0xcbf29ce484222325u;
};

/// Of a whole file. Throws InputError where it cannot be read.
std::string file_fingerprint(const std::filesystem::path& path);

}  // namespace malus
