#include "malus/io/frame_file.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"
#include "malus/image/black_levels.h"
#include "malus/io/internal/camera_raw.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/fits.h"
#include "malus/io/internal/frame_tags.h"
#include "malus/io/internal/netpbm.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/picture_codec.h"
#include "malus/io/internal/read_any.h"
#include "malus/io/internal/stack_index.h"
#include "malus/io/internal/tiff_frames.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <string_view>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;
using internal::Decoded;

Decoded read_headerless(const fs::path& path, const FrameOptions& options, bool pixels) {
  const RawFormat format = *options.raw_format;
  if (options.rows < 1 || options.cols < 1)
    throw InputError(path.string(), "a headerless file needs its size",
                     "give " + setting("size") + " (width and height)");
  internal::check_picture_size(path, options.rows, options.cols, 1);
  const std::uintmax_t present = internal::require_file(path);
  const std::size_t needed = raw_format_bytes(format, options.rows, options.cols);
  if (present != needed)
    throw InputError(path.string(),
                     fmt::format("it has {} bytes, {}x{} pixels of {} need {}", present,
                                 options.cols, options.rows, raw_format_name(format), needed),
                     fmt::format("check {} and {}, or the session file", setting("size"),
                                 setting("raw_format")));
  Decoded decoded;
  decoded.format = raw_format_name(format);
  decoded.sample = fmt::format("uint{}", raw_format_bits(format));
  decoded.bits = raw_format_bits(format);
  decoded.rows = options.rows;
  decoded.cols = options.cols;
  decoded.channels = 1;
  if (!pixels) return decoded;
  decoded.planes = Planes(1, options.rows, options.cols);
  decode_raw(format, internal::read_bytes(path), decoded.planes[0]);
  return decoded;
}

// The file's black levels for the declared layout. Empty where the file tells none.
std::vector<double> black_of_file(const Decoded& decoded, const SensorLayout& layout,
                                  const std::string& source) {
  const std::vector<double>& told = decoded.black_dn;
  if (told.size() <= 1 || decoded.layout == layout) return told;
  if (!decoded.layout || told.size() != static_cast<std::size_t>(decoded.layout->channels()))
    return {};
  return blacks_for_layout(told, *decoded.layout, layout, source);
}

// The bias follows the gain.
void require_gain_of_black(const RawFrame& frame, const GainSetting& gain) {
  if (!frame.gain.contradicts(gain)) return;
  throw InputError(
      frame.source,
      fmt::format("was taken at {}, its dark frames at {}", frame.gain.text(), gain.text()),
      "give dark frames of the same gain");
}

// The user's word, then the file's, then the default.
RawFrame assemble(Decoded& decoded, const FrameOptions& options, const fs::path& path) {
  RawFrame frame;
  frame.source = path.string();
  frame.bits = decoded.bits;
  frame.layout_known = options.layout || decoded.layout;
  frame.layout = options.layout ? *options.layout : decoded.layout.value_or(SensorLayout());
  if (decoded.layout && !(*decoded.layout == frame.layout))
    frame.file_layout = decoded.layout->name();
  const std::vector<double> black = options.black_dn.empty()
                                        ? black_of_file(decoded, frame.layout, frame.source)
                                        : options.black_dn;
  frame.black_known = !black.empty();
  frame.black_dn = black_per_channel(frame.black_known ? black : std::vector<double>{0.0},
                                     frame.layout, frame.source);
  frame.white_known = options.white_dn || decoded.white_dn;
  const bool gain_given = options.gain.gain_db || options.gain.iso;
  frame.gain = gain_given ? options.gain : decoded.gain;
  frame.exposure_s = options.exposure_s ? options.exposure_s : decoded.exposure_s;
  frame.mean_of = options.mean_of.value_or(decoded.mean_of);
  if (decoded.planes.channels() > 0) frame.dn = std::move(decoded.planes[0]);
  frame.white_dn = options.white_dn   ? *options.white_dn
                   : decoded.white_dn ? *decoded.white_dn
                                      : assumed_white_dn(frame.bits, frame.dn.view());
  require_levels(frame);
  require_black_of_codes(frame, decoded.sample);
  if (!options.black_dn.empty()) require_gain_of_black(frame, options.black_gain);
  return frame;
}

Decoded read_mosaic(const fs::path& path, const FrameOptions& options, bool pixels) {
  Decoded decoded = options.raw_format ? read_headerless(path, options, pixels)
                                       : internal::read_any(path, pixels);
  if (decoded.channels != 1)
    throw InputError(
        path.string(), fmt::format("it has {} channels, a raw mosaic has one", decoded.channels),
        decoded.sheets ? "give the camera's raw frame; a stack needs one page per frame "
                         "(tifffile: photometric='minisblack')"
                       : "give the camera's raw frame; pictures go through malus simulate");
  if ((options.rows > 0 && decoded.rows != options.rows) ||
      (options.cols > 0 && decoded.cols != options.cols))
    throw InputError(path.string(),
                     fmt::format("it is {}x{} pixels, {}x{} were declared", decoded.cols,
                                 decoded.rows, options.cols, options.rows),
                     "check the file, or the size in the session file or " + setting("size"));
  return decoded;
}

