#include "malus/io/internal/picture_codec.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/internal/bmp_check.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/jpeg_check.h"
#include "malus/io/internal/png_check.h"
#include "malus/io/internal/stored_value.h"
#include "malus/io/internal/tiff_check.h"
#include "malus/io/internal/tiff_file.h"
#include "malus/io/internal/tiff_inflate.h"

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;
using OIIO::TypeDesc;

[[noreturn]] void unreadable(const fs::path& path, std::string detail) {
  detail = detail.substr(0, detail.find('\n'));  // the first of many is the cause
  // libtiff's -1, where a whole strip is read.
  constexpr std::string_view kNoLine = " at scanline 4294967295";
  if (const std::size_t at = detail.find(kNoLine); at != detail.npos)
    detail.erase(at, kNoLine.size());
  while (!detail.empty() && (detail.back() == '\n' || detail.back() == '.')) detail.pop_back();
  throw InputError(path.string(),
                   fmt::format("cannot be decoded{}{}", detail.empty() ? "" : ": ", detail),
                   "the file is damaged or cut off: copy or record it again");
}

std::string sample_name(TypeDesc type) {
  switch (type.basetype) {
    case TypeDesc::UINT8:
      return "uint8";
    case TypeDesc::UINT16:
      return "uint16";
    case TypeDesc::UINT32:
      return "uint32";
    case TypeDesc::HALF:
      return "half";
    case TypeDesc::FLOAT:
      return "float";
    case TypeDesc::DOUBLE:
      return "double";
    default:
      return {};
  }
}

// Deflate cannot shrink by more than 1032, the strongest of the codecs (JPEG spends a bit on each
// block of a scan, of 256 pixels at most where colours are halved: 1024): a file that declares more
// is damaged, and would only waste memory.
void check_plausible(const fs::path& path, const OIIO::ImageSpec& spec, std::uintmax_t file_bytes) {
  check_picture_size(path, spec.height, spec.width, spec.nchannels);
  constexpr std::uintmax_t kMaxRatio = 1100, kSlack = 1 << 20;
  if (spec.image_bytes(true) > kMaxRatio * file_bytes + kSlack)
    throw InputError(path.string(),
                     fmt::format("{} bytes cannot hold the {}x{} pixels of {} channels it declares",
                                 file_bytes, spec.width, spec.height, spec.nchannels),
                     "check that the file is whole");
}

// libpng prints where it meets damage, libtiff passes over what is missing, and libjpeg reserves
// memory when the file is opened.
void check_before_opening(const fs::path& path, const std::string& codec, std::uintmax_t file_bytes,
                          std::uint64_t directory) {
  if (codec == "png") check_png(read_bytes(path), path);
  if (codec == "tiff") check_tiff(path, file_bytes, directory);
  if (codec == "bmp") check_bmp(read_bytes(path, kBmpHead), file_bytes, path);
  if (codec != "jpeg") return;
  const JpegSize size = check_jpeg(read_bytes(path), path);
  check_plausible(path, OIIO::ImageSpec(size.cols, size.rows, size.channels, TypeDesc::UINT8),
                  file_bytes);
}

// Of a TIFF file's pages one is meant.
void check_single(const fs::path& path, const std::string& codec, OIIO::ImageInput& input,
                  const OIIO::ImageSpec& spec) {
  if (spec.deep) unreadable(path, "it is a deep picture");
  if (spec.depth > 1) unreadable(path, "it is a volume");
  if (codec == "tiff") return;
  if (!input.seek_subimage(1, 0)) {
    input.geterror();  // there is no second one, as hoped
    input.seek_subimage(0, 0);
    return;
  }
  throw InputError(path.string(), "it holds several pictures (parts)",
                   "split it into one file per frame");
}

