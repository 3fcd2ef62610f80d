// A chart as SVG for papers: black on white, vector text, no outside references.
#pragma once

#include "malus/report/report.h"

#include <string>

namespace malus {

/// 720 x 460 units.
std::string chart_svg(const Chart& chart);

}  // namespace malus
