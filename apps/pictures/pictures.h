// The door between the program and the codecs of other libraries (malus/io/codecs.h), which live in
// a shared module, malus_pictures.so, that the program opens when the first picture is read or
// written. Commands that touch none start in a hundredth of a second instead of a quarter.
#pragma once

#include "malus/io/codecs.h"

#include <cstdint>

namespace malus::app {

/// What the module exports, by this name. interface: kModulesInterface of the program; the answer
/// is null if the module has another one.
using PictureCodecsEntry = const Codecs* (*)(std::uint64_t interface);
inline constexpr const char* kPictureCodecsEntry = "malus_picture_codecs";

}  // namespace malus::app
