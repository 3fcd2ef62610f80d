// Scenes that were photographed behind a polarizer at four angles.
#pragma once

#include "malus/io/picture_file.h"

#include <array>
#include <filesystem>

namespace malus {

/// Their files (.png, .tif, .tiff or .exr) in a folder, in the order of the angles. Throws
/// InputError where one is missing.
std::array<std::filesystem::path, 4> angle_picture_files(const std::filesystem::path& folder);

/// The pictures I0, I45, I90, I135 (.png, .tif, .tiff or .exr) of a folder, in this order. Throws
/// InputError where one is missing or cannot be read, or is not of the first one's size and
/// channels.
std::array<Picture, 4> load_angle_pictures(const std::filesystem::path& folder);

}  // namespace malus
