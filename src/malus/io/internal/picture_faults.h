// What all picture decoders and encoders refuse, in the same words.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace malus::internal {

/// detail: the decoder's own message, or empty. Throws InputError.
[[noreturn]] void unreadable_picture(const std::filesystem::path& path, std::string detail);

/// Throws InputError where a picture is beyond the limits of decoded.h, or is more than a file of
/// this size can hold. bits: of one sample.
void check_plausible(const std::filesystem::path& path, std::uintmax_t file_bytes,
                     std::int64_t rows, std::int64_t cols, std::int64_t channels, int bits);

/// Throws InputError: the encoder's own message says why a picture cannot be written.
[[noreturn]] void unwritable_picture(const std::filesystem::path& path, const std::string& detail);

}  // namespace malus::internal
