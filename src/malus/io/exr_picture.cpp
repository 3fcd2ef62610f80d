#include "malus/io/internal/exr_picture.h"

#include "malus/base/error.h"
#include "malus/io/internal/exr_check.h"
#include "malus/io/internal/picture_faults.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <tuple>

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFloatAttribute.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfIO.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStringAttribute.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// Its own threads would not live on in a forked process (a worker of a Python DataLoader).
constexpr int kNoThreads = 0;

// OpenEXR keeps channels by name: colours come as R, G, B, A, vectors as X, Y, Z, brightness as Y,
// A.
bool comes_before(const std::string& a, const std::string& b) {
  constexpr std::array<std::string_view, 6> kFirst = {"R", "G", "B", "X", "Y", "A"};
  const auto rank = [&](const std::string& name) {
    const std::size_t dot = name.rfind('.');
    const std::string layer = dot == name.npos ? "" : name.substr(0, dot);
    const std::string last = dot == name.npos ? name : name.substr(dot + 1);
    return std::tuple(layer, std::find(kFirst.begin(), kFirst.end(), last) - kFirst.begin(), last);
  };
  return rank(a) < rank(b);
}

void check_part(const fs::path& path, const Imf::MultiPartInputFile& file) {
  if (file.parts() > 1)
    throw InputError(path.string(), "it holds several pictures (parts)",
                     "split it into one file per frame");
  const Imf::Header& header = file.header(0);
  if (header.hasType() && Imf::isDeepData(header.type()))
    unreadable_picture(path, "it is a deep picture");
  for (auto at = header.channels().begin(); at != header.channels().end(); ++at) {
    if (at.channel().type == Imf::UINT)
      throw InputError(path.string(), "uint32 channels are not read", "store half or float");
    if (at.channel().xSampling != 1 || at.channel().ySampling != 1)
      unreadable_picture(path, std::string("the channel ") + at.name() + " has fewer pixels");
  }
}

void describe(const Imf::Header& header, Decoded& decoded) {
  const Imath::Box2i window = header.dataWindow();
  decoded.format = "openexr";
  decoded.rows = static_cast<int>(std::int64_t{window.max.y} - window.min.y + 1);
  decoded.cols = static_cast<int>(std::int64_t{window.max.x} - window.min.x + 1);
  decoded.sample = "half";
  for (auto at = header.channels().begin(); at != header.channels().end(); ++at) {
    decoded.names.emplace_back(at.name());
    if (at.channel().type == Imf::FLOAT) decoded.sample = "float";
  }
  std::sort(decoded.names.begin(), decoded.names.end(), comes_before);
  decoded.channels = static_cast<int>(decoded.names.size());
  if (Imf::hasComments(header)) decoded.description = Imf::comments(header);
  if (const auto* camera = header.findTypedAttribute<Imf::StringAttribute>("cameraModel"))
    decoded.camera = camera->value();
  if (Imf::hasExpTime(header))
    if (const float exposure_s = Imf::expTime(header); exposure_s > 0 && std::isfinite(exposure_s))
      decoded.exposure_s = exposure_s;
}

void read_exr_pixels(Imf::MultiPartInputFile& file, Decoded& decoded) {
  const Imath::Box2i window = file.header(0).dataWindow();
  decoded.planes = Planes(decoded.channels, decoded.rows, decoded.cols);
  Imf::FrameBuffer buffer;
  for (int k = 0; k < decoded.channels; ++k)
    buffer.insert(decoded.names[static_cast<std::size_t>(k)],
                  Imf::Slice::Make(Imf::FLOAT, decoded.planes[k].values().data(), window));
  Imf::InputPart part(file, 0);
  part.setFrameBuffer(buffer);
  part.readPixels(window.min.y, window.max.y);
}

// What OpenEXR writes goes to.
class ExrOutput final : public Imf::OStream {
 public:
  ExrOutput(PictureOutput& output, const fs::path& path) : OStream(path.c_str()), output_(output) {}
  void write(const char bytes[], int size) override {
    const auto wanted = static_cast<std::size_t>(size);
    if (output_.write(bytes, wanted) != wanted) throw Iex::IoExc("the file cannot be written");
  }
  std::uint64_t tellp() override { return output_.place(); }
  void seekp(std::uint64_t place) override {
    output_.seek(static_cast<std::int64_t>(place), SEEK_SET);
  }

 private:
  PictureOutput& output_;
};

void write_floats(Imf::OutputFile& file, std::span<const Image> planes,
                  const std::vector<std::string>& names) {
  Imf::FrameBuffer buffer;
  for (std::size_t k = 0; k < planes.size(); ++k)
    buffer.insert(names[k], Imf::Slice::Make(Imf::FLOAT, planes[k].values().data(),
                                             file.header().dataWindow()));
  file.setFrameBuffer(buffer);
  file.writePixels(planes[0].rows());
}

void write_halves(Imf::OutputFile& file, std::span<const Image> planes,
                  const std::vector<std::string>& names) {
  constexpr int kStripRows = 64;
  const int rows = planes[0].rows(), cols = planes[0].cols();
  for (int row0 = 0; row0 < rows; row0 += kStripRows) {
    const int strip = std::min(kStripRows, rows - row0);
    std::vector<std::vector<half>> halves;
    Imf::FrameBuffer buffer;
    for (std::size_t k = 0; k < planes.size(); ++k) {
      const float* const first = &planes[k](row0, 0);
      halves.emplace_back(first, first + std::ptrdiff_t{strip} * cols);
      buffer.insert(names[k], Imf::Slice::Make(Imf::HALF, halves.back().data(), Imath::V2i(0, row0),
                                               cols, strip));
    }
    file.setFrameBuffer(buffer);
    file.writePixels(strip);
  }
}

}  // namespace

Decoded read_exr(const fs::path& path, std::uintmax_t file_bytes, bool pixels) try {
  check_exr(path, file_bytes);
  Imf::MultiPartInputFile file(path.c_str(), kNoThreads);
  check_part(path, file);
  const Imf::Header& header = file.header(0);
  const Imath::Box2i window = header.dataWindow();
  std::int64_t channels = 0;
  for (auto at = header.channels().begin(); at != header.channels().end(); ++at) ++channels;
  check_plausible(path, file_bytes, std::int64_t{window.max.y} - window.min.y + 1,
                  std::int64_t{window.max.x} - window.min.x + 1, channels, 16);
  Decoded decoded;
  describe(header, decoded);
  if (pixels) read_exr_pixels(file, decoded);
  return decoded;
} catch (const Iex::BaseExc& error) {
  unreadable_picture(path, error.what());
}

void encode_exr(PictureOutput& output, const fs::path& path, std::span<const Image> planes,
                const std::vector<std::string>& names, SampleType type,
                const std::string& description, std::optional<double> exposure_s) try {
  Imf::Header header(planes[0].cols(), planes[0].rows());
  header.compression() = Imf::NO_COMPRESSION;
  const Imf::PixelType stored = type == SampleType::kHalf ? Imf::HALF : Imf::FLOAT;
  for (const std::string& name : names) header.channels().insert(name, Imf::Channel(stored));
  if (!description.empty()) Imf::addComments(header, description);
  if (exposure_s) Imf::addExpTime(header, static_cast<float>(*exposure_s));
  ExrOutput stream(output, path);
  Imf::OutputFile file(stream, header, kNoThreads);
  if (stored == Imf::HALF)
    write_halves(file, planes, names);
  else
    write_floats(file, planes, names);
} catch (const Iex::BaseExc& error) {
  unwritable_picture(path, error.what());
}

}  // namespace malus::internal
