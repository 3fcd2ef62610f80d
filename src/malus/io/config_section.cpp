#include "malus/io/config_section.h"

#include "malus/base/settings_check.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/io/internal/file_bytes.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include <fmt/format.h>
#include <toml++/toml.h>

namespace malus {

namespace fs = std::filesystem;

// The root is kept alive by every section made from it.
struct ConfigSection::Table {
  std::shared_ptr<const toml::table> root;
  const toml::table* at = nullptr;
  std::string source, title;

  bool is_setting(const toml::source_region& region) const {
    return region.path && *region.path != source;
  }
  std::string place(const toml::source_region& region) const {
    if (is_setting(region)) return *region.path;
    return region.begin.line > 0 ? fmt::format("{}:{}", source, region.begin.line) : source;
  }
};

namespace {

// Where the quoted text that begins at `at` ends.
std::size_t behind_quotes(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string triple(3, quote);
  const bool has_lines = text.substr(at, 3) == triple;
  for (std::size_t i = at + (has_lines ? 3 : 1); i < text.size(); ++i) {
    if (quote == '"' && text[i] == '\\') {
      ++i;
    } else if (has_lines && text.substr(i, 3) == triple) {
      for (i += 3; i < text.size() && text[i] == quote;) ++i;  // one or two belong to the text
      return i;
    } else if (!has_lines && (text[i] == quote || text[i] == '\n')) {
      return i + (text[i] == quote);
    }
  }
  return text.size();
}

// The line of a key of more parts (a.b.c) than any has. toml++ makes a table of each part and frees
// them by recursion: some ten thousand are more than the stack holds. It bounds nested values
// alone, to 256, whose keys may be as long.
std::optional<std::ptrdiff_t> line_of_deep_key(std::string_view text) {
  constexpr int kMostParts = 32;
  int parts = 1;
  for (std::size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '"' || c == '\'') {
      i = behind_quotes(text, i);
      continue;
    }
    if (c == '#')
      i = std::min(text.find('\n', i), text.size());
    else
      ++i;
    if (c == '.' && ++parts > kMostParts)
      return 1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(i), '\n');
    if (std::string_view("=,[]{}\n").find(c) != std::string_view::npos) parts = 1;
  }
  return std::nullopt;
}

toml::table parsed(std::string_view text, const std::string& source) {
  if (const auto line = line_of_deep_key(text))
    throw InputError(fmt::format("{}:{}", source, *line), "a key has too many parts",
                     "correct the TOML");
  try {
    return toml::parse(text, source);
  } catch (const toml::parse_error& error) {
    throw InputError(fmt::format("{}:{}", source, error.source().begin.line), error.description(),
                     "correct the TOML");
  }
}

// "SECTION.KEY=VALUE"; what is no TOML value is a text.
toml::table parsed_setting(const std::string& given) {
  const std::string source = setting("set", given);
  const std::size_t equals = given.find('=');
  const std::string key = given.substr(0, equals);
  if (equals != std::string::npos) {
    const std::string value = given.substr(equals + 1);
    for (const std::string& text : {value, "'''" + value + "'''"}) try {
        const std::string line = key + " = " + text;
        if (!line_of_deep_key(line)) return toml::parse(line, source);
      } catch (const toml::parse_error&) {  // the other one, or the line below
      }
  }
  throw InputError(source, "is no setting", "write SECTION.KEY=VALUE, e.g. train.steps=500");
}

// Nodes are moved: copies would forget which file or setting they come from.
void merge(toml::table& into, toml::table&& from) {
  for (auto&& [key, node] : from) {
    toml::table* section = node.as_table();
    toml::table* present = into[key.str()].as_table();
    if (section && present)
      merge(*present, std::move(*section));
    else
      node.visit([&, &name = key](auto& value) { into.insert_or_assign(name, std::move(value)); });
  }
}

}  // namespace

void require_setting_text(const std::string& given) { parsed_setting(given); }

