// Records of the library as Python's dictionaries.
#pragma once

#include <nlohmann/json.hpp>
#include <pybind11/pybind11.h>

namespace malus::python {

/// Through Python's own parser. Names in files may be no UTF-8: such bytes are replaced.
inline pybind11::object python_of(const nlohmann::ordered_json& json) {
  return pybind11::module_::import("json").attr("loads")(
      json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
}

}  // namespace malus::python
