// What crosses the border between Python and the library: NumPy arrays, DLPack tensors, settings,
// progress. Included by the bind_*.cpp files only.
#pragma once

#include "malus/base/progress.h"
#include "malus/image/view.h"

#include <mutex>
#include <new>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

namespace malus::python {

namespace py = pybind11;

/// float32, C order, aligned: what the library reads.
using Array = py::array_t<float, py::array::c_style | py::array::forcecast |
                                     py::detail::npy_api::NPY_ARRAY_ALIGNED_>;

/// Whether it names a file.
inline bool is_path(const py::object& given) {
  return py::isinstance<py::str>(given) || py::hasattr(given, "__fspath__");
}

/// A NumPy array of anything array-like, without copying where it is an array or offers DLPack (a
/// torch tensor on the CPU). Throws InputError for tensors in a GPU's memory, TypeError for
/// bfloat16 and other types that NumPy lacks.
py::array array_from(const py::object& object);
/// The same, refused where it holds something else than real numbers: TypeError that names the
/// argument.
py::array numbers_from(const py::object& object, const char* name);
/// Those numbers as an array_t: copied only where they are something else.
template <class Converted>
Converted converted(const py::object& object, const char* name) {
  auto array = Converted::ensure(numbers_from(object, name));
  // ensure clears Python's error; for numbers it can only be a lack of memory.
  if (!array) throw std::bad_alloc();
  return array;
}
/// The same as what the library reads.
Array input_from(const py::object& object, const char* name);
/// An array to write into: nothing is converted. Throws TypeError unless it is float32, writable,
/// aligned, with contiguous rows.
py::array output_from(const py::object& object);

/// 2-D arrays as views. Throws ValueError, with name and shape, for other numbers of dimensions.
View<const float> view_of(const Array& array, const char* name);
View<float> writable_view_of(py::array& array);
/// Index i of the first dimension: shares memory.
py::array part_of(const py::array& array, py::ssize_t i);

/// Takes the plane over without copying its pixels.
py::array array_of(Image image);
/// Planes of one size as [plane, row, column].
py::object stack_of(std::vector<Image> planes);
/// Pixels of something that Python keeps alive: the owner.
py::array array_sharing(Image& image, const py::object& owner);
Image image_of(const Array& array, const char* name);
/// [plane, row, column] as its planes. Throws ValueError for other numbers of dimensions, and says
/// what the planes are.
std::vector<Image> images_of(const py::object& stack, const char* name, const char* plane);

/// Text that may hold a path, whose bytes need not be UTF-8: those that are not become lone
/// surrogates, as in Python's own paths. Messages are UTF-8 besides; a path alone has the file
/// system's encoding, so that Python opens the same file by it.
py::str text_of(std::string_view message);
py::str text_of_path(const std::string& path);

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

/// A UserWarning at the caller's line; with the interpreter's lock. Throws when they are errors.
void give_warning(const std::string& message);

/// One number, or several: a sequence of them, or an array or tensor of one dimension or none.
struct Numbers {
  std::vector<double> values;
};
/// False for what is none of these.
bool load_numbers(const py::object& given, std::vector<double>& values);

/// Black levels [DN]: one number, or one per channel.
using Black = std::optional<Numbers>;
/// As the library takes them; empty where none is given.
std::vector<double> levels_of(const Black& black);

/// Memory to draw into has to be the input's very own, or apart from it: noise written over pixels
/// that are yet to be read would be taken for light. Throws InputError.
void require_apart_or_same(const py::array& input, const py::array& out);

void bind_frames(py::module_& m);
void bind_model(py::module_& m);
void bind_calibrate(py::module_& m);
void bind_denoise(py::module_& m);
void bind_polarization(py::module_& m);
void bind_mosaics(py::module_& m);
void bind_synthesis(py::module_& m);
void bind_evaluate(py::module_& m);

}  // namespace malus::python

template <>
struct pybind11::detail::type_caster<malus::python::Numbers> {
  PYBIND11_TYPE_CASTER(malus::python::Numbers, const_name("Union[float, List[float]]"));
  bool load(handle given, bool) {
    return malus::python::load_numbers(reinterpret_borrow<object>(given), value.values);
  }
};
