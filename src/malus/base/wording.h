// How messages name what a user can change. The library does not know whether it was called by the
// program, by Python or by C++, which write a setting as a flag, a keyword or a member: whoever
// stands at the rim says so once, and messages are then made in its words.
//
//   InputError(path, "exists already", "use " + setting("force", true) + " to replace it")
//     the program:  use --force to replace it
//     Python:       use force=True to replace it
//     C++:          use force true to replace it
//
// What is stored, as the warnings in a model file, is read in another world than it was written in:
// it names settings in plain words, without these functions.
#pragma once

#include <string>
#include <string_view>
#include <variant>

namespace malus {

/// Nothing, a switch, a number (shown with six digits), a text.
using SettingValue = std::variant<std::monostate, bool, double, std::string_view>;

/// How a setting and a command of the program are written. name: as it is declared
/// (base/parameter.h), words joined by '_'; words: "model list".
struct Wording {
  std::string (*setting)(std::string_view name, const SettingValue& value);
  std::string (*setting_name)(std::string_view name);
  std::string (*command)(std::string_view words);
};

/// C++'s: "black 82", "shot false", "`malus model list`".
extern const Wording kPlainWording;

/// For the whole process, before its first message is made; until then
/// kPlainWording. The wording has to outlive the messages: a static one.
void use_wording(const Wording& wording);

/// A setting within a sentence, alone or with a value: "check --black", "calibrate with --kind
/// physics", "leave out --no-row".
std::string setting(std::string_view name, const SettingValue& value = {});

/// A setting as the subject of an error: "--memory", "memory".
std::string setting_name(std::string_view name);

/// What shows something, within a sentence: "`malus model list`", "malus.models()".
std::string command(std::string_view words);

/// The number as messages show it.
std::string number_text(double value);

}  // namespace malus
