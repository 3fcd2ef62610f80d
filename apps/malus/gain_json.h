// A gain setting in JSON: "gain_db" and "iso", null where not known.
#pragma once

#include "malus/image/raw_frame.h"

#include <optional>

#include <nlohmann/json.hpp>

namespace malus::app {

inline nlohmann::ordered_json number_or_null(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

inline nlohmann::ordered_json gain_json(const GainSetting& gain) {
  return {{"gain_db", number_or_null(gain.gain_db)}, {"iso", number_or_null(gain.iso)}};
}

/// The gain in an object that gain_json went into. Throws nlohmann's exception where a key is
/// missing.
inline GainSetting gain_from(const nlohmann::ordered_json& json) {
  const auto number = [&](const char* key) {
    const auto& value = json.at(key);
    return value.is_number() ? std::optional(value.get<double>()) : std::nullopt;
  };
  return {number("gain_db"), number("iso")};
}

}  // namespace malus::app
