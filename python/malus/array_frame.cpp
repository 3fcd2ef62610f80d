#include "array_frame.h"

#include "malus/base/error.h"
#include "malus/image/black_levels.h"
#include "malus/io/picture_file.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "frame_contents.h"

namespace malus::python {
namespace {

// "uint16", as of a file.
std::string type_name(const py::array& numbers) {
  return py::str(numbers.dtype().attr("name")).cast<std::string>();
}

// Whole numbers that float rounds are refused, as in a file.
void require_exact_numbers(const py::array& numbers) {
  constexpr py::ssize_t kAlwaysExact = 2;
  const char kind = numbers.dtype().kind();
  if ((kind != 'i' && kind != 'u') || numbers.itemsize() <= kAlwaysExact || numbers.size() == 0)
    return;
  for (const char* extreme : {"min", "max"})
    require_exact("array", numbers.attr(extreme)().cast<double>());
}

// As the program takes --black and --white for a file (frame_contents.h).
ToldOfFrame believed(const ToldOfFrame& told, const HeldFrame& frame) {
  FrameOptions stated;
  stated.black_dn = levels_of(told.black);
  stated.white_dn = told.white;
  const app::StatedLevels levels =
      app::levels_for_frame(frame, frame.holds, stated, app::FloatBlack::kHolds);
  if (!levels.warning.empty()) give_warning(frame.source + ": " + levels.warning);
  ToldOfFrame result = told;
  if (levels.options.black_dn.empty()) result.black.reset();
  result.white = levels.options.white_dn;
  return result;
}

}  // namespace

const HeldFrame* held_frame(const py::object& given) {
  return py::isinstance<HeldFrame>(given) ? &given.cast<const HeldFrame&>() : nullptr;
}

void require_raw(const py::object& given, const std::string& remedy) {
  if (const HeldFrame* frame = held_frame(given))
    app::require_raw(frame->source, frame->holds, remedy);
}

bool holds_codes(const py::array& numbers) {
  const py::dtype type = numbers.dtype();
  return bits_of_numbers(type.kind(), static_cast<int>(type.itemsize())) > 0;
}

RawFrame pixels_of(const py::object& array, const char* name) {
  RawFrame frame;
  const py::array numbers = numbers_from(array, name);
  require_exact_numbers(numbers);
  frame.dn = image_of(input_from(numbers, name), name);
  const py::dtype type = numbers.dtype();
  frame.bits = bits_of_numbers(type.kind(), static_cast<int>(type.itemsize()));
  frame.source = kArraySource;
  frame.black_dn = {0.0};
  return frame;
}

void take_told(const ToldOfFrame& told, RawFrame& frame) {
  const SensorLayout wanted = told.layout ? SensorLayout::named(*told.layout) : frame.layout;
  frame.black_dn = told.black ? black_per_channel(levels_of(told.black), wanted, "black")
                              : blacks_for_layout(frame, wanted);
  frame.layout = wanted;
  frame.layout_known = frame.layout_known || told.layout.has_value();
  frame.black_known = frame.black_known || told.black.has_value();
  frame.white_known = frame.white_known || told.white.has_value();
  if (told.white) frame.white_dn = *told.white;
}

CameraSettings settings_given(const std::optional<double>& gain_db,
                              const std::optional<double>& iso,
                              const std::optional<double>& exposure_s, bool with_zero_exposure) {
  CameraSettings settings{{gain_db, iso}, exposure_s};
  if (const auto fault = fault_of(settings, with_zero_exposure))
    throw InputError(fault->key, fault->problem, fault->remedy);
  return settings;
}

RawFrame frame_of_array(const py::object& array, const char* name, const ToldOfFrame& told) {
  const py::array numbers = numbers_from(array, name);
  RawFrame frame = pixels_of(numbers, name);
  frame.white_dn = assumed_white_dn(frame.bits, frame.dn.view());
  take_told(told, frame);
  require_levels(frame);
  require_black_of_codes(frame, type_name(numbers));
  return frame;
}

Array above_black(const py::object& array, const char* name, const ToldOfFrame& told) {
  const py::array numbers = numbers_from(array, name);
  if (!told.black && !holds_codes(numbers)) return input_from(numbers, name);
  RawFrame frame = frame_of_array(numbers, name, told);
  if (const auto complaint = app::unknown_black_complaint(frame);
      !complaint.empty() && frame.holds_codes())
    give_warning(frame.source + ": " + complaint);
  subtract_black(frame);
  return array_of(std::move(frame.dn)).cast<Array>();
}

RawFrame frame_from(const py::object& raw, const ToldOfFrame& told, const NoiseModel* model) {
  RawFrame frame;
  ToldOfFrame taken = told;
  std::optional<py::array> numbers;
  if (const HeldFrame* held = held_frame(raw)) {
    frame = *held;
    taken = believed(told, *held);
  } else {
    numbers = numbers_from(raw, "raw");
    if (!(told.layout || model) || !(told.white || (model && model->white_dn > 0)))
      throw InputError(
          "array", "does not know its layout and white level",
          "give layout= and white= (and black=), a model= that tells them, or a Frame");
    frame = pixels_of(*numbers, "raw");
    if (model && !told.layout) {
      frame.layout = model->layout;
      frame.black_dn.assign(model->black_dn.size(), 0.0);
    }
  }
  take_told(taken, frame);
  if ((told.black || told.white) && !model) require_levels(frame);
  if (told.black && numbers) require_black_of_codes(frame, type_name(*numbers));
  return frame;
}

}  // namespace malus::python
