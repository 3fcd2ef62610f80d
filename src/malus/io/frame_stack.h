// Stacks: files that hold several frames of one size and type. These are the pages of a TIFF file,
// a .npy array of (frame, row, column), and a FITS cube, whose third axis counts frames.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

namespace malus {

/// Files with more are refused.
inline constexpr int kMostStackFrames = 1'000'000;

/// Where a frame lies: in a file, and of a stack at which place, from 0.
struct FramePlace {
  std::filesystem::path file;
  std::optional<int> index;    ///< unset: the file's only frame; at most the largest int
  std::filesystem::path name;  ///< as it was given
};

/// What a frame's name says. `stack.tif[3]` is the frame 3 of stack.tif where that is a file; where
/// a file has the whole name, this one.
FramePlace frame_place(const std::filesystem::path& name);

/// The other way round: file and index as a name.
std::filesystem::path frame_name(const std::filesystem::path& file, int index);

/// How many frames the file holds; of other formats, camera raw and headerless among them, 1. Reads
/// headers alone, and holds them against the size of the file. Thumbnails (TIFF pages that say that
/// they are of reduced resolution) are no frames; an array whose last axis is at most 4, and
/// shorter than the first, is one picture, as load_picture reads it. Throws InputError where the
/// file is damaged, cannot hold what it declares, has frames of several sizes or types, or is of
/// Fortran order, in which frames do not lie one after the other.
int count_frames(const std::filesystem::path& file);

/// The names of a file's frames in order, a stack's each with its index; of the name of one frame
/// this name. headerless: files hold one frame each and are not looked at. Throws InputError as
/// count_frames, and where there is no such frame.
std::vector<std::filesystem::path> frame_names(const std::filesystem::path& name,
                                               bool headerless = false);

/// The first of them.
std::filesystem::path first_frame(const std::filesystem::path& name, bool headerless = false);

/// The same path for every name of one frame: links followed, and with an index, 0 of files that
/// hold no stack.
std::filesystem::path frame_identity(const std::filesystem::path& name);

}  // namespace malus
