// A gain setting in JSON, as lists of pairs, shards and records of runs keep it: "gain_db" and
// "iso", null where not known.
#pragma once

#include "malus/image/raw_frame.h"

#include <optional>

#include <nlohmann/json.hpp>

namespace malus {

inline nlohmann::ordered_json number_or_null(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

inline nlohmann::ordered_json gain_json(const GainSetting& gain) {
  return {{"gain_db", number_or_null(gain.gain_db)}, {"iso", number_or_null(gain.iso)}};
}

/// The gain in an object (json or ordered_json) that gain_json went into. Throws nlohmann's
/// exception where a key is missing.
template <class Json>
GainSetting gain_from(const Json& json) {
  const auto number = [&](const char* key) {
    const auto& value = json.at(key);
    return value.is_number() ? std::optional(value.template get<double>()) : std::nullopt;
  };
  return {number("gain_db"), number("iso")};
}

}  // namespace malus
