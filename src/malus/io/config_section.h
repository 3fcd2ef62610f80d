// A table of a TOML file with the place to name in messages: sessions, capture plans, training and
// data-set configurations are read through it, so that every mistake gives the same kind of line:
// file:line, key, what is wrong, what to do.
#pragma once

#include "malus/base/error.h"
#include "malus/base/parameter.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace malus {

/// Throws InputError where `given` is no setting as ConfigSection::parse takes them,
/// "SECTION.KEY=VALUE".
void require_setting_text(const std::string& given);

class ConfigSection {
 public:
  /// The root table; title is how messages call the file ("the session file"). `settings` replace
  /// or add to what the file says: each "SECTION.KEY=VALUE", VALUE as in TOML, where a text needs
  /// no quotes. Throws InputError on a TOML error.
  static ConfigSection parse(std::string_view toml, const std::string& source, std::string title,
                             const std::vector<std::string>& settings = {});
  static ConfigSection load(const std::filesystem::path& path, std::string title,
                            const std::vector<std::string>& settings = {});

  /// Throws InputError on a key that is not among the known ones; names the nearest.
  void require_known(const std::vector<std::string>& known) const;
  [[noreturn]] void fail(std::string_view key, std::string_view problem,
                         std::string_view remedy) const;
  /// The same for what something else found wrong with the key's value.
  [[noreturn]] void fail(std::string_view key, const InputError& error) const;
  /// What `use` makes of the key's value; its InputErrors are told as by fail.
  template <class Use>
  auto naming(std::string_view key, const Use& use) const {
    try {
      return use();
    } catch (const InputError& error) {
      fail(key, error);
    }
  }

  bool has(std::string_view key) const;
  std::vector<std::string> keys() const;
  /// Absent keys give an empty value; a wrong type throws InputError.
  std::optional<std::string> text(std::string_view key) const;
  std::optional<double> number(std::string_view key) const;
  std::optional<double> positive_number(std::string_view key) const;
  std::optional<bool> flag(std::string_view key) const;
  std::optional<int> whole_number(std::string_view key, int minimum, int maximum) const;
  std::vector<double> numbers(std::string_view key) const;  ///< one number or a list
  /// One text or a list, which is empty in a setting alone: that leaves out what the file names.
  std::vector<std::string> texts(std::string_view key) const;
  /// All texts here and below, keys not among them: names of files among other things.
  std::vector<std::string> every_text() const;
  std::vector<std::vector<std::string>> text_rows(std::string_view key) const;
  std::optional<ConfigSection> section(std::string_view key) const;  ///< [key]
  std::vector<ConfigSection> sections(std::string_view key) const;   ///< [[key]]
  const std::string& source() const;
  /// Fills a settings struct (base/parameter.h) from the keys of this section; unknown keys, types,
  /// ranges and choices are checked. `also` names keys that the caller reads itself.
  template <class Settings>
  void read(Settings& settings, std::vector<std::string> also = {}) const {
    Settings::describe(settings,
                       [&](auto&, const ParameterInfo& info) { also.push_back(info.name); });
    require_known(also);
    Settings::describe(settings,
                       [&](auto& value, const ParameterInfo& info) { read_value(value, info); });
  }

 private:
  struct Table;
  explicit ConfigSection(std::shared_ptr<const Table> table) : table_(std::move(table)) {}
  bool is_empty_list(std::string_view key) const;
  int whole_value(const ParameterInfo& info) const;
  void check(const ParameterInfo& info, double value) const;
  void check(const ParameterInfo& info, const std::string& value) const;

  template <class Value>
  void read_value(Value& value, const ParameterInfo& info) const {
    if (!has(info.name)) return;
    if constexpr (requires {
                    typename Value::value_type;
                    value.has_value();
                  }) {
      typename Value::value_type plain{};
      read_value(plain, info);
      value = plain;
    } else if constexpr (std::is_same_v<Value, bool>) {
      value = flag(info.name).value_or(value);
    } else if constexpr (std::is_same_v<Value, std::string>) {
      value = text(info.name).value_or(value);
      check(info, value);
    } else if constexpr (std::is_integral_v<Value>) {
      value = whole_value(info);
    } else if constexpr (std::is_floating_point_v<Value>) {
      value = static_cast<Value>(number(info.name).value_or(0));
      check(info, static_cast<double>(value));
    } else {
      // Where nothing is the default, an empty list says so.
      if (value.empty() && is_empty_list(info.name)) return;
      value = numbers(info.name);
      for (const double one : value) check(info, one);
    }
  }

  std::shared_ptr<const Table> table_;
};

}  // namespace malus
