// What a raw frame tells about itself, for `malus info` and malus.info.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/frame_statistics.h"
#include "malus/io/frame_file.h"
#include "malus/polar/layout_check.h"

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

struct Findings {
  FrameInfo info;
  std::vector<ChannelSummary> channels;
  Estimate<ValueGrid> grid = Undecided{"not looked at"};
  LayoutCheck check;
  std::vector<std::string> warnings;  ///< without the frame's name
};

/// Looks at the pixels of info.frame.
Findings findings_of(FrameInfo info);

/// Every number with its unit.
nlohmann::ordered_json findings_json(const Findings& findings);

}  // namespace malus::app
