// Text that JSON can hold.
#pragma once

#include <string>

#include <nlohmann/json.hpp>

namespace malus {

/// Names of files are any bytes; JSON knows UTF-8 only and would refuse to be written. Bytes that
/// are none become the replacement character.
inline nlohmann::json json_text(const std::string& bytes) {
  using Json = nlohmann::json;
  return Json::parse(Json(bytes).dump(-1, ' ', false, Json::error_handler_t::replace));
}

}  // namespace malus
