#include "malus/io/internal/exif.h"

#include <cmath>

namespace malus::internal {

ExifFacts exif_facts(const TiffFile& file, std::uint64_t directory) {
  constexpr std::uint64_t kMostText = 256;
  const TiffTags tags(file, directory, "directory");
  ExifFacts facts{tags.text(kCamera, kMostText), tags.rational(kExposure)};
  if (const std::uint64_t place = tags.one(kExif, 0))
    if (const auto exposure_s = TiffTags(file, place, "exposure (Exif)").rational(kExposure))
      facts.exposure_s = exposure_s;
  if (facts.exposure_s && !(*facts.exposure_s > 0 && std::isfinite(*facts.exposure_s)))
    facts.exposure_s.reset();
  return facts;
}

}  // namespace malus::internal
