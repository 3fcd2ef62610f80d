// The pages of a TIFF file as frames of a stack.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

namespace malus::internal {

/// Places of the directories that hold frames, in order, at least one: thumbnails (pages that say
/// that they are of reduced resolution) and masks are none, unless the file has no other page.
using TiffFramePlaces = std::shared_ptr<const std::vector<std::uint64_t>>;

/// Reads directories alone. Throws InputError where the file ends before one of them, they lead in
/// a circle or are too many, frames differ in size or type (naming the frame), or none of several
/// pages is a frame. Directories of a stack that has not changed since are not read again.
TiffFramePlaces tiff_frames(const std::filesystem::path& path);

}  // namespace malus::internal
