#include "malus/synthesize/light_case.h"

#include "malus/base/text.h"

namespace malus {

std::optional<LightCase> parsed_light_case(std::string_view text) {
  const std::size_t colon = text.find(':');
  if (colon == text.npos) return std::nullopt;
  const auto gain = decimal_number(text.substr(0, colon)),
             ratio = decimal_number(text.substr(colon + 1));
  if (!gain || !ratio || *ratio <= 0) return std::nullopt;
  return LightCase{*gain, *ratio};
}

}  // namespace malus
