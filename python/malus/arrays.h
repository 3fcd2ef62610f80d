// What crosses the border between Python and the library: NumPy arrays, DLPack tensors, settings,
// progress. Included by the bind_*.cpp files only.
#pragma once

#include "malus/base/progress.h"
#include "malus/image/view.h"

#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

namespace malus::python {

namespace py = pybind11;

/// float32, C order: what the library reads.
using Array = py::array_t<float, py::array::c_style | py::array::forcecast>;

/// A NumPy array of anything array-like, without copying where it is an array or offers DLPack (a
/// torch tensor on the CPU). Throws InputError for tensors in a GPU's memory, TypeError for
/// bfloat16 and other types that NumPy lacks.
py::array array_from(const py::object& object);
/// The same as float32 in C order: converted, which copies, only where it is something else.
Array input_from(const py::object& object);
/// An array to write into: nothing is converted. Throws TypeError unless it is float32, writable,
/// with contiguous rows.
py::array output_from(const py::object& object);

/// 2-D arrays as views. Throws ValueError for other numbers of dimensions.
View<const float> view_of(const Array& array);
View<float> writable_view_of(py::array& array);
/// Index i of the first dimension: shares memory.
py::array part_of(const py::array& array, py::ssize_t i);

/// Takes the plane over without copying its pixels.
py::array array_of(Image image);
/// Pixels of something that Python keeps alive: the owner.
py::array array_sharing(Image& image, const py::object& owner);
Image image_of(const Array& array);

/// Warnings of a computation are given after it, with the interpreter's lock; Ctrl-C reaches the
/// work between its steps.
class PythonProgress final : public Progress {
 public:
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t) override {}
  void warn(std::string_view message) override;
  bool stop_requested() const override;
  /// Throws when warnings are errors.
  void give_warnings();

 private:
  std::mutex mutex_;
  std::vector<std::string> warnings_;
};

void bind_frames(py::module_& m);
void bind_model(py::module_& m);
void bind_denoise(py::module_& m);
void bind_evaluate(py::module_& m);

}  // namespace malus::python
