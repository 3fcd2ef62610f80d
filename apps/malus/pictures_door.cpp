// Opens the module with the codecs of pictures (apps/pictures/pictures.h) on first need, in place
// of the library's own definition, which would link them to the program.
#include "malus/base/error.h"

#include "../pictures/pictures.h"
#include "module_file.h"
#include <dlfcn.h>
#include <fmt/format.h>
#include <malus_modules_interface.h>

namespace malus {
namespace {

constexpr const char* kPicturesModule = "malus_pictures.so";

const Codecs* open_codecs() {
  const std::filesystem::path path = app::module_file(kPicturesModule);
  if (path.empty())
    throw InputError(kPicturesModule, "not found: it holds the codecs of pictures",
                     "copy it beside the program, or install both (docs/install.md)");
  void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr)
    throw InputError(path.string(), fmt::format("cannot be loaded ({})", dlerror()),
                     "install libopenimageio2.4 and libraw20, or build again");
  const auto entry =
      reinterpret_cast<app::PictureCodecsEntry>(dlsym(module, app::kPictureCodecsEntry));
  const Codecs* codecs = entry ? entry(app::kModulesInterface) : nullptr;
  if (codecs == nullptr)
    throw InputError(path.string(), "is of another version than the program", "build both again");
  return codecs;
}

}  // namespace

const Codecs& codecs() {
  static const Codecs* const opened = open_codecs();
  return *opened;
}

}  // namespace malus
