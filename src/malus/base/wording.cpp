#include "malus/base/wording.h"

#include <atomic>

#include <fmt/format.h>

namespace malus {
namespace {

std::string plain_setting(std::string_view name, const SettingValue& value) {
  if (const auto* on = std::get_if<bool>(&value))
    return fmt::format("{} {}", name, *on ? "true" : "false");
  if (const auto* number = std::get_if<double>(&value))
    return fmt::format("{} {}", name, number_text(*number));
  if (const auto* text = std::get_if<std::string_view>(&value))
    return fmt::format("{} {}", name, *text);
  return std::string(name);
}

std::string plain_name(std::string_view name) { return std::string(name); }

std::string plain_command(std::string_view words) { return fmt::format("`malus {}`", words); }

}  // namespace

constexpr Wording kPlainWording{plain_setting, plain_name, plain_command};

namespace {

std::atomic<const Wording*> g_wording = &kPlainWording;

}  // namespace

void use_wording(const Wording& wording) { g_wording = &wording; }

std::string setting(std::string_view name, const SettingValue& value) {
  return g_wording.load()->setting(name, value);
}

std::string setting_name(std::string_view name) { return g_wording.load()->setting_name(name); }

std::string command(std::string_view words) { return g_wording.load()->command(words); }

std::string number_text(double value) { return fmt::format("{:g}", value); }

}  // namespace malus