// A TIFF file as if the directory at some place were its first. libtiff goes to the page N from
// the first on, and reads N directories for it.
class PageFile final : public OIIO::Filesystem::IOFile {
 public:
  PageFile(const TiffFile& file, std::uint64_t directory)
      : IOFile(file.path.string(), Read), link_at_(file.link_at()) {
    for (std::uint64_t i = 0; i < file.number_bytes(); ++i) {
      const std::uint64_t byte = file.big_endian ? file.number_bytes() - 1 - i : i;
      link_.push_back(static_cast<unsigned char>(directory >> (8 * byte)));
    }
  }
  size_t read(void* bytes, size_t size) override {
    const auto at = static_cast<std::uint64_t>(tell());
    return with_link(bytes, IOFile::read(bytes, size), at);
  }
  size_t pread(void* bytes, size_t size, int64_t offset) override {
    return with_link(bytes, IOFile::pread(bytes, size, offset), static_cast<std::uint64_t>(offset));
  }

 private:
  size_t with_link(void* bytes, size_t size, std::uint64_t at) const {
    for (std::size_t i = 0; i < link_.size(); ++i)
      if (const std::uint64_t place = link_at_ + i; place >= at && place - at < size)
        static_cast<unsigned char*>(bytes)[place - at] = link_[i];
    return size;
  }

  std::uint64_t link_at_;
  std::vector<unsigned char> link_;
};

// Where the page is not the file's first; else the file is read as it is.
std::unique_ptr<PageFile> page_file(const fs::path& path, const std::string& codec,
                                    std::uintmax_t file_bytes, std::uint64_t directory) {
  if (codec != "tiff") return nullptr;
  const TiffFile file = tiff_file(path, file_bytes);
  return file.first_directory == directory ? nullptr : std::make_unique<PageFile>(file, directory);
}

// A cut-off TIFF "succeeds" with black strips and leaves only a message behind.
void read_stored(const fs::path& path, OIIO::ImageInput& input, const OIIO::ImageSpec& spec,
                 TypeDesc type, void* pixels) {
  const bool good = input.read_image(0, 0, 0, spec.nchannels, type, pixels);
  const std::string message = input.geterror();
  if (!good || !message.empty()) unreadable(path, message);
}

// OpenImageIO turns TIFF samples whose white is 0 round, but those of 8 bits and fewer alone:
// pixels are wanted as stored.
bool is_turned(const OIIO::ImageSpec& spec) {
  constexpr int kWhiteIsZero = 0, kBlackIsZero = 1;
  return spec.format == TypeDesc::UINT8 &&
         spec.get_int_attribute("tiff:PhotometricInterpretation", kBlackIsZero) == kWhiteIsZero;
}

template <class T>
void read_integers(const fs::path& path, OIIO::ImageInput& input, const OIIO::ImageSpec& spec,
                   Decoded& decoded) {
  const auto channels = static_cast<std::size_t>(spec.nchannels);
  std::vector<T> stored(spec.image_pixels() * channels);
  read_stored(path, input, spec, spec.format, stored.data());
  if (is_turned(spec))
    for (T& value : stored) value = static_cast<T>(std::numeric_limits<T>::max() - value);
  // Types narrower than their container (10 or 12 bits in TIFF, 1 to 4 in PNG) arrive widened.
  const int shift = static_cast<int>(8 * sizeof(T)) - decoded.bits;
  for (std::size_t k = 0; k < channels; ++k) {
    auto& plane = decoded.planes[static_cast<int>(k)].values();
    for (std::size_t i = 0; i < plane.size(); ++i)
      plane[i] = static_cast<float>(stored[i * channels + k] >> shift);
  }
}

void read_floats(const fs::path& path, OIIO::ImageInput& input, const OIIO::ImageSpec& spec,
                 Decoded& decoded) {
  const auto channels = static_cast<std::size_t>(spec.nchannels);
  std::vector<float> stored(spec.image_pixels() * channels);
  read_stored(path, input, spec, TypeDesc::FLOAT, stored.data());
  for (std::size_t k = 0; k < channels; ++k) {
    auto& plane = decoded.planes[static_cast<int>(k)].values();
    for (std::size_t i = 0; i < plane.size(); ++i) plane[i] = stored[i * channels + k];
  }
}

void read_pixels(const fs::path& path, OIIO::ImageInput& input, const OIIO::ImageSpec& spec,
                 Decoded& decoded) {
  decoded.planes = Planes(spec.nchannels, spec.height, spec.width);
  if (decoded.sample == "uint8")
    read_integers<std::uint8_t>(path, input, spec, decoded);
  else if (decoded.sample == "uint16")
    read_integers<std::uint16_t>(path, input, spec, decoded);
  else
    read_floats(path, input, spec, decoded);
}

}  // namespace

