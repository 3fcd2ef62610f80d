// A gain setting in JSON, as lists of pairs, shards and records of runs keep it: "gain_db" and
// "iso", null where not known.
#pragma once

#include "malus/base/error.h"
#include "malus/image/raw_frame.h"
#include "malus/io/session.h"

#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace malus {

inline nlohmann::ordered_json number_or_null(const std::optional<double>& value) {
  return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
}

inline nlohmann::ordered_json gain_json(const GainSetting& gain) {
  return {{"gain_db", number_or_null(gain.gain_db)}, {"iso", number_or_null(gain.iso)}};
}

/// The gain in an object (json or ordered_json) that gain_json went into. Throws nlohmann's
/// exception where a key is missing, or neither number nor null.
template <class Json>
GainSetting gain_from(const Json& json) {
  const auto number = [&](const char* key) {
    const auto& value = json.at(key);
    return value.is_null() ? std::nullopt : std::optional(value.template get<double>());
  };
  return {number("gain_db"), number("iso")};
}

/// The same of a file, source, that anybody may have written: throws InputError, naming it, where
/// no camera has such a gain (fault_of).
template <class Json>
GainSetting checked_gain_from(const Json& json, const std::string& source) {
  const GainSetting gain = gain_from(json);
  if (const auto fault = fault_of({gain, std::nullopt}, true))
    throw InputError(source, fault->key + ": " + fault->problem, fault->remedy);
  return gain;
}

}  // namespace malus
