#include "pictures.h"
#include <malus_modules_interface.h>

extern "C" const malus::Codecs* malus_picture_codecs(std::uint64_t interface) {
  return interface == malus::app::kModulesInterface ? &malus::linked_codecs() : nullptr;
}