// Of a stack the frame that the place names.
Decoded read_place(const FramePlace& place, bool pixels) {
  using namespace internal;
  const fs::path& file = place.file;
  require_file(file);
  const auto head = read_bytes(file, 10);
  const std::string codec = picture_codec(file);
  if (codec == "tiff") {
    const TiffFramePlaces frames = tiff_frames(file);
    const int index = stack_index(place, static_cast<int>(frames->size()));
    return read_picture(file, codec, pixels, (*frames)[static_cast<std::size_t>(index)]);
  }
  if (place.index) stack_index(place, count_frames(file));
  if (begins_as_npy(head)) return read_npy(file, pixels, place.index);
  if (begins_as_fits(head)) return read_fits(file, pixels, place.index);
  if (!codec.empty()) return read_picture(file, codec, pixels, kNoDirectory);
  if (begins_with(head, "P5") || begins_with(head, "P6")) return read_netpbm(file, pixels);
  refuse_other_netpbm(head, file);
  return read_camera_raw(file, pixels);
}

int frames_in_file(const FramePlace& place, const FrameOptions& options) {
  if (!options.raw_format) return count_frames(place.file);
  if (place.index)
    throw InputError(place.name.string(),
                     "a headerless file is one frame, and " + setting("raw_format") + " is given",
                     "save every frame in a file of its own");
  return 1;
}

FrameInfo read_frame(const fs::path& path, const FrameOptions& options, bool pixels) {
  const FramePlace place = frame_place(path);
  FrameInfo info;
  info.frames_in_file = frames_in_file(place, options);
  internal::stack_index(place, info.frames_in_file);
  Decoded decoded = read_mosaic(path, options, pixels);
  info.rows = decoded.rows;
  info.cols = decoded.cols;
  info.format = decoded.format;
  info.camera = decoded.camera;
  info.sample = decoded.sample;
  info.holds = decoded.holds;
  info.frame = assemble(decoded, options, path);
  return info;
}

}  // namespace

internal::Decoded internal::read_any(const fs::path& path, bool pixels) {
  const FramePlace place = frame_place(path);
  try {
    Decoded decoded = read_place(place, pixels);
    apply_frame_tags(decoded);
    return decoded;
  } catch (const InputError& error) {  // readers know the file alone
    if (!place.index || error.subject() != place.file.string()) throw;
    throw InputError(path.string(), error.problem(), error.remedy());
  }
}

std::pair<int, int> parse_frame_size(std::string_view text) {
  constexpr int kMaxExtent = 1 << 20;
  int rows = 0, cols = 0;
  const char* const last = text.data() + text.size();
  const auto [middle, width_error] = std::from_chars(text.data(), last, cols);
  bool good = width_error == std::errc() && middle != last && *middle == 'x';
  if (good) {
    const auto [end, height_error] = std::from_chars(middle + 1, last, rows);
    good = height_error == std::errc() && end == last;
  }
  if (!good || rows < 1 || cols < 1 || rows > kMaxExtent || cols > kMaxExtent)
    throw InputError(fmt::format("size \"{}\"", text), "is not WIDTHxHEIGHT",
                     "write it as 2448x2048");
  return {rows, cols};
}

FrameOptions merged(const FrameOptions& options, const FrameOptions& fallback) {
  FrameOptions result = options;
  if (!result.layout) result.layout = fallback.layout;
  if (result.black_dn.empty()) {
    result.black_dn = fallback.black_dn;
    result.black_gain = fallback.black_gain;
  }
  if (!result.white_dn) result.white_dn = fallback.white_dn;
  if (!result.gain.gain_db && !result.gain.iso) result.gain = fallback.gain;
  if (!result.exposure_s) result.exposure_s = fallback.exposure_s;
  if (!result.mean_of) result.mean_of = fallback.mean_of;
  if (!result.raw_format) result.raw_format = fallback.raw_format;
  if (result.rows == 0 && result.cols == 0) {
    result.rows = fallback.rows;
    result.cols = fallback.cols;
  }
  return result;
}

RawFrame load_frame(const fs::path& path, const FrameOptions& options) {
  return read_frame(path, options, true).frame;
}

FrameInfo load_frame_info(const fs::path& path, const FrameOptions& options) {
  return read_frame(path, options, true);
}

FrameInfo probe_frame(const fs::path& path, const FrameOptions& options) {
  return read_frame(path, options, false);
}

}  // namespace malus
