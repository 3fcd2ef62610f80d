#include "malus/io/frame_stack.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/fits.h"
#include "malus/io/internal/npy.h"
#include "malus/io/internal/picture_codec.h"
#include "malus/io/internal/stack_index.h"
#include "malus/io/internal/tiff_frames.h"

#include <algorithm>
#include <charconv>
#include <limits>
#include <string>
#include <string_view>
#include <system_error>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

// The number between the brackets; unset where there is anything else. None is too large to be
// told that the file has no such frame.
std::optional<int> index_of(std::string_view digits) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  if (digits.empty() || !std::all_of(digits.begin(), digits.end(), is_digit)) return std::nullopt;
  int index = 0;
  const auto read = std::from_chars(digits.data(), digits.data() + digits.size(), index);
  return read.ec == std::errc() ? index : std::numeric_limits<int>::max();
}

}  // namespace

FramePlace frame_place(const fs::path& name) {
  const std::string_view text = name.native();
  const std::size_t bracket = text.rfind('[');
  if (!text.ends_with(']') || bracket == text.npos) return {name, std::nullopt, name};
  const auto index = index_of(text.substr(bracket + 1, text.size() - bracket - 2));
  const fs::path file = text.substr(0, bracket);
  std::error_code unknown;
  if (!index || fs::exists(name, unknown) || !fs::is_regular_file(file, unknown))
    return {name, std::nullopt, name};
  return {file, index, name};
}

fs::path frame_name(const fs::path& file, int index) {
  return file.string() + fmt::format("[{}]", index);
}

int count_frames(const fs::path& file) {
  if (internal::picture_codec(file) == "tiff")
    return static_cast<int>(internal::tiff_frames(file)->size());
  const auto head = internal::read_bytes(file, 8);
  if (internal::begins_as_npy(head)) return internal::npy_frames(file);
  if (internal::begins_as_fits(head)) return internal::fits_frames(file);
  return 1;
}

std::vector<fs::path> frame_names(const fs::path& name, bool headerless) {
  if (headerless) return {name};
  const FramePlace place = frame_place(name);
  const int frames = count_frames(place.file);
  if (place.index) internal::stack_index(place, frames);
  if (place.index || frames == 1) return {name};
  std::vector<fs::path> names;
  for (int k = 0; k < frames; ++k) names.push_back(frame_name(name, k));
  return names;
}

fs::path first_frame(const fs::path& name, bool headerless) {
  return frame_names(name, headerless).front();
}

fs::path frame_identity(const fs::path& name) {
  const FramePlace place = frame_place(name);
  std::error_code unknown;
  const fs::path real = fs::weakly_canonical(place.file, unknown);
  return frame_name(unknown ? place.file.lexically_normal() : real, place.index.value_or(0));
}

int internal::stack_index(const FramePlace& place, int frames) {
  if (!place.index && frames > 1)
    throw InputError(place.file.string(), fmt::format("it holds {} frames", frames),
                     fmt::format("name one of them, from {} to {}",
                                 frame_name(place.file.filename(), 0).string(),
                                 frame_name(place.file.filename(), frames - 1).string()));
  const int index = place.index.value_or(0);
  if (index >= frames)
    throw InputError(place.name.string(),
                     fmt::format("the file holds {}", counted(frames, "frame")),
                     fmt::format("frames are counted from [0]{}",
                                 frames > 1 ? fmt::format(" to [{}]", frames - 1) : ""));
  return index;
}

}  // namespace malus
