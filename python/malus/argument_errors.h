// Arguments of a wrong type: one line in place of pybind11's list of all that would have been
// right.
#pragma once

#include <pybind11/pybind11.h>

namespace malus::python {

/// For all functions and classes that the module has by then.
void explain_argument_errors(const pybind11::module_& m);

}  // namespace malus::python
