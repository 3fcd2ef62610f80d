// The facts of a frame as one line of text inside a file's description:
//   [malus layout=polar-mono black=82 white=4095 gain_db=24 exposure_s=0.01 mean_of=8]
// so that what malus wrote reads back without flags. A custom cell is cell=0,45/135,90.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/io/internal/decoded.h"

#include <string>

namespace malus::internal {

/// Only what is known (RawFrame's *_known flags); holds: what the pixels are, one word or nothing.
std::string frame_tags(const RawFrame& frame, const std::string& holds = "");

/// [malus holds=variance], or nothing for an empty word.
std::string content_tag(const std::string& holds);

/// Sets what decoded.description tells in these tags; text without tags, or with damaged ones, is
/// no error and tells nothing.
void apply_frame_tags(Decoded& decoded);

}  // namespace malus::internal
