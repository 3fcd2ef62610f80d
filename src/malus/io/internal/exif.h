// What Exif tells of a frame (Exif 2.3, section 4.6): the directory of a TIFF file, or a whole TIFF
// structure within a file of another kind.
#pragma once

#include "malus/io/internal/tiff_file.h"

#include <optional>
#include <string>

namespace malus::internal {

struct ExifFacts {
  std::string camera;
  std::optional<double> exposure_s, iso;  ///< above 0
};

/// Of the directory at this place. Throws InputError where a directory does not lie within the
/// file; single values that do not are passed over.
ExifFacts exif_facts(const TiffFile& file, std::uint64_t directory);

}  // namespace malus::internal
