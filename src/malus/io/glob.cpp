#include "malus/io/internal/glob.h"

#include "malus/io/frame_stack.h"

#include <algorithm>
#include <cctype>
#include <system_error>

#include <glob.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// A run of digits without its leading zeros; advances text past it.
std::string_view take_number(std::string_view& text) {
  std::size_t length = 0;
  while (length < text.size() && is_digit(text[length])) ++length;
  std::string_view number = text.substr(0, length);
  text.remove_prefix(length);
  while (number.size() > 1 && number.front() == '0') number.remove_prefix(1);
  return number;
}

std::string escaped(const std::string& literal) {
  std::string out;
  for (const char c : literal) {
    if (c == '*' || c == '?' || c == '[' || c == '\\') out += '\\';
    out += c;
  }
  return out;
}

// The pattern, but for the folders that it begins with: those that exist by the very name are
// meant.
std::string after_folders(const fs::path& pattern, fs::path folder) {
  std::string full = escaped(folder.string());
  bool literal = true;
  for (const fs::path& part : pattern) {
    std::error_code ignored;
    literal = literal && fs::is_directory(folder / part, ignored);
    folder /= part;
    if (!full.empty() && full.back() != '/') full += '/';
    full += literal ? escaped(part.string()) : part.string();
  }
  return full;
}

}  // namespace

bool natural_less(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a, whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (is_digit(a.front()) && is_digit(b.front())) {
      const auto x = take_number(a), y = take_number(b);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
    } else {
      if (a.front() != b.front()) return a.front() < b.front();
      a.remove_prefix(1);
      b.remove_prefix(1);
    }
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // 01 and 1: any fixed order
}

std::vector<fs::path> expand_glob(const fs::path& folder, const std::string& pattern) {
  std::error_code ignored;
  const fs::path literal = folder / pattern;  // an absolute pattern replaces the folder
  if (fs::exists(literal, ignored) || frame_place(literal).index) return {literal};
  const std::string full =
      after_folders(pattern, fs::path(pattern).is_absolute() ? fs::path() : folder);
  glob_t matches{};
  std::vector<fs::path> paths;
  if (::glob(full.c_str(), GLOB_NOSORT, nullptr, &matches) == 0)
    for (std::size_t i = 0; i < matches.gl_pathc; ++i) paths.emplace_back(matches.gl_pathv[i]);
  ::globfree(&matches);
  std::sort(paths.begin(), paths.end(), [](const fs::path& a, const fs::path& b) {
    return natural_less(a.native(), b.native());
  });
  return paths;
}

}  // namespace malus::internal
