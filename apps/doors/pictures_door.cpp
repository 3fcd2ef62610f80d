// Opens the module with the codecs of pictures (apps/pictures/pictures.h) on first need, in place
// of the library's own definition, which would link them to its user.
#include "../pictures/pictures.h"
#include "module_file.h"
#include <fmt/format.h>
#include <malus_modules_interface.h>
#include <sys/resource.h>

namespace malus {
namespace {

constexpr const char* kPicturesModule = "malus_pictures.so";

// Where the system refuses them memory, the libraries behind the codecs try for ever (OpenBLAS) or
// end the process (log4cplus).
void require_address_space() {
  constexpr rlim_t kNeeded = 900'000'000;  // 800 MB were too little on two cores
  rlimit most{};
  if (::getrlimit(RLIMIT_AS, &most) != 0 || most.rlim_cur >= kNeeded) return;
  throw InputError("the codecs of pictures",
                   fmt::format("need {} MB of address space, and the system allows this process {}",
                               kNeeded / 1'000'000, most.rlim_cur / 1'000'000),
                   "raise the limit (ulimit -v)");
}

const Codecs* open_codecs() {
  require_address_space();
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
