// Opens the module with the codecs of pictures (apps/pictures/pictures.h) on first need, in place
// of the library's own definition, which would link them to its user.
#include "../pictures/pictures.h"
#include "module_file.h"
#include <malus_modules_interface.h>

namespace malus {
namespace {

constexpr const char* kPicturesModule = "malus_pictures.so";

const Codecs* open_codecs() {
  const std::filesystem::path path = app::module_file(kPicturesModule);
  if (path.empty())
    throw InputError(
        kPicturesModule, "not found: it holds the codecs of pictures",
        "copy it beside " + app::module_opener().name + ", or install both (docs/install.md)");
  const app::OpenModule module = app::open_module(
      path, app::kPictureCodecsEntry, "install libopenimageio2.4 and libraw20, or build again");
  const auto entry = reinterpret_cast<app::PictureCodecsEntry>(module.entry);
  const Codecs* codecs =
      entry ? entry(app::kModulesInterface, app::module_opener().wording) : nullptr;
  if (codecs == nullptr) throw app::other_version(path);
  return codecs;
}

}  // namespace

const Codecs& codecs() {
  static const Codecs* const opened = open_codecs();
  return *opened;
}

}  // namespace malus
