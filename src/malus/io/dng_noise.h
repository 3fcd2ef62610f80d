// The NoiseProfile tag of DNG files (51041; Adobe DNG specification 1.3 and later): the maker's
// heteroscedastic Gaussian noise of the frame.
#pragma once

#include <filesystem>
#include <vector>

namespace malus {

/// Variance = slope x + offset of pixels x scaled to 0 at black and 1 at white. One entry for all
/// colours, or one per colour plane: red, green, blue.
struct DngNoiseProfile {
  std::vector<double> slope, offset;
};

/// Reads the first NoiseProfile of the file's directories; pixels are not looked at. Throws
/// InputError when the file is no TIFF, is damaged, or holds no such tag.
DngNoiseProfile read_dng_noise_profile(const std::filesystem::path& path);

}  // namespace malus
