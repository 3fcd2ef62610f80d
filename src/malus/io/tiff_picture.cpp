#include "malus/io/internal/tiff_picture.h"

#include "malus/base/error.h"
#include "malus/io/internal/exif.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/interleaved.h"
#include "malus/io/internal/picture_faults.h"
#include "malus/io/internal/tiff_check.h"
#include "malus/io/internal/tiff_inflate.h"
#include "malus/io/internal/tiff_message.h"

#include <algorithm>
#include <string_view>
#include <vector>

#include <Imath/half.h>
#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void damaged_tiff(const fs::path& path, std::string detail) {
  // libtiff's -1, where a whole strip is read.
  constexpr std::string_view kNoLine = " at scanline 4294967295";
  if (const std::size_t at = detail.find(kNoLine); at != detail.npos)
    detail.erase(at, kNoLine.size());
  unreadable_picture(path, std::move(detail));
}

// How the samples of a picture lie in its file (TIFF 6.0, section 8).
struct TiffSamples {
  std::uint32_t rows = 0, cols = 0, depth = 1;
  std::uint16_t channels = 1, bits = 1, format = SAMPLEFORMAT_UINT,
                photometric = PHOTOMETRIC_MINISBLACK, planar = PLANARCONFIG_CONTIG;

  // As numbers of a palette, or as brightness and differences: libtiff makes RGB of 8 bits of them.
  bool codes_colours() const {
    return photometric == PHOTOMETRIC_PALETTE || photometric == PHOTOMETRIC_YCBCR;
  }
  bool is_integer() const { return format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_VOID; }
};

TiffSamples samples_of(TIFF* tiff) {
  TiffSamples samples;
  TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &samples.rows);
  TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &samples.cols);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_IMAGEDEPTH, &samples.depth);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &samples.channels);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &samples.bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &samples.format);
  TIFFGetField(tiff, TIFFTAG_PHOTOMETRIC, &samples.photometric);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &samples.planar);
  return samples;
}

std::string type_name(const TiffSamples& samples) {
  if (samples.is_integer() && samples.bits <= 8) return "uint8";
  if (samples.is_integer() && samples.bits <= 16) return "uint16";
  if (samples.format == SAMPLEFORMAT_IEEEFP && samples.bits == 16) return "half";
  if (samples.format == SAMPLEFORMAT_IEEEFP && samples.bits == 32) return "float";
  if (samples.format == SAMPLEFORMAT_IEEEFP && samples.bits == 64) return "double";
  return {};
}

// What the samples mean where that is not an amount of light, or of a primary colour's.
std::string_view other_meaning(std::uint16_t photometric) {
  constexpr std::uint16_t kLinearRaw = 34892;  // of DNG
  switch (photometric) {
    case PHOTOMETRIC_MINISWHITE:  // Decoded::negative
    case PHOTOMETRIC_MINISBLACK:
    case PHOTOMETRIC_RGB:
    case PHOTOMETRIC_PALETTE:
    case PHOTOMETRIC_YCBCR:
    case PHOTOMETRIC_CFA:
    case kLinearRaw:
      return {};
    case PHOTOMETRIC_MASK:
      return "a mask";
    case PHOTOMETRIC_SEPARATED:
      return "inks (CMYK)";
    case PHOTOMETRIC_CIELAB:
    case PHOTOMETRIC_ICCLAB:
    case PHOTOMETRIC_ITULAB:
      return "L*a*b* colours";
    case PHOTOMETRIC_LOGL:
    case PHOTOMETRIC_LOGLUV:
      return "logarithms of light";
    default:
      return "of an unknown photometric interpretation";
  }
}

void check_samples(const fs::path& path, const TiffSamples& samples) {
  if (const auto meaning = other_meaning(samples.photometric); !meaning.empty())
    throw InputError(path.string(), fmt::format("its samples are {}", meaning),
                     "store grey (0 is black) or RGB");
  if (samples.depth > 1)
    throw InputError(path.string(), "it is a volume", "save its layers as pages");
  if (type_name(samples).empty())
    throw InputError(path.string(),
                     fmt::format("samples of type {}{} are not read",
                                 samples.is_integer()                    ? "uint"
                                 : samples.format == SAMPLEFORMAT_INT    ? "int"
                                 : samples.format == SAMPLEFORMAT_IEEEFP ? "float"
                                                                         : "complex",
                                 samples.bits),
                     "store 8 or 16 bit unsigned integers or floats");
}

