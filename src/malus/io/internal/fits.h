// FITS (IAU FITS standard 4.0): the primary image, 2-D or [channel, row, column], every BITPIX,
// with BSCALE, BZERO and BLANK. The first stored row is row 0, as cameras and NumPy have it, unless
// ROWORDER says BOTTOM-UP: flipping would change the phase of the colour filter.
#pragma once

#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"

#include <filesystem>
#include <optional>
#include <span>
#include <string>

namespace malus::internal {

inline constexpr std::size_t kFitsCard = 80, kFitsBlock = 2880;

/// Throws InputError; path is for messages. With pixels false only the header has to be there.
Decoded parse_fits(Bytes bytes, const std::filesystem::path& path, bool pixels = true);

/// Whether a file begins as one does.
bool begins_as_fits(Bytes head);

/// How many frames the file holds: the third axis. Reads its headers, and throws InputError where
/// the file is shorter than that says, or where image extensions of the same size and type follow.
int fits_frames(const std::filesystem::path& path);

/// The file, or its header alone; with `frame` that frame alone, of which no other's pixels are
/// read. Contract: frame is below fits_frames.
Decoded read_fits(const std::filesystem::path& path, bool pixels,
                  std::optional<int> frame = std::nullopt);

enum class FitsSample { kUint8, kUint16, kFloat };
/// Integers by stored_value; description goes into COMMENT cards. Contract: at least one plane.
std::string fits_content(std::span<const Image> planes, FitsSample sample,
                         const std::string& description, std::optional<double> exposure_s);

}  // namespace malus::internal
