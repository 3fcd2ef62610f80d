#include "malus/io/angle_pictures.h"

#include "malus/base/error.h"

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

fs::path angle_file(const fs::path& folder, std::size_t angle_deg) {
  for (const char* ending : {".png", ".tif", ".tiff", ".exr"}) {
    const fs::path path = folder / fmt::format("I{}{}", angle_deg, ending);
    if (fs::exists(path)) return path;
  }
  throw InputError(folder.string(), fmt::format("holds no picture I{}", angle_deg),
                   "give a folder with I0, I45, I90 and I135 (.png, .tif or .exr)");
}

}  // namespace

std::array<fs::path, 4> angle_picture_files(const fs::path& folder) {
  std::array<fs::path, 4> files;
  for (std::size_t k = 0; k < files.size(); ++k) files[k] = angle_file(folder, 45 * k);
  return files;
}

std::array<Picture, 4> load_angle_pictures(const fs::path& folder) {
  const std::array<fs::path, 4> files = angle_picture_files(folder);
  std::array<Picture, 4> pictures;
  for (std::size_t k = 0; k < pictures.size(); ++k) {
    const fs::path& path = files[k];
    pictures[k] = load_picture(path);
    const Planes &planes = pictures[k].planes, &first = pictures[0].planes;
    if (planes.rows() != first.rows() || planes.cols() != first.cols() ||
        planes.channels() != first.channels())
      throw InputError(path.string(), "has another size or other channels than I0",
                       "give four pictures of one scene");
  }
  return pictures;
}

}  // namespace malus
