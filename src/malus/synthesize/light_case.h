// How much light a noisy frame is taken with, as experiments and configurations write it.
#pragma once

#include <optional>
#include <string_view>

namespace malus {

/// Low-light ratios that are taken, wherever one is told. A network must be asked for any that it
/// can be trained with.
inline constexpr double kLeastRatio = 1e-6, kMostRatio = 1e9;

struct LightCase {
  double gain = 0, ratio = 1;  ///< gain in the model's unit: dB or ISO; ratio: low-light ratio
};

/// "12:60" is gain 12 and a sixtieth of the light; none where the text is no such pair of finite
/// numbers, or the ratio is not above 0.
std::optional<LightCase> parsed_light_case(std::string_view text);

}  // namespace malus
