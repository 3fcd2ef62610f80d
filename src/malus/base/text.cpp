#include "malus/base/text.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

// Letters to be put in, left out, exchanged, or turned about with the next one (optimal string
// alignment), three rows at a time.
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before, last, row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 1; i <= a.size(); ++i) {
    before = std::exchange(last, row);
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] =
          std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        row[j] = std::min(row[j], before[j - 2] + 1);
    }
  }
  return row[b.size()];
}

}  // namespace

std::string nearest_name(std::string_view name, std::span<const std::string> candidates) {
  constexpr std::size_t kLettersPerSlip = 4, kPart = 3, kStem = 4;
  const std::string meant = lower_case(std::string(name));
  const std::string* nearest = nullptr;
  std::size_t least = std::max<std::size_t>(1, meant.size() / kLettersPerSlip) + 1;
  for (const std::string& candidate : candidates)
    if (const std::size_t distance = edit_distance(meant, lower_case(candidate));
        distance < least) {
      nearest = &candidate;
      least = distance;
    }
  if (nearest != nullptr) return *nearest;
  for (const std::string& candidate : candidates) {
    const std::string lower = lower_case(candidate);
    const auto stem =
        static_cast<std::size_t>(std::ranges::mismatch(meant, lower).in1 - meant.begin());
    const bool related = stem >= kStem && 3 * stem >= 2 * lower.size();
    const bool part = meant.size() >= kPart && lower.find(meant) != std::string::npos;
    const bool longer =
        lower.size() >= kPart && 2 * lower.size() >= meant.size() && meant.starts_with(lower);
    if ((related || part || longer) && (nearest == nullptr || candidate.size() < nearest->size()))
      nearest = &candidate;
  }
  return nearest == nullptr ? "" : *nearest;
}

std::string did_you_mean(std::string_view name, std::span<const std::string> candidates,
                         bool quoted) {
  const std::string nearest = nearest_name(name, candidates);
  if (nearest.empty()) return {};
  return fmt::format("did you mean {0}{1}{0}? ", quoted ? "\"" : "", nearest);
}

std::string lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

std::string joined(std::span<const std::string> parts, std::string_view separator) {
  std::string text;
  for (const auto& part : parts) {
    if (!text.empty()) text += separator;
    text += part;
  }
  return text;
}

std::optional<double> decimal_number(std::string_view text) {
  if (text.starts_with('+') && !text.starts_with("+-")) text.remove_prefix(1);
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::string counted(std::int64_t number, std::string_view noun) {
  return fmt::format("{} {}{}", number, noun, number == 1 ? "" : "s");
}

std::string counted_are(std::int64_t number, std::string_view noun) {
  return counted(number, noun) + (number == 1 ? " is" : " are");
}

// Unicode 15, table 3-7: what the second byte may be excludes longer forms than needed, surrogates
// and what lies beyond U+10FFFF.
bool is_utf8(std::string_view text) {
  const auto between = [](unsigned char c, unsigned low, unsigned high) {
    return c >= low && c <= high;
  };
  for (std::size_t i = 0; i < text.size();) {
    const auto first = static_cast<unsigned char>(text[i++]);
    if (first < 0x80) continue;
    if (!between(first, 0xC2, 0xF4)) return false;
    const std::size_t more = first < 0xE0 ? 1 : first < 0xF0 ? 2 : 3;
    if (text.size() - i < more) return false;
    const auto second = static_cast<unsigned char>(text[i]);
    if (!between(second,
                 first == 0xE0   ? 0xA0
                 : first == 0xF0 ? 0x90
                                 : 0x80,
                 first == 0xED   ? 0x9F
                 : first == 0xF4 ? 0x8F
                                 : 0xBF))
      return false;
    for (std::size_t k = 1; k < more; ++k)
      if (!between(static_cast<unsigned char>(text[i + k]), 0x80, 0xBF)) return false;
    i += more;
  }
  return true;
}

std::string percent_text(double share) {
  const double percent = 100 * share;
  if (percent >= 10) return fmt::format("{:.0f}", percent);
  constexpr double kFixed = 1e-4;  // of {:g}, which goes on with an exponent
  if (!(percent > 0 && percent < kFixed)) return fmt::format("{:.2g}", percent);
  const int first_digit = static_cast<int>(std::ceil(-std::log10(percent)));
  return fmt::format("{:.{}f}", percent, first_digit);
}

}  // namespace malus
