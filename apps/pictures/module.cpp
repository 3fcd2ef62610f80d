#include "pictures.h"
#include <OpenImageIO/imageio.h>
#include <malus_modules_interface.h>

extern "C" const malus::Codecs* malus_picture_codecs(std::uint64_t interface,
                                                     const malus::Wording& wording) {
  if (interface != malus::app::kModulesInterface) return nullptr;
  malus::use_wording(wording);
  // OpenEXR's own threads do not live on in a forked process: a worker of a Python DataLoader that
  // read an EXR, as its parent had, waited for them for ever.
  OIIO::attribute("exr_threads", -1);
  return &malus::linked_codecs();
}
