// FITS (IAU FITS standard 4.0): the primary image, 2-D or [channel, row, column], every BITPIX,
// with BSCALE, BZERO and BLANK. The first stored row is row 0, as cameras and NumPy have it, unless
// ROWORDER says BOTTOM-UP: flipping would change the phase of the colour filter.
#pragma once

#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"

#include <filesystem>
#include <span>
#include <string>

namespace malus::internal {

/// Throws InputError; path is for messages. With pixels false only the header has to be there.
Decoded parse_fits(Bytes bytes, const std::filesystem::path& path, bool pixels = true);
Decoded read_fits(const std::filesystem::path& path, bool pixels);

enum class FitsSample { kUint8, kUint16, kFloat };
/// Integers by stored_value; description goes into COMMENT cards. Contract: at least one plane.
std::string fits_content(std::span<const Image> planes, FitsSample sample,
                         const std::string& description, std::optional<double> exposure_s);

}  // namespace malus::internal