Decoded read_picture(const fs::path& path, const std::string& codec, bool pixels,
                     std::uint64_t directory) {
  const std::uintmax_t file_bytes = require_file(path);
  check_before_opening(path, codec, file_bytes, directory);
  const std::unique_ptr<PageFile> page = page_file(path, codec, file_bytes, directory);
  const auto input = OIIO::ImageInput::create(codec);
  if (!input) unreadable(path, OIIO::geterror());
  if (page) input->set_ioproxy(page.get());
  input->threads(1);
  OIIO::ImageSpec config, spec;
  config.attribute("oiio:UnassociatedAlpha", 1);  // colours as stored, not times alpha
  config.attribute("oiio:RawColor", 1);
  if (!input->open(path.string(), spec, config)) unreadable(path, input->geterror());
  // A progressive JPEG is decoded here, and its damage is a mere message.
  if (codec == "jpeg" && input->has_error()) unreadable(path, input->geterror());
  check_single(path, codec, *input, spec);
  check_plausible(path, spec, file_bytes);

  Decoded decoded;
  decoded.format = codec;
  decoded.rows = spec.height;
  decoded.cols = spec.width;
  decoded.channels = spec.nchannels;
  decoded.names = spec.channelnames;
  TypeDesc type = spec.format;
  if (codec == "openexr" && type.basetype == TypeDesc::UINT32) unreadable(path, "uint32 channels");
  decoded.sample = sample_name(type);
  if (decoded.sample.empty() || decoded.sample == "uint32")
    throw InputError(path.string(), fmt::format("samples of type {} are not read", type.c_str()),
                     "store 8 or 16 bit unsigned integers or floats");
  if (decoded.sample.starts_with("uint")) {
    const int container = static_cast<int>(8 * type.size());
    const int declared = spec.get_int_attribute("oiio:BitsPerSample", container);
    decoded.bits = declared > 0 && declared < container ? declared : container;
  }
  decoded.description = spec.get_string_attribute("ImageDescription");
  decoded.camera = spec.get_string_attribute("Model");
  const float exposure_s = spec.get_float_attribute("ExposureTime", 0.0f);
  if (exposure_s > 0 && std::isfinite(exposure_s)) decoded.exposure_s = exposure_s;
  if (pixels && codec == "tiff") check_deflated(path, file_bytes, directory);
  if (pixels) read_pixels(path, *input, spec, decoded);
  input->close();
  return decoded;
}

