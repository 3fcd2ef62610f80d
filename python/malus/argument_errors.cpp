#include "argument_errors.h"

#include <unordered_map>

namespace malus::python {
namespace {

namespace py = pybind11;

// All functions that pybind11 makes share it. It tries their overloads and gives up with the list.
PyCFunctionWithKeywords g_dispatcher = nullptr;

// Every function by what CPython hands it as self: its documentation begins with the signature.
std::unordered_map<PyObject*, const PyMethodDef*>& methods() {
  static auto* all = new std::unordered_map<PyObject*, const PyMethodDef*>;
  return *all;
}

py::str documentation_of(PyObject* self) {
  const auto found = methods().find(self);
  return found == methods().end() || !found->second->ml_doc ? "" : found->second->ml_doc;
}

// Leaves the error that there is in place where it has nothing better to say.
void explain(PyObject* self, PyObject* args, PyObject* kwargs) {
  PyObject *type = nullptr, *value = nullptr, *trace = nullptr;
  PyErr_Fetch(&type, &value, &trace);
  PyErr_NormalizeException(&type, &value, &trace);
  try {
    const py::str message{py::handle(value)};
    const py::object line =
        py::module_::import("malus._arguments")
            .attr("explain")(message, py::handle(args),
                             kwargs ? py::reinterpret_borrow<py::dict>(kwargs) : py::dict(),
                             documentation_of(self));
    if (!line.is_none()) {
      PyErr_SetObject(PyExc_TypeError, line.ptr());
      Py_XDECREF(type);
      Py_XDECREF(value);
      Py_XDECREF(trace);
      return;
    }
  } catch (const py::error_already_set&) {
    // A value whose repr fails, say.
  }
  PyErr_Restore(type, value, trace);
}

PyObject* dispatch(PyObject* self, PyObject* args, PyObject* kwargs) {
  PyObject* const result = g_dispatcher(self, args, kwargs);
  if (result == nullptr && PyErr_ExceptionMatches(PyExc_TypeError)) explain(self, args, kwargs);
  return result;
}

void replace_dispatcher(py::handle function) {
  if (PyInstanceMethod_Check(function.ptr()))
    function = PyInstanceMethod_GET_FUNCTION(function.ptr());
  if (!PyCFunction_Check(function.ptr())) return;
  PyMethodDef* const method = reinterpret_cast<PyCFunctionObject*>(function.ptr())->m_ml;
  if (method->ml_flags != (METH_VARARGS | METH_KEYWORDS)) return;  // of a pybind11 to come
  const auto current =
      reinterpret_cast<PyCFunctionWithKeywords>(reinterpret_cast<void (*)()>(method->ml_meth));
  if (g_dispatcher == nullptr) g_dispatcher = current;
  if (current != g_dispatcher) return;
  method->ml_meth = reinterpret_cast<PyCFunction>(reinterpret_cast<void (*)()>(&dispatch));
  methods()[PyCFunction_GET_SELF(function.ptr())] = method;
}

}  // namespace

void explain_argument_errors(const py::module_& m) {
  // layouts is surely one of pybind11's: whatever else is callable here must not set the pattern.
  replace_dispatcher(m.attr("layouts"));
  for (const auto& [name, member] : m.attr("__dict__").cast<py::dict>()) {
    replace_dispatcher(member);
    if (!PyType_Check(member.ptr())) continue;
    const py::dict members(member.attr("__dict__"));
    for (const auto& [method, function] : members) replace_dispatcher(function);
  }
}

}  // namespace malus::python
