// web/built/report.html, part of the program.
#pragma once

#include <string_view>

namespace malus::internal {

std::string_view embedded_page();

}  // namespace malus::internal
