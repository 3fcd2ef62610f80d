#include "arrays.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string_view>

#include "array_frame.h"
#include <fmt/format.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

// DLPack, version 0: the memory layout that __dlpack__() hands over
// (https://dmlc.github.io/dlpack/latest/c_api.html).
struct DlTensor {
  void* data;
  std::int32_t device_type, device_id;
  std::int32_t dimensions;
  std::uint8_t type_code, type_bits;
  std::uint16_t type_lanes;
  std::int64_t* shape;
  std::int64_t* strides;  // in elements; null: C order
  std::uint64_t byte_offset;
};
struct DlManagedTensor {
  DlTensor tensor;
  void* context;
  void (*deleter)(DlManagedTensor*);
};
constexpr int kDlCpu = 1, kDlPinned = 3;  // CPU memory, plain or pinned for a GPU
constexpr std::string_view kTypeLetters = "iuf";
constexpr int kDlBool = 6;

// NumPy's kinds that are real numbers: text, dates and objects convert too, into what nobody meant.
constexpr std::string_view kNumberKinds = "biuf";
constexpr std::ptrdiff_t kFloatBytes = sizeof(float);

// Empty where NumPy has no such type.
std::string type_of(const DlTensor& t) {
  if (t.type_lanes != 1 || t.type_bits % 8 != 0) return {};
  if (t.type_code == kDlBool && t.type_bits == 8) return "?";
  if (t.type_code >= kTypeLetters.size()) return {};
  return fmt::format("{}{}", kTypeLetters[t.type_code], t.type_bits / 8);
}

// Its capsule; none where it exports no tensor of this kind, but can be an array: older versions of
// torch, of booleans.
py::object exported(const py::object& object) {
  try {
    return object.attr("__dlpack__")();
  } catch (const py::error_already_set& error) {
    if (!error.matches(PyExc_Exception) || !py::hasattr(object, "__array__")) throw;
    return py::none();
  }
}

py::array as_array(const py::object& object) {
  return py::module_::import("numpy").attr("asarray")(object).cast<py::array>();
}

py::array from_dlpack(const py::object& object) {
  const auto device = object.attr("__dlpack_device__")().cast<std::pair<int, int>>();
  if (device.first != kDlCpu && device.first != kDlPinned)
    throw InputError("tensor", "lies in the memory of a device", "copy it first: tensor.cpu()");
  const py::object capsule = exported(object);
  if (capsule.is_none()) return as_array(object);
  auto* managed = static_cast<DlManagedTensor*>(PyCapsule_GetPointer(capsule.ptr(), "dltensor"));
  if (!managed) throw py::error_already_set();
  // From here the tensor is ours to give back.
  PyCapsule_SetName(capsule.ptr(), "used_dltensor");
  const py::capsule owner(managed, [](void* pointer) {
    auto* tensor = static_cast<DlManagedTensor*>(pointer);
    if (tensor->deleter) tensor->deleter(tensor);
  });
  const DlTensor& t = managed->tensor;
  const std::string type = type_of(t);
  if (type.empty())
    throw py::type_error("tensor: its element type has no NumPy equal; convert it to float32");
  const py::ssize_t bytes = t.type_bits / 8;
  const std::vector<py::ssize_t> shape(t.shape, t.shape + t.dimensions);
  std::vector<py::ssize_t> strides;
  for (int i = 0; t.strides && i < t.dimensions; ++i) strides.push_back(t.strides[i] * bytes);
  auto* data = static_cast<std::byte*>(t.data) + t.byte_offset;
  return py::array(py::dtype(type), shape, strides, data, owner);
}

bool is_masked(const py::object& object) {
  return py::hasattr(object, "mask") && py::hasattr(object, "filled");
}

bool holds_numbers(const py::array& array) {
  return kNumberKinds.find(array.dtype().kind()) != std::string_view::npos;
}

