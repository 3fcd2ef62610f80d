#include "flags.h"

#include "malus/base/text.h"
#include "malus/io/session.h"
#include "malus/synthesize/exact.h"

#include <charconv>
#include <limits>
#include <string_view>
#include <utility>

namespace malus::app {
namespace {

// Shortest digits, without the exponent of {:g} where they are few.
std::string words_of_range(double minimum, double maximum) {
  if (std::isfinite(minimum) && std::isfinite(maximum))
    return fmt::format("must be between {} and {}", minimum, maximum);
  return std::isfinite(minimum) ? fmt::format("must be a finite number of at least {}", minimum)
                                : fmt::format("must be a finite number of at most {}", maximum);
}

// A whole number as it would be printed; empty for every other text, 010 among them, which CLI11
// goes on to read as 8.
template <class Whole>
std::optional<Whole> plain_digits(const std::string& text) {
  Whole value = 0;
  const auto [stop, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || std::to_string(value) != text) return std::nullopt;
  return value;
}

template <class Whole>
std::string whole_number_wanted(Whole minimum, Whole maximum, const std::string& text) {
  return fmt::format("must be a whole number between {} and {} in plain digits, not {}", minimum,
                     maximum, text.empty() ? "\"\"" : text);
}

// --kind takes several kinds where the library's setting is a list of them.
std::string flag_of_setting(std::string_view name) {
  return flag_name(name == "kinds" ? "kind" : std::string(name));
}

std::string setting_as_flag(std::string_view name, const SettingValue& value) {
  const std::string flag = flag_of_setting(name);
  if (const auto* on = std::get_if<bool>(&value)) return *on ? flag : "--no-" + flag.substr(2);
  if (const auto* number = std::get_if<double>(&value)) return flag + " " + number_text(*number);
  if (const auto* text = std::get_if<std::string_view>(&value))
    return fmt::format("{} {}", flag, *text);
  return flag;
}

std::string command_line(std::string_view words) { return fmt::format("`malus {}`", words); }

}  // namespace

constexpr Wording kFlagWording{setting_as_flag, flag_of_setting, command_line};

CLI::Validator in_range(double minimum, double maximum) {
  CLI::Validator validator{CLI::Range(minimum, maximum).get_description()};
  return validator.operation([=](std::string& text) {
    const auto value = decimal_number(text);
    return value && *value >= minimum && *value <= maximum
               ? std::string()
               : fmt::format("{}, not {}", words_of_range(minimum, maximum), text);
  });
}

CLI::Validator in_range(int minimum, int maximum) {
  CLI::Validator validator{CLI::Range(minimum, maximum).get_description()};
  return validator.operation([=](std::string& text) {
    const auto value = plain_digits<int>(text);
    return value && *value >= minimum && *value <= maximum
               ? std::string()
               : whole_number_wanted(minimum, maximum, text);
  });
}

CLI::Validator positive_number() {
  return CLI::Validator("POSITIVE").operation([](std::string& text) {
    const auto value = decimal_number(text);
    return value && *value > 0 ? std::string()
                               : fmt::format("must be a finite number above 0, not {}", text);
  });
}

CLI::Validator finite_number() {
  return CLI::Validator("").operation([](std::string& text) {
    return decimal_number(text) ? std::string()
                                : fmt::format("must be a finite number, not {}", text);
  });
}

CLI::Validator counting_number(std::uint64_t maximum) {
  return CLI::Validator("").operation([=](std::string& text) {
    const auto value = plain_digits<std::uint64_t>(text);
    return value && *value <= maximum ? std::string()
                                      : whole_number_wanted(std::uint64_t{0}, maximum, text);
  });
}

CLI::Validator one_of(std::vector<std::string> choices) {
  CLI::Validator validator{CLI::IsMember(choices).get_description()};
  return validator.operation([choices = std::move(choices)](std::string& text) {
    return std::ranges::find(choices, text) != choices.end()
               ? std::string()
               : fmt::format("\"{}\" is not known; {}known: {}", text, did_you_mean(text, choices),
                             joined(choices));
  });
}

CLI::Validator accepted_by(std::function<void(const std::string&)> read) {
  return CLI::Validator("").operation([read = std::move(read)](std::string& text) {
    try {
      read(text);
      return std::string();
    } catch (const InputError& error) {
      return fmt::format("\"{}\" {}; {}", text, error.problem(), error.remedy());
    }
  });
}

CLI::Validator gain_in_db() {
  return CLI::Validator("").operation([](std::string& text) {
    const auto value = decimal_number(text);
    if (!value) return fmt::format("must be a finite number, not {}", text);
    const auto fault = fault_of({{*value, {}}, {}}, true);
    return fault ? fmt::format("{}; {}", fault->problem, fault->remedy) : std::string();
  });
}

CLI::Validator frame_number() { return counting_number(std::numeric_limits<std::uint32_t>::max()); }

CLI::Option* add_origin(CLI::App& command, std::vector<int>& place, const std::string& help) {
  const auto take = [&place](const std::vector<int>& told) {
    if (told.size() != 2) throw CLI::ValidationError("--origin", "must be row,column");
    place = told;
  };
  return command.add_option_function<std::vector<int>>("--origin", take, help)
      ->delimiter(',')
      ->allow_extra_args(false)
      ->check(in_range(0, kLastPosition));
}

}  // namespace malus::app
