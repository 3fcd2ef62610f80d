// Arrays as frames: what a file tells of its pixels, the caller tells of an array's.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/io/session.h"
#include "malus/noise/model.h"

#include <optional>
#include <string>

#include "arrays.h"

namespace malus::python {

/// A Frame of Python: with the pixels goes what their file says that they are
/// (SaveOptions::holds).
struct HeldFrame : RawFrame {
  std::string holds{};
};
/// The source of frames that come from no file.
inline constexpr const char* kArraySource = "array";

/// What Python calls a Frame; null where it is something else.
const HeldFrame* held_frame(const py::object& given);

/// Throws InputError for a Frame whose file says that it is denoised: model= is of raw ones.
void require_raw(const py::object& given, const std::string& remedy);

/// What is told of an array, or in place of what a Frame tells.
struct ToldOfFrame {
  std::optional<std::string> layout;
  Black black;
  std::optional<double> white;
};

/// Whether an array's elements are whole numbers: codes, black level included, as those of a file.
bool holds_codes(const py::array& numbers);

/// The pixels of a mosaic [row, column] with the bits of its element type, which tells, as a file's
/// does, whether they are the camera's codes. Nothing else is known of it yet. Throws InputError
/// for whole numbers that are not exact in float, as load_frame.
RawFrame pixels_of(const py::object& array, const char* name);

/// Layout, black and white of the frame as told; of a black that is not told, what the frame has of
/// its own in the layout. What the model or nobody tells is left to the caller.
void take_told(const ToldOfFrame& told, RawFrame& frame);

/// Gain and exposure of an array, as a caller gives them. Throws InputError as of a session's.
CameraSettings settings_given(const std::optional<double>& gain_db,
                              const std::optional<double>& iso,
                              const std::optional<double>& exposure_s, bool with_zero_exposure);

/// An array as a frame, whose unknown white is that of its type, as of a file. Throws InputError as
/// load_frame.
RawFrame frame_of_array(const py::object& array, const char* name, const ToldOfFrame& told);

/// The pixels of such an array, less its black level: integers hold it, and a warning says where it
/// is not told and taken as 0; of floats, which are above it, it is subtracted where it is told.
Array above_black(const py::object& array, const char* name, const ToldOfFrame& told);

/// A Frame, or an array with what an array does not know. What a model tells of its sensor, it
/// fills in later (take_levels_of_model); null where there is none. A Frame of float pixels that
/// says that it is above black is believed, with a warning. Throws InputError.
RawFrame frame_from(const py::object& raw, const ToldOfFrame& told, const NoiseModel* model);

}  // namespace malus::python