// Whether every number lies a whole number of floats from the first, which is aligned.
bool whole_floats(const py::array& array) {
  if (reinterpret_cast<std::uintptr_t>(array.data()) % alignof(float) != 0) return false;
  for (py::ssize_t i = 0; i < array.ndim(); ++i)
    if (array.shape(i) > 1 && array.strides(i) % kFloatBytes != 0) return false;
  return true;
}

[[noreturn]] void throw_wrong_shape(const py::array& array, const char* name, const char* wanted) {
  const auto shape = py::repr(array.attr("shape")).cast<std::string>();
  throw py::value_error(fmt::format("{} has to be {}, not of shape {}", name, wanted, shape));
}

int size_of(const py::array& array, py::ssize_t dimension) {
  const py::ssize_t size = array.shape(dimension);
  if (size > std::numeric_limits<int>::max())
    throw InputError("array", fmt::format("has {} rows or columns", size),
                     fmt::format("give at most {}", std::numeric_limits<int>::max()));
  return static_cast<int>(size);
}

}  // namespace

py::array array_from(const py::object& object) {
  if (py::isinstance<py::array>(object)) return object.cast<py::array>();
  if (py::hasattr(object, "__dlpack__")) return from_dlpack(object);
  return as_array(object);
}

py::array numbers_from(const py::object& object, const char* name) {
  if (is_masked(object))
    throw py::type_error(fmt::format(
        "{} is a masked array, whose mask would be lost; give {}.astype(float).filled(nan), or "
        "its data",
        name, name));
  if (is_path(object))
    throw py::type_error(fmt::format("{} is {}, a path or a name; load it with malus.load_frame",
                                     name, py::repr(object).cast<std::string>()));
  py::array array = array_from(object);
  if (held_frame(object))
    throw py::type_error(fmt::format(
        "{} must be an array of numbers, not a Frame; give its .dn, less black where DN above "
        "black are asked for",
        name));
  if (!holds_numbers(array))
    throw py::type_error(fmt::format("{} must be an array of numbers, not of {}", name,
                                     py::repr(array.dtype()).cast<std::string>()));
  return array;
}

Array input_from(const py::object& object, const char* name) {
  return converted<Array>(object, name);
}

py::array output_from(const py::object& object) {
  const py::array array = array_from(object);
  const auto last = array.ndim() - 1;
  // By equivalence: every unpickled array has a type object of its own.
  if (!py::isinstance<py::array_t<float>>(array) || !array.writeable() || last < 1 ||
      (array.shape(last) > 1 && array.strides(last) != sizeof(float)))
    throw py::type_error("out must be a writable float32 array with contiguous rows");
  if (!whole_floats(array))
    throw py::type_error(
        "out must hold its numbers at multiples of 4 bytes, unlike a field of a packed structured "
        "array; give an array of its own");
  return array;
}

bool load_numbers(const py::object& given, std::vector<double>& values) {
  if (!is_masked(given) && (py::isinstance<py::array>(given) || py::hasattr(given, "__dlpack__"))) {
    const py::array array = array_from(given);
    if (array.ndim() > 1 || !holds_numbers(array)) return false;
    const py::array_t<double, py::array::c_style | py::array::forcecast> numbers(array);
    values.assign(numbers.data(), numbers.data() + numbers.size());
    return true;
  }
  if (py::detail::make_caster<double> one; one.load(given, true)) {
    values = {py::detail::cast_op<double>(one)};
    return true;
  }
  py::detail::make_caster<std::vector<double>> list;
  if (!list.load(given, true)) return false;
  values = py::detail::cast_op<std::vector<double>&&>(std::move(list));
  return true;
}

std::vector<double> levels_of(const Black& black) {
  if (!black) return {};
  if (black->values.empty())
    throw InputError("black", "is an empty list",
                     "give one number, or one per channel in mosaic order");
  return black->values;
}