ConfigSection ConfigSection::parse(std::string_view text, const std::string& source,
                                   std::string title, const std::vector<std::string>& settings) {
  auto root = std::make_shared<toml::table>(parsed(text, source));
  for (const std::string& given : settings) merge(*root, parsed_setting(given));
  auto table = std::make_shared<Table>();
  table->at = root.get();
  table->root = std::move(root);
  table->source = source;
  table->title = std::move(title);
  return ConfigSection(std::move(table));
}

ConfigSection ConfigSection::load(const fs::path& path, std::string title,
                                  const std::vector<std::string>& settings) {
  const std::string text = internal::read_text(path, title);
  if (text.find('\0') != std::string::npos)
    throw InputError(path.string(), "holds no text", "give " + title + ", a TOML file");
  return parse(text, path.string(), std::move(title), settings);
}

void ConfigSection::fail(std::string_view key, std::string_view problem,
                         std::string_view remedy) const {
  const toml::node* node = table_->at->get(key);
  throw InputError(table_->place(node ? node->source() : table_->at->source()),
                   fmt::format("{} in {} {}", key, table_->title, problem), remedy);
}

void ConfigSection::fail(std::string_view key, const InputError& error) const {
  const toml::node* node = table_->at->get(key);
  throw InputError(
      table_->place(node ? node->source() : table_->at->source()),
      fmt::format("{} in {}: {}: {}", key, table_->title, error.subject(), error.problem()),
      error.remedy());
}

void ConfigSection::require_known(const std::vector<std::string>& known) const {
  for (const auto& [key, node] : *table_->at) {
    const std::string name(key.str());
    if (std::find(known.begin(), known.end(), name) != known.end()) continue;
    throw InputError(table_->place(node.source()),
                     fmt::format("unknown key \"{}\" in {}", name, table_->title),
                     did_you_mean(name, known, true) + "known: " + joined(known));
  }
}

bool ConfigSection::has(std::string_view key) const { return table_->at->get(key) != nullptr; }

std::vector<std::string> ConfigSection::keys() const {
  std::vector<std::string> names;
  for (const auto& [key, unused] : *table_->at) names.emplace_back(key.str());
  return names;
}

std::optional<std::string> ConfigSection::text(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return std::nullopt;
  if (!node->is_string()) fail(key, "is not a text", "put it in quotes");
  return node->ref<std::string>();
}

std::optional<bool> ConfigSection::flag(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return std::nullopt;
  if (!node->is_boolean()) fail(key, "is not true or false", "write true or false without quotes");
  return node->ref<bool>();
}

std::optional<double> ConfigSection::number(std::string_view key) const {
  const auto values = numbers(key);
  if (values.empty()) return std::nullopt;
  if (values.size() > 1 || table_->at->get(key)->is_array())
    fail(key, "is not a number", "correct the value");
  return values[0];
}

std::optional<double> ConfigSection::positive_number(std::string_view key) const {
  const auto value = number(key);
  if (value && !(*value > 0)) fail(key, fmt::format("is {:g}", *value), "give a positive number");
  return value;
}

std::optional<int> ConfigSection::whole_number(std::string_view key, int minimum,
                                               int maximum) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return std::nullopt;
  const auto value = node->value_exact<std::int64_t>();
  if (!value || *value < minimum || *value > maximum)
    fail(key, fmt::format("is not a whole number from {} to {}", minimum, maximum),
         "correct the value");
  return static_cast<int>(*value);
}

bool ConfigSection::is_empty_list(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  return node && node->is_array() && node->as_array()->empty();
}

std::vector<double> ConfigSection::numbers(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return {};
  const auto finite = [&](const toml::node& element) {
    const auto value = element.is_number() ? element.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value)) fail(key, "is not a number", "correct the value");
    return *value;
  };
  const toml::array* list = node->as_array();
  if (!list) return {finite(*node)};
  std::vector<double> values;
  for (const auto& element : *list) values.push_back(finite(element));
  if (values.empty()) fail(key, "is an empty list", "give one number or several");
  return values;
}

