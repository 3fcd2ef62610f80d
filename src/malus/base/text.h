// Small helps with names and messages.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace malus {

/// The candidate that was probably meant, case aside: a slip of the keyboard per four letters away
/// at most; or one that holds the name, begins it or begins alike; empty where none is near.
std::string nearest_name(std::string_view name, std::span<const std::string> candidates);

/// "did you mean info? ", for what follows; empty where none is near. quoted: "info".
std::string did_you_mean(std::string_view name, std::span<const std::string> candidates,
                         bool quoted = false);

/// Its ASCII letters in lower case.
std::string lower_case(std::string text);

/// "a, b, c"
std::string joined(std::span<const std::string> parts, std::string_view separator = ", ");

/// The whole text as one finite decimal number, with or without sign and exponent; empty where it
/// is anything else, as 0x10, 1_000 or inf.
std::optional<double> decimal_number(std::string_view text);

/// "1 image", "2 images", "0 images".
std::string counted(std::int64_t number, std::string_view noun);

/// Whether these bytes are UTF-8, as JSON and TOML have to be; names of files need not be.
bool is_utf8(std::string_view text);

/// "1 image is", "2 images are".
std::string counted_are(std::int64_t number, std::string_view noun);

/// A share of 0..1 in percent, to two digits (one below 0.0001 %) and never with an exponent:
/// "0.00002", "0.034", "12", "100".
std::string percent_text(double share);

}  // namespace malus