void require_apart_or_same(const py::array& input, const py::array& out) {
  bool same = input.data() == out.data();
  for (py::ssize_t i = 0; i < input.ndim(); ++i)
    same = same && (input.shape(i) < 2 || input.strides(i) == out.strides(i));
  if (same || !py::module_::import("numpy").attr("shares_memory")(input, out).cast<bool>()) return;
  throw InputError("out", "overlaps clean in part",
                   "give clean itself, or an array that shares no memory with it");
}

View<const float> view_of(const Array& array, const char* name) {
  if (array.ndim() != 2) throw_wrong_shape(array, name, "[row, column]");
  const int rows = size_of(array, 0), cols = size_of(array, 1);
  return {{array.data(), static_cast<std::size_t>(array.size())}, rows, cols, cols};
}

View<float> writable_view_of(py::array& array) {
  MALUS_REQUIRE(array.ndim() == 2 && whole_floats(array));
  const int rows = size_of(array, 0), cols = size_of(array, 1);
  const auto stride = rows > 1 ? static_cast<std::ptrdiff_t>(array.strides(0)) / kFloatBytes : cols;
  if (stride < cols) throw py::value_error("out must have rows in rising order of memory");
  const auto size = rows ? static_cast<std::size_t>((rows - 1) * stride + cols) : 0;
  return {{static_cast<float*>(array.mutable_data()), size}, rows, cols, stride};
}

py::array part_of(const py::array& array, py::ssize_t i) {
  return array[py::int_(i)].cast<py::array>();
}

py::array array_of(Image image) {
  auto held = std::make_unique<Image>(std::move(image));
  const py::capsule owner(held.get(), [](void* pointer) { delete static_cast<Image*>(pointer); });
  const Image& plane = *held.release();
  return py::array_t<float>({plane.rows(), plane.cols()}, plane.values().data(), owner);
}

py::object stack_of(std::vector<Image> planes) {
  py::list list;
  for (Image& plane : planes) list.append(array_of(std::move(plane)));
  return py::module_::import("numpy").attr("stack")(list);
}

py::array array_sharing(Image& image, const py::object& owner) {
  return py::array_t<float>({image.rows(), image.cols()}, image.values().data(), owner);
}

Image image_of(const Array& array, const char* name) {
  const auto view = view_of(array, name);
  Image image(view.rows(), view.cols());
  std::copy_n(view.data(), image.size(), image.values().data());
  return image;
}

std::vector<Image> images_of(const py::object& stack, const char* name, const char* plane) {
  const Array array = input_from(stack, name);
  if (array.ndim() != 3)
    throw_wrong_shape(array, name, fmt::format("[{}, row, column]", plane).c_str());
  std::vector<Image> images;
  for (py::ssize_t i = 0; i < array.shape(0); ++i)
    images.push_back(image_of(part_of(array, i).cast<Array>(), name));
  return images;
}

py::str text_of(std::string_view message) {
  PyObject* text = PyUnicode_DecodeUTF8(message.data(), static_cast<py::ssize_t>(message.size()),
                                        "surrogateescape");
  if (!text) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(text);
}

py::str text_of_path(const std::string& path) {
  PyObject* text =
      PyUnicode_DecodeFSDefaultAndSize(path.data(), static_cast<py::ssize_t>(path.size()));
  if (!text) throw py::error_already_set();
  return py::reinterpret_steal<py::str>(text);
}

void PythonProgress::warn(std::string_view message) {
  const std::lock_guard lock(mutex_);
  warnings_.emplace_back(message);
}

bool PythonProgress::stop_requested() const {
  const py::gil_scoped_acquire gil;
  return PyErr_CheckSignals() != 0;
}

void PythonProgress::give_warnings() {
  for (const auto& message : warnings_) give_warning(message);
}

void give_warning(const std::string& message) {
  if (PyErr_WarnFormat(PyExc_UserWarning, 1, "%U", text_of(message).ptr()) != 0)
    throw py::error_already_set();
}

}  // namespace malus::python
