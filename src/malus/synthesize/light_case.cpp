#include "malus/synthesize/light_case.h"

#include <charconv>
#include <cmath>

namespace malus {
namespace {

std::optional<double> number_of(std::string_view text) {
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  if (error != std::errc() || stop != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

}  // namespace

std::optional<LightCase> parsed_light_case(std::string_view text) {
  const std::size_t colon = text.find(':');
  if (colon == text.npos) return std::nullopt;
  const auto gain = number_of(text.substr(0, colon)), ratio = number_of(text.substr(colon + 1));
  if (!gain || !ratio || *ratio <= 0) return std::nullopt;
  return LightCase{*gain, *ratio};
}

}  // namespace malus
