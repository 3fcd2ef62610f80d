// Small helps with names and messages.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace malus {

/// The candidate with the smallest edit distance to name; empty when there are no candidates.
std::string nearest_name(std::string_view name, std::span<const std::string> candidates);

/// Its ASCII letters in lower case.
std::string lower_case(std::string text);

/// "a, b, c"
std::string joined(std::span<const std::string> parts, std::string_view separator = ", ");

/// "1 image", "2 images", "0 images".
std::string counted(std::int64_t number, std::string_view noun);

/// A share of 0..1 in percent, to two digits and never with an exponent: "0.034", "12", "100".
std::string percent_text(double share);

}  // namespace malus
