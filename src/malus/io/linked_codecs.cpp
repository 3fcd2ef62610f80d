#include "malus/io/internal/codecs.h"

namespace malus {

const Codecs& linked_codecs() {
  static constexpr Codecs kLinked{internal::read_picture, internal::write_picture,
                                  internal::read_camera_raw};
  return kLinked;
}

}  // namespace malus
