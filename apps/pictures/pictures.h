// The door between the program, or the Python module, and the codecs of other libraries
// (malus/io/codecs.h), which live in a shared module, malus_pictures.so, that is opened when the
// first picture is read or written. Commands that touch none start in a hundredth of a second
// instead of a quarter.
#pragma once

#include "malus/base/wording.h"
#include "malus/io/codecs.h"

#include <cstdint>

namespace malus::app {

/// What the module exports, by this name. interface: kModulesInterface of the opener; the answer
/// is null if the module has another one. wording: of the messages of the codecs, which may have
/// their own copy of what makes them (apps/doors/module_file.h).
using PictureCodecsEntry = const Codecs* (*)(std::uint64_t interface, const Wording& wording);
inline constexpr const char* kPictureCodecsEntry = "malus_picture_codecs";

}  // namespace malus::app