std::vector<std::string> ConfigSection::texts(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return {};
  if (const auto* one = node->as_string()) return {one->get()};
  std::vector<std::string> values;
  if (is_empty_list(key)) {
    if (table_->is_setting(node->source())) return {};  // takes out what the file names
    fail(key, "is an empty list", "name one or more, or leave it out");
  }
  if (const toml::array* list = node->as_array())
    for (const auto& element : *list) {
      if (!element.is_string()) fail(key, "holds something else than text", "put it in quotes");
      values.push_back(element.ref<std::string>());
    }
  if (values.empty())
    fail(key, "is not a text or a list of texts", fmt::format("write {} = [\"…\"]", key));
  return values;
}

std::vector<std::vector<std::string>> ConfigSection::text_rows(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return {};
  const std::string remedy = fmt::format("write {} = [[\"R90\", \"R45\"], …]", key);
  const toml::array* rows = node->as_array();
  if (!rows) fail(key, "is not a list of lists", remedy);
  std::vector<std::vector<std::string>> values;
  for (const auto& row : *rows) {
    const toml::array* names = row.as_array();
    if (!names) fail(key, "is not a list of lists", remedy);
    values.emplace_back();
    for (const auto& name : *names) {
      if (!name.is_string()) fail(key, "holds something else than text", "put it in quotes");
      values.back().push_back(name.ref<std::string>());
    }
  }
  return values;
}

std::vector<std::string> ConfigSection::every_text() const {
  std::vector<std::string> texts;
  const auto visit = [&texts](const toml::node& node, const auto& self) -> void {
    if (const toml::table* table = node.as_table())
      for (const auto& [key, below] : *table) self(below, self);
    if (const toml::array* list = node.as_array())
      for (const toml::node& below : *list) self(below, self);
    if (node.is_string()) texts.push_back(node.ref<std::string>());
  };
  visit(*table_->at, visit);
  return texts;
}

std::optional<ConfigSection> ConfigSection::section(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return std::nullopt;
  if (!node->is_table()) fail(key, "is not a table", fmt::format("write [{}]", key));
  auto table = std::make_shared<Table>(*table_);
  table->at = node->as_table();
  // Of a table in a table: [sensor.cell].
  const std::string& outer = table_->title;
  table->title = outer.starts_with("[") && !outer.starts_with("[[")
                     ? fmt::format("{}.{}]", outer.substr(0, outer.size() - 1), key)
                     : fmt::format("[{}]", key);
  return ConfigSection(std::move(table));
}

std::vector<ConfigSection> ConfigSection::sections(std::string_view key) const {
  const toml::node* node = table_->at->get(key);
  if (!node) return {};
  const toml::array* list = node->as_array();
  if (!list) fail(key, "is not a list", fmt::format("write [[{}]]", key));
  std::vector<ConfigSection> all;
  for (const auto& element : *list) {
    if (!element.is_table()) fail(key, "is not a list of tables", fmt::format("write [[{}]]", key));
    auto table = std::make_shared<Table>(*table_);
    table->at = element.as_table();
    table->title = fmt::format("[[{}]] number {}", key, all.size() + 1);
    all.push_back(ConfigSection(std::move(table)));
  }
  return all;
}

const std::string& ConfigSection::source() const { return table_->source; }

int ConfigSection::whole_value(const ParameterInfo& info) const {
  const auto value = table_->at->get(info.name)->value_exact<std::int64_t>();
  if (!value)
    fail(info.name, "is not a whole number in plain digits",
         fmt::format("give {:g} to {:g}", info.minimum, info.maximum));
  check(info, static_cast<double>(*value));
  if (!std::in_range<int>(*value)) fail(info.name, "is too large", "give 9 digits at most");
  return static_cast<int>(*value);
}

void ConfigSection::check(const ParameterInfo& info, double value) const {
  if (const std::string remedy = setting_remedy(value, info); !remedy.empty())
    fail(info.name, fmt::format("is {:g}", value), remedy);
}

void ConfigSection::check(const ParameterInfo& info, const std::string& value) const {
  if (const std::string remedy = setting_remedy(value, info); !remedy.empty())
    fail(info.name, fmt::format("is \"{}\"", value), remedy);
}

}  // namespace malus