namespace {

constexpr int kStripRows = 64;  // a multiple of EXR's blocks; a frame is never copied whole

template <class T>
bool write_strips(OIIO::ImageOutput& output, TypeDesc type, std::span<const Image> planes) {
  const int rows = planes[0].rows(), cols = planes[0].cols();
  std::vector<T> strip;
  for (int row0 = 0; row0 < rows; row0 += kStripRows) {
    const int row1 = std::min(rows, row0 + kStripRows);
    strip.clear();
    for (int r = row0; r < row1; ++r)
      for (int c = 0; c < cols; ++c)
        for (const Image& plane : planes) strip.push_back(stored_value<T>(plane(r, c)));
    if (!output.write_scanlines(row0, row1, 0, type, strip.data())) return false;
  }
  return true;
}

OIIO::ImageSpec output_spec(const std::string& codec, std::span<const Image> planes,
                            const std::vector<std::string>& names, SampleType type) {
  const TypeDesc stored = type == SampleType::kUint8    ? TypeDesc::UINT8
                          : type == SampleType::kUint16 ? TypeDesc::UINT16
                          : type == SampleType::kHalf   ? TypeDesc::HALF
                                                        : TypeDesc::FLOAT;
  OIIO::ImageSpec spec(planes[0].cols(), planes[0].rows(), static_cast<int>(planes.size()), stored);
  spec.channelnames = names;
  spec.attribute("oiio:UnassociatedAlpha", 1);  // colours are not times alpha
  // Else OpenImageIO takes the time of writing, and the same picture never gives the same bytes.
  if (codec != "png") spec.attribute("DateTime", "1970:01:01 00:00:00");
  // Noise does not shrink, nor do floats that it was taken out of (by 5 %, for half of the time of
  // stokes --full): TIFF and EXR stay plain, which every tool reads at once.
  if (codec == "tiff" || codec == "openexr") spec.attribute("compression", "none");
  if (codec == "tiff") spec.attribute("tiff:write_exif", 0);  // nothing to say there, and it fails
  if (codec == "png") spec.attribute("png:compressionLevel", 3);
  return spec;
}

bool write_pixels(OIIO::ImageOutput& output, std::span<const Image> planes, SampleType type) {
  if (type == SampleType::kUint8)
    return write_strips<std::uint8_t>(output, TypeDesc::UINT8, planes);
  if (type == SampleType::kUint16)
    return write_strips<std::uint16_t>(output, TypeDesc::UINT16, planes);
  return write_strips<float>(output, TypeDesc::FLOAT, planes);
}

// OpenImageIO does not notice a full disk (PNG and EXR not at all, TIFF not in the last strip):
// this file does.
class WatchedFile final : public OIIO::Filesystem::IOFile {
 public:
  explicit WatchedFile(std::FILE* file) : IOFile(file, Write) {}
  size_t write(const void* bytes, size_t size) override {
    errno = 0;
    return watched(IOFile::write(bytes, size), size);
  }
  size_t pwrite(const void* bytes, size_t size, int64_t offset) override {
    errno = 0;
    return watched(IOFile::pwrite(bytes, size, offset), size);
  }
  void flush() const override {
    if (std::fflush(m_file) != 0) reason_ = errno;
  }
  /// errno of what could not be written; 0 where nothing went wrong.
  int reason() const { return reason_; }

 private:
  size_t watched(size_t done, size_t wanted) {
    if (done != wanted && reason_ == 0) reason_ = errno != 0 ? errno : EIO;
    return done;
  }
  mutable int reason_ = 0;
};

// Throws InputError for what OpenImageIO notices itself.
void encode(const fs::path& path, const std::string& codec, const OIIO::ImageSpec& spec,
            std::span<const Image> planes, SampleType type, OIIO::Filesystem::IOProxy& to) {
  const auto output = OIIO::ImageOutput::create(codec);
  MALUS_REQUIRE(output != nullptr);
  output->set_ioproxy(&to);
  const bool good =
      output->open(path.string(), spec) && write_pixels(*output, planes, type) && output->close();
  const std::string message = output->geterror();
  if (!good || !message.empty())
    throw InputError(path.string(), fmt::format("cannot be encoded: {}", message),
                     "use another format");
}

// Devices and pipes have no places to go back to: the file is made in memory.
void encode_to_device(const fs::path& path, const std::string& codec, const OIIO::ImageSpec& spec,
                      std::span<const Image> planes, SampleType type) {
  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput memory(bytes);
  encode(path, codec, spec, planes, type, memory);
  write_file(path, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}, true);
}

}  // namespace

void write_picture(const fs::path& path, bool force, const std::string& codec,
                   std::span<const Image> planes, const std::vector<std::string>& names,
                   SampleType type, const std::string& description,
                   std::optional<double> exposure_s) {
  AtomicFile file(path, force);
  OIIO::ImageSpec spec = output_spec(codec, planes, names, type);
  if (!description.empty()) spec.attribute("ImageDescription", description);
  if (exposure_s && codec == "openexr")
    spec.attribute("ExposureTime", static_cast<float>(*exposure_s));
  if (file.temporary() == file.path()) return encode_to_device(path, codec, spec, planes, type);
  OpenFile stream(std::fopen(file.temporary().c_str(), "wb"));
  if (!stream) file.fail(std::strerror(errno));
  WatchedFile watched(stream.get());
  try {
    encode(path, codec, spec, planes, type, watched);
  } catch (const InputError&) {
    if (watched.reason() == 0) throw;  // else the disk is what is to be said
  }
  watched.flush();
  if (watched.reason() != 0) file.fail(std::strerror(watched.reason()));
  if (std::fclose(stream.release()) != 0) file.fail(std::strerror(errno));
  file.commit();
}

}  // namespace malus::internal
