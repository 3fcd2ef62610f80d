// The Python module malus._malus: NumPy in, NumPy out, no algorithms. The interpreter's lock is
// released around every computation.
#include "malus/base/error.h"
#include "malus/base/fork.h"
#include "malus/base/parallel.h"
#include "malus/image/layout.h"

#include "argument_errors.h"
#include "arrays.h"
#include "kept_network.h"
#include "modules.h"
#include "wording.h"
#include <pybind11/stl.h>

namespace malus::python {
namespace {

int set_threads(int threads) {
  if (threads < 0) throw InputError("threads", "is negative", "give 0 for all cores, or more");
  return set_thread_count(threads);
}

// A forked process (a worker of a torch DataLoader) has the one thread that called fork.
void one_thread_after_fork() {
  py::module_::import("os").attr("register_at_fork")(py::arg("after_in_child") =
                                                         py::cpp_function([] {
                                                           work_alone();
                                                           forget_networks();
                                                         }));
}

}  // namespace

PYBIND11_MODULE(_malus, m) {
  m.doc() = "Measure a camera's noise, imitate it and remove it";
  m.attr("__version__") = MALUS_VERSION;
  static py::exception<InputError> input_error(m, "InputError", PyExc_ValueError);
  input_error.doc() = "Bad input or environment: what is wrong with what, and what to do.";
  py::register_exception_translator([](std::exception_ptr pending) {
    try {
      if (pending) std::rethrow_exception(pending);
    } catch (const InputError& error) {
      PyErr_SetObject(input_error.ptr(), text_of(error.what()).ptr());
    } catch (const Cancelled&) {
      if (!PyErr_Occurred()) PyErr_SetString(PyExc_KeyboardInterrupt, "");
    }
  });
  use_python_wording(m);
  remember_modules();
  bind_frames(m);
  bind_model(m);
  bind_calibrate(m);
  bind_denoise(m);
  bind_polarization(m);
  bind_mosaics(m);
  bind_synthesis(m);
  bind_evaluate(m);
  m.def("layouts", &SensorLayout::known_names, "Names of the mosaic layouts.");
  m.def("set_threads", &set_threads, py::arg("threads"),
        "Number of threads of the whole process; 0 = all cores. Returns the number in force. "
        "Forked processes start with one.");
  one_thread_after_fork();
  explain_argument_errors(m);
}

}  // namespace malus::python
