// Messages of the library in Python's words: settings as keyword arguments, commands as functions.
#pragma once

#include "malus/base/wording.h"

#include <pybind11/pybind11.h>

namespace malus::python {

extern const Wording kKeywordWording;

/// Also leaves the names that differ from the library's in m._keywords, for the tests.
void use_python_wording(pybind11::module_& m);

}  // namespace malus::python
