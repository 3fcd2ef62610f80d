// Netpbm's binary grey and colour pictures (pgm(5), ppm(5): P5, P6), as camera programs save them:
// 8 or 16 bits, values as stored. Own code, for libraries stretch values to 16 bits.
#pragma once

#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"

#include <filesystem>

namespace malus::internal {

/// Throws InputError; path is for messages. bits are those of the declared largest value, which is
/// the white level where it is not all of them. With pixels false only the header has to be there.
Decoded parse_netpbm(Bytes bytes, const std::filesystem::path& path, bool pixels = true);
/// InputError where a file begins as one of Netpbm's other kinds (written in digits, P1 to P3;
/// bitmaps, P4; PAM, P7).
void refuse_other_netpbm(Bytes head, const std::filesystem::path& path);

Decoded read_netpbm(const std::filesystem::path& path, bool pixels);

}  // namespace malus::internal
