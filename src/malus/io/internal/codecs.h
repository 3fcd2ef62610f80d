// What the picture libraries do for malus_io: the functions that malus_pictures.so hands over, or
// those that a C++ program links (linked_codecs.cpp).
#pragma once

#include "malus/io/codecs.h"
#include "malus/io/internal/camera_raw.h"
#include "malus/io/internal/picture_codec.h"

namespace malus {

struct Codecs {
  decltype(&internal::read_picture) read_picture;
  decltype(&internal::write_picture) write_picture;
  decltype(&internal::read_camera_raw) read_camera_raw;
};

}  // namespace malus
