// The codecs of other libraries, behind one door. OpenImageIO brings two hundred libraries along,
// and a program that links it waits a fifth of a second for them before it does anything.
#pragma once

namespace malus {

struct Codecs;

/// Those that are linked to the caller: OpenImageIO and LibRaw.
const Codecs& linked_codecs();

/// What everything in this module reads and writes pictures with: the linked ones. A program that
/// defines this function itself leaves them out of its file, and the libraries with them: malus
/// opens the module that holds them when the first picture comes (apps/doors/pictures_door.cpp).
/// Throws InputError where they cannot be had.
const Codecs& codecs();

}  // namespace malus
