#include "malus/base/error.h"
#include "malus/io/internal/interleaved.h"
#include "malus/io/internal/picture_faults.h"
#include "malus/io/internal/tiff_message.h"
#include "malus/io/internal/tiff_picture.h"

#include <algorithm>
#include <vector>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// libtiff's calls to the file.
PictureOutput& output_of(thandle_t handle) { return *static_cast<PictureOutput*>(handle); }
tmsize_t read_nothing(thandle_t, void*, tmsize_t) { return 0; }
tmsize_t write_bytes(thandle_t handle, void* bytes, tmsize_t size) {
  return static_cast<tmsize_t>(output_of(handle).write(bytes, static_cast<std::size_t>(size)));
}
toff_t seek_to(thandle_t handle, toff_t offset, int whence) {
  return output_of(handle).seek(static_cast<std::int64_t>(offset), whence);
}
int leave_open(thandle_t) { return 0; }
toff_t size_of(thandle_t handle) {
  PictureOutput& output = output_of(handle);
  const std::uint64_t place = output.place();
  const std::uint64_t size = output.seek(0, SEEK_END);
  output.seek(static_cast<std::int64_t>(place), SEEK_SET);
  return size;
}

struct StoredType {
  std::uint16_t bits, format;
};
StoredType stored_type(SampleType type) {
  if (type == SampleType::kUint8) return {8, SAMPLEFORMAT_UINT};
  if (type == SampleType::kUint16) return {16, SAMPLEFORMAT_UINT};
  return {32, SAMPLEFORMAT_IEEEFP};
}

// Where the samples would leave no room for the directory in 4 GiB.
bool needs_big_tiff(std::span<const Image> planes, StoredType stored) {
  constexpr std::size_t kMost = 0xf000'0000;
  return planes.size() * planes[0].values().size() * stored.bits / 8 > kMost;
}

constexpr std::uint32_t kStripRows = 32;

void set_fields(TIFF* tiff, std::span<const Image> planes, StoredType stored,
                const std::string& description) {
  const std::size_t channels = planes.size();
  const std::size_t colours = channels == 3 || channels == 4 ? 3 : 1;
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, static_cast<std::uint32_t>(planes[0].cols()));
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, static_cast<std::uint32_t>(planes[0].rows()));
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, stored.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, stored.format);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, static_cast<std::uint16_t>(channels));
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, COMPRESSION_NONE);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT);
  TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, kStripRows);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, colours == 3 ? PHOTOMETRIC_RGB : PHOTOMETRIC_MINISBLACK);
  // A fourth is alpha, colours not times it (picture_file.cpp); others are planes of their own.
  const std::vector<std::uint16_t> extras(
      channels - colours,
      static_cast<std::uint16_t>(channels == 4 ? EXTRASAMPLE_UNASSALPHA : EXTRASAMPLE_UNSPECIFIED));
  if (!extras.empty())
    TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, static_cast<std::uint16_t>(extras.size()),
                 extras.data());
  if (!description.empty()) TIFFSetField(tiff, TIFFTAG_IMAGEDESCRIPTION, description.c_str());
}

template <class T>
bool write_strips(TIFF* tiff, std::span<const Image> planes) {
  const int rows = planes[0].rows();
  std::uint32_t strip = 0;
  for (int row0 = 0; row0 < rows; row0 += static_cast<int>(kStripRows), ++strip) {
    std::vector<T> values =
        interleaved_rows<T>(planes, row0, std::min(rows, row0 + static_cast<int>(kStripRows)));
    if (TIFFWriteEncodedStrip(tiff, strip, values.data(),
                              static_cast<tmsize_t>(values.size() * sizeof(T))) < 0)
      return false;
  }
  return true;
}

bool write_samples(TIFF* tiff, std::span<const Image> planes, SampleType type) {
  if (type == SampleType::kUint8) return write_strips<std::uint8_t>(tiff, planes);
  if (type == SampleType::kUint16) return write_strips<std::uint16_t>(tiff, planes);
  return write_strips<float>(tiff, planes);
}

}  // namespace

void encode_tiff(PictureOutput& output, const fs::path& path, std::span<const Image> planes,
                 SampleType type, const std::string& description) {
  const StoredType stored = stored_type(type);
  TiffMessage message(path);
  OpenTiff tiff(TIFFClientOpenExt(path.c_str(), needs_big_tiff(planes, stored) ? "w8" : "w",
                                  &output, read_nothing, write_bytes, seek_to, leave_open, size_of,
                                  nullptr, nullptr, message.options()));
  if (!tiff) unwritable_picture(path, message.text());
  set_fields(tiff.get(), planes, stored, description);
  const bool good = write_samples(tiff.get(), planes, type) && TIFFWriteDirectory(tiff.get()) == 1;
  tiff.reset();
  if (!good || !message.text().empty()) unwritable_picture(path, message.text());
}

}  // namespace malus::internal
