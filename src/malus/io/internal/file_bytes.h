// Files as bytes, with the checks that every reader needs first.
#pragma once

#include <bit>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace malus::internal {

using Bytes = std::span<const std::uint8_t>;

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using OpenFile = std::unique_ptr<std::FILE, CloseFile>;

/// Size of a regular, readable, non-empty file; throws InputError otherwise.
std::uintmax_t require_file(const std::filesystem::path& path);

/// The first `limit` bytes, or all of a shorter file.
std::vector<std::uint8_t> read_bytes(const std::filesystem::path& path,
                                     std::uintmax_t limit = UINTMAX_MAX);

/// Whether the bytes begin with this text.
bool begins_with(Bytes bytes, std::string_view text);

/// A text file that somebody writes, `what` ("the session file"). Throws InputError beyond 64 MiB.
std::string read_text(const std::filesystem::path& path, std::string_view what);

/// `bytes` bytes from `at` on. Contract: they are in the file. Throws InputError where they cannot
/// be read.
std::vector<std::uint8_t> read_part(const std::filesystem::path& path, std::uintmax_t at,
                                    std::size_t bytes);

/// Throws InputError unless 1 <= rows, cols, channels and the picture is within the limits of
/// decoded.h.
void check_picture_size(const std::filesystem::path& path, std::int64_t rows, std::int64_t cols,
                        std::int64_t channels);

/// Throws InputError unless a file may hold this many frames: 1 to kMostStackFrames.
void check_stack_size(const std::filesystem::path& path, std::int64_t frames);

inline constexpr bool kBigEndianMachine = std::endian::native == std::endian::big;

/// One stored number; contract: bytes holds sizeof(T) at offset.
template <class T>
T load_number(Bytes bytes, std::size_t offset, bool big_endian) {
  T value;
  std::uint8_t raw[sizeof(T)];
  std::memcpy(raw, bytes.data() + offset, sizeof(T));
  if (big_endian != kBigEndianMachine)
    for (std::size_t i = 0; i < sizeof(T) / 2; ++i) std::swap(raw[i], raw[sizeof(T) - 1 - i]);
  std::memcpy(&value, raw, sizeof(T));
  return value;
}

}  // namespace malus::internal
