#include "pictures.h"
#include <malus_modules_interface.h>

extern "C" const malus::Codecs* malus_picture_codecs(std::uint64_t interface,
                                                     const malus::Wording& wording) {
  if (interface != malus::app::kModulesInterface) return nullptr;
  malus::use_wording(wording);
  return &malus::linked_codecs();
}
