#pragma once

#include <string>
#include <string_view>

namespace malus {

/// The text with a space for each control character: messages are promised to be one line, and
/// names from files may hold anything.
std::string one_line(std::string_view text);

}  // namespace malus