// As OpenEXR and most programs call them; the others get numbers.
std::vector<std::string> channel_names_of(TIFF* tiff, const TiffSamples& samples) {
  std::uint16_t extras = 0;
  const std::uint16_t* kinds = nullptr;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_EXTRASAMPLES, &extras, &kinds);
  const int colours = samples.channels - std::min(extras, samples.channels);
  const bool has_alpha = extras == 1 && kinds[0] != EXTRASAMPLE_UNSPECIFIED;
  if (has_alpha && colours == 1) return {"Y", "A"};
  if (has_alpha && colours == 3) return {"R", "G", "B", "A"};
  if (samples.channels != 4) return {};
  return {"C00", "C01", "C02", "C03"};
}

// Packed from the highest bit on; each row begins with a byte.
std::uint32_t packed_value(Bytes row, std::size_t index, unsigned bits) {
  std::uint32_t value = 0;
  for (std::size_t at = index * bits; at < (index + 1) * bits; ++at)
    value = value << 1 | (row[at / 8] >> (7 - at % 8) & 1u);
  return value;
}

// In the machine's byte order, as libtiff hands it over.
template <class T>
T whole_value(Bytes row, std::size_t index) {
  return load_number<T>(row, index * sizeof(T), kBigEndianMachine);
}

void take_tiff_row(const TiffSamples& samples, Bytes row, const RowPart& part, Planes& planes) {
  const auto take = [&](const auto& sample) { take_interleaved(part, planes, sample); };
  if (samples.is_integer() && samples.bits == 8)
    take([&](std::size_t i) { return row[i]; });
  else if (samples.is_integer() && samples.bits == 16)
    take([&](std::size_t i) { return whole_value<std::uint16_t>(row, i); });
  else if (samples.is_integer())
    take([&](std::size_t i) { return packed_value(row, i, samples.bits); });
  else if (samples.bits == 16)
    take([&](std::size_t i) { return imath_half_to_float(whole_value<std::uint16_t>(row, i)); });
  else if (samples.bits == 32)
    take([&](std::size_t i) { return whole_value<float>(row, i); });
  else
    take([&](std::size_t i) { return whole_value<double>(row, i); });
}

// One after the other, or all in one.
struct TiffSheets {
  int count, channels;
};

TiffSheets sheets_of(const TiffSamples& samples) {
  if (samples.planar == PLANARCONFIG_SEPARATE) return {samples.channels, 1};
  return {1, samples.channels};
}

void read_strips(TIFF* tiff, const TiffSamples& samples, Planes& planes,
                 const TiffMessage& message) {
  const TiffSheets sheets = sheets_of(samples);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(TIFFScanlineSize64(tiff)));
  for (int sheet = 0; sheet < sheets.count; ++sheet)
    for (int r = 0; r < planes.rows(); ++r) {
      if (TIFFReadScanline(tiff, bytes.data(), static_cast<std::uint32_t>(r),
                           static_cast<std::uint16_t>(sheet)) < 0)
        damaged_tiff(message.path(), message.text());
      take_tiff_row(samples, bytes, {r, 0, planes.cols(), sheet, sheets.channels}, planes);
    }
}

