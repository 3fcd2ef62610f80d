// Frames that were there already, told by their pixels: the same noise twice counts as less than it
// is.
#pragma once

#include "malus/image/raw_frame.h"

#include <cstdint>
#include <string>
#include <unordered_map>

namespace malus {

/// Equal for equal pixels; unequal ones share it once in 10^19.
std::uint64_t pixel_fingerprint(const Image& dn);

/// The frames of one set.
class SeenFrames {
 public:
  /// Throws InputError, which names both, for a frame whose pixels came already: a frame has no
  /// noise against a copy of itself. Frames of which nine tenths have one value may be equal
  /// without being copies: saturated, or dark without noise. fingerprint: of the frame's pixels, or
  /// of what they were made of.
  void refuse_copy(const RawFrame& frame, std::uint64_t fingerprint);

 private:
  std::unordered_map<std::uint64_t, std::string> sources_;
};

}  // namespace malus
