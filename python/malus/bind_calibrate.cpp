// Calibration, of sessions and of arrays.
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/warnings_of_gains.h"
#include "malus/image/frame_mean.h"
#include "malus/io/session.h"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "array_frame.h"
#include "model_with_sampler.h"
#include "settings.h"
#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace malus::python {
namespace {

/// Frames of one setting that Python holds: a sequence of mosaics or Frames, asked for one at a
/// time, so that it may be a file that is mapped into memory.
struct ArraySet {
  FrameSet set;  ///< without its function
  py::object frames;
  CameraSettings first{};  ///< what the first tells of itself, where it is a Frame
};

/// What is known of a sensor whose frames are arrays.
struct ArraySensor {
  std::string name;
  ToldOfFrame told;
  std::optional<int> row_group;
};

FrameKind kind_named(const std::string& name) {
  const std::vector<std::string> names = frame_kind_names();
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw InputError("kind", fmt::format("\"{}\" is no kind of frames", name),
                     did_you_mean(name, names) + "there are " + joined(names));
  return static_cast<FrameKind>(found - names.begin());
}

ArraySet array_set(const std::string& kind, const py::object& frames,
                   const std::optional<double>& gain_db, const std::optional<double>& iso,
                   const std::optional<double>& exposure_s, const std::optional<int>& level) {
  if (!py::hasattr(frames, "__getitem__") || !py::hasattr(frames, "__len__"))
    throw py::type_error("frames has to be a sequence of mosaics [row, column] or of Frames");
  const std::size_t count = py::len(frames);
  if (count > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    throw InputError("frames", "are too many", "give fewer");
  require_setting(level, {"level", "1", "", 0, kLargestLevel});
  ArraySet out;
  out.set.kind = kind_named(kind);
  const CameraSettings settings =
      settings_given(gain_db, iso, exposure_s, out.set.kind == FrameKind::kBias);
  out.set.gain = settings.gain;
  out.set.exposure_s = settings.exposure_s;
  out.set.level = level;
  out.set.count = static_cast<int>(count);
  out.set.name = frame_set_name(out.set);
  out.frames = frames;
  if (count == 0)
    throw InputError(out.set.name, "holds no frames", "give at least one, or leave the set out");
  return out;
}

// As of a session's set: gain and exposure that it does not tell are its first Frame's.
ArraySet with_settings_of_first(ArraySet held) {
  FrameSet& set = held.set;
  const py::object given = held.frames.attr("__getitem__")(0);
  const HeldFrame* first = held_frame(given);
  if (!first) return held;
  held.first = {first->gain, first->exposure_s};
  if (!set.gain.decibel()) set.gain = first->gain;
  if (!set.exposure_s) set.exposure_s = first->exposure_s;
  if (const auto fault = fault_of({set.gain, set.exposure_s}, set.kind == FrameKind::kBias))
    throw InputError(set.name + ", frame 0: " + fault->key, fault->problem, fault->remedy);
  set.name = frame_set_name(set);
  return held;
}

void require_settings_of_set(const RawFrame& frame, const ArraySet& held, int i) {
  const FrameSet& set = held.set;
  const auto conflict =
      conflict_with_set({frame.gain, frame.exposure_s}, {set.gain, set.exposure_s}, held.first);
  if (!conflict) return;
  const std::string of_set =
      conflict->of_set.empty() ? fmt::format("unknown {}", conflict->what()) : conflict->of_set;
  throw InputError(fmt::format("{}, frame {}", set.name, i),
                   fmt::format("was taken at {}, {} at {}", conflict->own,
                               conflict->with_first ? "the first of its set" : "its set", of_set),
                   "give frames of each setting a FrameSet of their own");
}

RawFrame frame_of_set(const ArraySet& held, const ArraySensor& sensor, int i) {
  const py::object given = held.frames.attr("__getitem__")(i);
  RawFrame frame;
  if (const HeldFrame* own = held_frame(given)) {
    frame = *own;
    require_settings_of_set(frame, held, i);
    if (held.set.kind != FrameKind::kReference) require_single(frame);
    take_told(sensor.told, frame);
  } else {
    frame = frame_of_array(given, "frames", sensor.told);
    frame.source = fmt::format("{}, frame {}", held.set.name, i);
  }
  frame.gain = held.set.gain;
  frame.exposure_s = held.set.exposure_s;
  return frame;
}

// The last copy of the function may go without the interpreter's lock, Python's objects may not.
template <class Held>
std::shared_ptr<const Held> with_the_lock(Held held) {
  return {new Held(std::move(held)), [](const Held* object) {
            const py::gil_scoped_acquire gil;
            delete object;
          }};
}

CalibrationInput input_of(const std::vector<ArraySet>& sets, const ArraySensor& sensor) {
  require_setting(sensor.row_group, {"row_group", "1", "", 1, kLargestRowGroup});
  CalibrationInput input;
  input.sensor = sensor.name;
  input.origin = "arrays";
  input.row_group = sensor.row_group;
  for (const ArraySet& given : sets) {
    const ArraySet each = with_settings_of_first(given);
    for (const FrameSet& before : input.sets)
      if (before.name == each.set.name)
        throw InputError(each.set.name, "there are two such sets", "give their frames as one");
    input.sets.push_back(each.set);
    input.sets.back().load = [held = with_the_lock(each), sensor](int i) {
      const py::gil_scoped_acquire gil;
      return frame_of_set(*held, sensor, i);
    };
  }
  return input;
}

CalibrationInput input_of(const Session& session, const ArraySensor& sensor) {
  const ToldOfFrame& told = sensor.told;
  if (!sensor.name.empty() || told.layout || told.black || told.white || sensor.row_group)
    throw InputError("session", "tells sensor, layout, black, white and row_group itself",
                     "write them in its [sensor] section, or calibrate arrays");
  return calibration_input(session);
}

// In the words of arrays: the library's are those of session files.
void require_bias_frames(const std::vector<ArraySet>& sets, const std::vector<ModelKind>& kinds) {
  const bool needed = std::ranges::any_of(kinds, needs_bias_frames);
  const bool given = std::any_of(sets.begin(), sets.end(), [](const ArraySet& each) {
    return each.set.kind == FrameKind::kBias;
  });
  if (needed && !given)
    throw InputError("session", "holds no bias frames",
                     "add a FrameSet of kind bias: frames taken with the lens cap on");
}

using Frames = std::variant<Session, std::vector<ArraySet>, std::filesystem::path>;

ModelWithSampler calibrated(const Frames& frames,
                            const std::variant<std::string, std::vector<std::string>>& given_kinds,
                            const ArraySensor& sensor, const py::kwargs& kwargs) {
  const auto settings = settings_from<CalibrationSettings>(kwargs);
  const auto* one = std::get_if<std::string>(&given_kinds);
  const std::vector<ModelKind> kinds =
      model_kinds(one ? std::vector{*one} : std::get<std::vector<std::string>>(given_kinds));
  PythonProgress progress;
  std::optional<CalibrationInput> input;
  if (const auto* sets = std::get_if<std::vector<ArraySet>>(&frames)) {
    if (sets->empty()) throw InputError("session", "holds no sets of frames", "give bias frames");
    require_bias_frames(*sets, kinds);
    input = input_of(*sets, sensor);
  }
  std::optional<NoiseModel> model;
  {
    const py::gil_scoped_release release;
    if (const auto* path = std::get_if<std::filesystem::path>(&frames))
      input = input_of(load_session(*path), sensor);
    else if (const auto* session = std::get_if<Session>(&frames))
      input = input_of(*session, sensor);
    model = calibrate(*input, settings, kinds, progress);
  }
  progress.give_warnings();
  for (const std::string& line : warnings_of_gains(*model)) give_warning(line);
  return ModelWithSampler(Model(std::move(*model)));
}

// By hand: what pybind11 would say of a variant names C++ types.
Frames frames_from(const py::object& session) {
  if (py::isinstance<Session>(session)) return session.cast<Session>();
  const bool list = py::isinstance<py::list>(session) || py::isinstance<py::tuple>(session);
  try {
    if (list) return session.cast<std::vector<ArraySet>>();
    return session.cast<std::filesystem::path>();
  } catch (const py::cast_error&) {
    throw py::type_error(
        "session must be a Session, the path of a session file or a list of FrameSet");
  }
}

void bind_set(py::module_& m) {
  py::class_<ArraySet>(
      m, "FrameSet",
      "Arrays of one setting, for calibrate. Throws InputError.\n\n"
      "kind: bias (dark frames), flat (one light level, two frames or more) or "
      "burst.\n"
      "frames: [frame, row, column] in DN, black included, or any sequence of "
      "mosaics or of Frames; asked for one at a time.\n"
      "gain_db or iso, exposure_s: of all frames; left out: of the first, where it "
      "is a Frame. InputError from calibrate where a Frame tells another.")
      .def(py::init(&array_set), py::arg("kind"), py::arg("frames"), py::kw_only(),
           py::arg("gain_db") = py::none(), py::arg("iso") = py::none(),
           py::arg("exposure_s") = py::none(), py::arg("level") = py::none())
      .def("__len__", [](const ArraySet& s) { return s.set.count; })
      .def("__repr__", [](const ArraySet& s) {
        return fmt::format("<malus.FrameSet {}: {} frames>", s.set.name, s.set.count);
      });
}

}  // namespace

void bind_calibrate(py::module_& m) {
  bind_set(m);
  m.def(
      "calibrate",
      [](const py::object& session,
         const std::variant<std::string, std::vector<std::string>>& kinds,
         const std::string& sensor, const std::optional<std::string>& layout, const Black& black,
         const std::optional<double>& white, const std::optional<int>& row_group,
         const py::kwargs& kwargs) {
        return calibrated(frames_from(session), kinds, {sensor, {layout, black, white}, row_group},
                          kwargs);
      },
      py::arg("session"), py::arg("kinds") = model_kind_names({ModelKind::kPhysics}), py::kw_only(),
      py::arg("sensor") = "", py::arg("layout") = py::none(), py::arg("black") = py::none(),
      py::arg("white") = py::none(), py::arg("row_group") = py::none(),
      ("A Session, the path of a session file, or a list of FrameSet -> Model. kinds: of " +
       joined(model_kind_names()) +
       ".\n\n"
       "Of arrays alone: sensor (its name), layout, black and white [DN], row_group (mosaic rows "
       "that are read out together; None: found in the frames)." +
       settings_help<CalibrationSettings>())
          .c_str());
}

}  // namespace malus::python
