#include "malus/io/picture_file.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/frame_stack.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/fits.h"
#include "malus/io/internal/frame_tags.h"
#include "malus/io/internal/jpeg_check.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/picture_codec.h"
#include "malus/io/internal/read_any.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

struct Ending {
  const char* ending;
  const char* codec;
};
constexpr std::array<Ending, 8> kEndings = {{{".tif", "tiff"},
                                             {".tiff", "tiff"},
                                             {".png", "png"},
                                             {".exr", "openexr"},
                                             {".fits", "fits"},
                                             {".fit", "fits"},
                                             {".fts", "fits"},
                                             {".npy", "npy"}}};

const Ending* known_ending(const std::string& ending) {
  const auto found = std::find_if(kEndings.begin(), kEndings.end(),
                                  [&](const Ending& e) { return ending == e.ending; });
  return found == kEndings.end() ? nullptr : &*found;
}

std::string codec_by_ending(const fs::path& path) {
  const std::string ending = lower_case(path.extension().string());
  if (const Ending* known = known_ending(ending)) return known->codec;
  throw InputError(path.string(), fmt::format("the ending \"{}\" cannot be written", ending),
                   "use .tif, .png, .exr, .fits or .npy");
}

void require_type(const fs::path& path, const std::string& codec, SampleType type) {
  const bool integer = type == SampleType::kUint8 || type == SampleType::kUint16;
  if (codec == "png" && !integer)
    throw InputError(path.string(), "PNG holds no floating-point values",
                     "use .tif, .exr, .fits or .npy");
  if (codec == "openexr" && integer)
    throw InputError(path.string(), "EXR holds no 8 or 16 bit integers", "use .tif or .png");
  if (codec != "openexr" && type == SampleType::kHalf)
    throw InputError(path.string(), "half precision exists in EXR only", "use .exr");
}

SampleType sample_type(const fs::path& path, const std::string& codec, const SaveOptions& options) {
  const SampleType type =
      options.type.value_or(codec == "png" ? SampleType::kUint16 : SampleType::kFloat);
  require_type(path, codec, type);
  return type;
}

std::vector<std::string> channel_names(int channels, const std::vector<std::string>& names) {
  if (!names.empty()) {
    MALUS_REQUIRE(static_cast<int>(names.size()) == channels);
    return names;
  }
  if (channels == 1) return {"Y"};
  if (channels == 3) return {"R", "G", "B"};
  if (channels == 4) return {"R", "G", "B", "A"};
  std::vector<std::string> numbered;
  for (int k = 0; k < channels; ++k) numbered.push_back(fmt::format("C{:02}", k));
  return numbered;
}

void save_described(const fs::path& path, std::span<const Image> planes,
                    const std::vector<std::string>& given_names, const SaveOptions& options,
                    const std::string& description, std::optional<double> exposure_s) {
  MALUS_REQUIRE(!planes.empty() && !planes[0].empty());
  const auto channels = static_cast<int>(planes.size());
  const std::string codec = codec_by_ending(path);
  const SampleType type = sample_type(path, codec, options);
  if (codec == "png" && channels > 4)
    throw InputError(path.string(), fmt::format("PNG holds up to 4 channels, not {}", channels),
                     "use .exr, .tif, .fits or .npy");
  const bool is_8 = type == SampleType::kUint8, is_16 = type == SampleType::kUint16;
  if (codec == "npy") {
    using internal::NpySample;
    write_file(path,
               internal::npy_content(planes, is_8    ? NpySample::kUint8
                                             : is_16 ? NpySample::kUint16
                                                     : NpySample::kFloat),
               options.force);
  } else if (codec == "fits") {
    using internal::FitsSample;
    write_file(path,
               internal::fits_content(planes,
                                      is_8    ? FitsSample::kUint8
                                      : is_16 ? FitsSample::kUint16
                                              : FitsSample::kFloat,
                                      description, exposure_s),
               options.force);
  } else {
    internal::write_picture(path, options.force, codec, planes,
                            channel_names(channels, given_names), type, description, exposure_s);
  }
}

Picture picture_of(internal::Decoded decoded) {
  Picture picture;
  picture.names = channel_names(decoded.channels, decoded.names);
  picture.planes = std::move(decoded.planes);
  picture.bits = decoded.bits;
  picture.holds = decoded.holds;
  picture.white = white_of_picture(picture.bits, picture.planes);
  return picture;
}

}  // namespace

int bits_of_numbers(char kind, int item_bytes) {
  if (kind == 'f') return 0;
  if (kind == 'b') return 1;
  return std::min(8 * item_bytes - (kind == 'i' ? 1 : 0), 24);
}

double white_of_picture(int bits, const Planes& planes) {
  if (bits == 0) return 1.0;
  double white = 0;
  for (const Image& plane : planes) white = std::max(white, assumed_white_dn(bits, plane.view()));
  return white;
}

void require_known_white(const fs::path& source, int bits) {
  if (bits > 0 && !white_of_bits(bits))
    throw InputError(source.string(),
                     "holds integers of more than 16 bits, and how large white is among them is "
                     "not known",
                     "store 8 or 16 bit unsigned integers, or floats of 0 to 1");
}

void require_exact(const fs::path& path, double whole) {
  constexpr double kMaxExact = 16777216.0;  // float holds every integer up to here
  if (std::abs(whole) > kMaxExact)
    throw InputError(path.string(), fmt::format("it holds the integer {:.0f}, above 2^24", whole),
                     "scale it down or store it as float");
}

std::optional<std::size_t> alpha_plane(const fs::path& path, const Picture& picture) {
  const std::string ending = lower_case(path.extension().string());
  const auto alpha = std::find(picture.names.begin(), picture.names.end(), "A");
  if (ending == ".npy" || ending.starts_with(".fit") || alpha == picture.names.end())
    return std::nullopt;
  return static_cast<std::size_t>(alpha - picture.names.begin());
}

bool has_picture_ending(const fs::path& path) {
  return known_ending(lower_case(path.extension().string())) != nullptr;
}

void require_ending_for(const fs::path& path, SampleType type) {
  require_type(path, codec_by_ending(path), type);
}

Picture load_picture(const fs::path& path) {
  internal::Decoded decoded = internal::read_any(path, true);
  if (decoded.negative)
    throw InputError(path.string(), "is a negative, 0 is white", "store it with 0 as black");
  return picture_of(std::move(decoded));
}

Picture load_clean_picture(const fs::path& path) {
  const fs::path file = frame_place(path).file;
  const bool is_jpeg = internal::begins_as_jpeg(internal::read_bytes(file, 3));
  Picture picture =
      is_jpeg ? picture_of(internal::read_picture(file, "jpeg", true, internal::kNoDirectory))
              : load_picture(path);
  require_known_white(path, picture.bits);
  return picture;
}

void save_picture(const fs::path& path, const Planes& planes, const std::vector<std::string>& names,
                  const SaveOptions& options) {
  save_described(path, planes, names, options, internal::content_tag(options.holds), {});
}

void save_picture(const fs::path& path, const Image& image, const SaveOptions& options) {
  save_described(path, {&image, 1}, {}, options, {}, {});
}

void save_frame(const fs::path& path, const RawFrame& frame, const SaveOptions& options) {
  save_described(path, {&frame.dn, 1}, {}, options, internal::frame_tags(frame, options.holds),
                 frame.exposure_s);
}

}  // namespace malus
