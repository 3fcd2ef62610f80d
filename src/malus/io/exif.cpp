#include "malus/io/internal/exif.h"

#include <cmath>

namespace malus::internal {
namespace {

// Exif 2.3, annex G: 65535 stands for what two bytes do not hold, or for "unknown".
std::optional<double> iso_of(const TiffTags& tags) {
  constexpr std::uint64_t kElsewhere = 65535;
  std::uint64_t iso = tags.one(kIso, 0);
  if (iso == 0 || iso == kElsewhere)
    iso = tags.one(kIsoSpeed, tags.one(kRecommendedExposureIndex, 0));
  if (iso == 0) return std::nullopt;
  return static_cast<double>(iso);
}

}  // namespace

ExifFacts exif_facts(const TiffFile& file, std::uint64_t directory) {
  constexpr std::uint64_t kMostText = 256;
  const TiffTags tags(file, directory, "directory");
  ExifFacts facts{tags.text(kCamera, kMostText), tags.rational(kExposure), iso_of(tags)};
  if (const std::uint64_t place = tags.one(kExif, 0)) {
    const TiffTags exif(file, place, "exposure (Exif)");
    if (const auto exposure_s = exif.rational(kExposure)) facts.exposure_s = exposure_s;
    if (const auto iso = iso_of(exif)) facts.iso = iso;
  }
  if (facts.exposure_s && !(*facts.exposure_s > 0 && std::isfinite(*facts.exposure_s)))
    facts.exposure_s.reset();
  return facts;
}

}  // namespace malus::internal
