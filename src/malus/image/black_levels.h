// Black levels per channel: one number for all of them, or one each; and what becomes of them where
// a frame's layout changes.
#pragma once

#include "malus/image/raw_frame.h"

#include <string>
#include <vector>

namespace malus {

/// One level per channel, from that many or from one for all. Throws InputError naming the source.
std::vector<double> black_per_channel(const std::vector<double>& values, const SensorLayout& layout,
                                      const std::string& source);

/// The black levels of a frame that is given another layout: positions keep theirs. Throws
/// InputError where positions of one new channel have unlike blacks.
std::vector<double> blacks_for_layout(const RawFrame& frame, const SensorLayout& layout);

}  // namespace malus