void read_tiles(TIFF* tiff, const TiffSamples& samples, std::uintmax_t file_bytes, Planes& planes,
                const TiffMessage& message) {
  std::uint32_t tile_rows = 0, tile_cols = 0;
  TIFFGetField(tiff, TIFFTAG_TILELENGTH, &tile_rows);
  TIFFGetField(tiff, TIFFTAG_TILEWIDTH, &tile_cols);
  const TiffSheets sheets = sheets_of(samples);
  check_plausible(message.path(), file_bytes, tile_rows, tile_cols, sheets.channels, samples.bits);
  const auto high = static_cast<int>(tile_rows), wide = static_cast<int>(tile_cols);
  const auto row_bytes = static_cast<std::size_t>(TIFFTileRowSize64(tiff));
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(TIFFTileSize64(tiff)));
  for (int sheet = 0; sheet < sheets.count; ++sheet)
    for (int row0 = 0; row0 < planes.rows(); row0 += high)
      for (int col0 = 0; col0 < planes.cols(); col0 += wide) {
        if (TIFFReadTile(tiff, bytes.data(), static_cast<std::uint32_t>(col0),
                         static_cast<std::uint32_t>(row0), 0,
                         static_cast<std::uint16_t>(sheet)) < 0)
          damaged_tiff(message.path(), message.text());
        const int cols = std::min(wide, planes.cols() - col0);
        for (int r = row0; r < std::min(row0 + high, planes.rows()); ++r)
          take_tiff_row(samples,
                        Bytes(bytes).subspan(static_cast<std::size_t>(r - row0) * row_bytes),
                        {r, col0, cols, sheet, sheets.channels}, planes);
      }
}

void read_colours(TIFF* tiff, Planes& planes, const TiffMessage& message) {
  constexpr int kStopAtDamage = 1;
  std::vector<std::uint32_t> colours(planes[0].values().size());
  if (TIFFReadRGBAImageOriented(tiff, static_cast<std::uint32_t>(planes.cols()),
                                static_cast<std::uint32_t>(planes.rows()), colours.data(),
                                ORIENTATION_TOPLEFT, kStopAtDamage) == 0)
    damaged_tiff(message.path(), message.text());
  for (int k = 0; k < planes.channels(); ++k)
    for (std::size_t i = 0; i < colours.size(); ++i)
      planes[k].values()[i] = static_cast<float>(colours[i] >> (8 * k) & 0xff);
}

}  // namespace

Decoded read_tiff(const fs::path& path, std::uintmax_t file_bytes, std::uint64_t directory,
                  bool pixels) {
  check_tiff(path, file_bytes, directory);
  TiffMessage message(path);
  // m: not mapped, for a file that is cut while it is read would end the program; h: the header
  // alone, since a stack's frames lie anywhere.
  const OpenTiff tiff(TIFFOpenExt(path.c_str(), "rmh", message.options()));
  if (!tiff || TIFFSetSubDirectory(tiff.get(), directory) == 0) damaged_tiff(path, message.text());
  const TiffSamples samples = samples_of(tiff.get());
  check_samples(path, samples);
  check_plausible(path, file_bytes, samples.rows, samples.cols, samples.channels, samples.bits);

  Decoded decoded;
  decoded.format = "tiff";
  decoded.sample = type_name(samples);
  decoded.sheets = samples.channels > 1 && samples.planar == PLANARCONFIG_SEPARATE;
  decoded.negative = samples.photometric == PHOTOMETRIC_MINISWHITE;
  decoded.rows = static_cast<int>(samples.rows);
  decoded.cols = static_cast<int>(samples.cols);
  decoded.channels = samples.codes_colours() ? 3 : samples.channels;
  decoded.bits = samples.codes_colours() ? 8 : samples.is_integer() ? samples.bits : 0;
  if (!samples.codes_colours()) decoded.names = channel_names_of(tiff.get(), samples);
  if (const char* text = nullptr; TIFFGetField(tiff.get(), TIFFTAG_IMAGEDESCRIPTION, &text) == 1)
    decoded.description = text;
  const ExifFacts exif = exif_facts(tiff_file(path, file_bytes), directory);
  decoded.camera = exif.camera;
  decoded.exposure_s = exif.exposure_s;
  decoded.gain.iso = exif.iso;
  if (!pixels) return decoded;
  check_deflated(path, file_bytes, directory);
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  if (samples.codes_colours())
    read_colours(tiff.get(), decoded.planes, message);
  else if (TIFFIsTiled(tiff.get()) != 0)
    read_tiles(tiff.get(), samples, file_bytes, decoded.planes, message);
  else
    read_strips(tiff.get(), samples, decoded.planes, message);
  return decoded;
}

}  // namespace malus::internal
