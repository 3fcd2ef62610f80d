// Frames and sessions.
#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/image/black_levels.h"
#include "malus/image/frame_mean.h"
#include "malus/io/frame_file.h"
#include "malus/io/session.h"

#include <algorithm>
#include <iterator>
#include <optional>
#include <string>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "array_frame.h"
#include "frame_contents.h"
#include "frame_findings.h"
#include "json_objects.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace malus::python {
namespace {

FrameOptions options_of(const std::optional<std::string>& layout, const Black& black,
                        const std::optional<double>& white,
                        const std::optional<std::string>& raw_format,
                        const std::optional<std::pair<int, int>>& size) {
  FrameOptions options;
  if (raw_format) options.raw_format = raw_format_named(*raw_format);
  if (size) std::tie(options.cols, options.rows) = *size;
  if (layout) options.layout = SensorLayout::named(*layout);
  options.black_dn = levels_of(black);
  options.white_dn = white;
  return options;
}

const ParameterInfo kMeanOf{"mean_of", "1", "", 1, kMostAveraged};

HeldFrame held(FrameInfo info) { return {std::move(info.frame), std::move(info.holds)}; }

HeldFrame load(const std::filesystem::path& path, const std::optional<std::string>& layout,
               const Black& black, const std::optional<double>& white,
               const std::optional<std::string>& raw_format,
               const std::optional<std::pair<int, int>>& size, const std::optional<int>& mean_of) {
  FrameOptions options = options_of(layout, black, white, raw_format, size);
  require_setting(mean_of, kMeanOf);
  options.mean_of = mean_of;
  HeldFrame frame;
  app::StatedLevels levels;
  {
    const py::gil_scoped_release release;
    levels = app::levels_for_file(path, options, app::FloatBlack::kHolds);
    frame = held(load_frame_info(path, levels.options));
  }
  if (!levels.warning.empty()) give_warning(frame.source + ": " + levels.warning);
  return frame;
}

// A file, a Frame or an array, looked at as `malus info` does.
py::object info(const py::object& raw, const std::optional<std::string>& layout, const Black& black,
                const std::optional<double>& white, const std::optional<std::string>& raw_format,
                const std::optional<std::pair<int, int>>& size) {
  FrameInfo looked;
  if (is_path(raw)) {
    const FrameOptions options = options_of(layout, black, white, raw_format, size);
    const auto path = raw.cast<std::filesystem::path>();
    const py::gil_scoped_release release;
    looked = load_frame_info(first_frame(path, raw_format.has_value()), options);
  } else {
    if (raw_format || size)
      throw InputError(raw_format ? "raw_format" : "size", "is of a headerless file",
                       "give the path of one, or leave it out");
    const ToldOfFrame told{layout, black, white};
    if (const HeldFrame* held = held_frame(raw)) {
      looked.frame = *held;
      take_told(told, looked.frame);
      require_levels(looked.frame);
    } else {
      looked.frame = frame_of_array(raw, "raw", told);
    }
    looked.rows = looked.frame.dn.rows();
    looked.cols = looked.frame.dn.cols();
    looked.format = looked.sample = "array";
  }
  nlohmann::ordered_json found;
  {
    const py::gil_scoped_release release;
    found = app::findings_json(app::findings_of(std::move(looked)));
  }
  return python_of(found);
}

std::string exposure_text(const std::optional<double>& exposure_s) {
  return exposure_s ? fmt::format(", {:g} s", *exposure_s) : "";
}

std::string gain_text(const GainSetting& gain) {
  return gain == GainSetting() ? "" : ", " + gain.text();
}

std::string summary_of(const RawFrame& f) {
  const auto [low, high] = std::minmax_element(f.black_dn.begin(), f.black_dn.end());
  return fmt::format("<malus.Frame {}: {}x{} {}, black {:g}{}, white {:g} DN{}{}{}>", f.source,
                     f.dn.cols(), f.dn.rows(), f.layout.name(), *low,
                     *low < *high ? fmt::format(" to {:g}", *high) : "", f.white_dn,
                     gain_text(f.gain), exposure_text(f.exposure_s),
                     f.mean_of > 1 ? fmt::format(", mean of {}", f.mean_of) : "");
}

std::string summary_of(const FrameGroup& g) {
  return fmt::format("<malus.FrameGroup {}: {} frames{}{}{}>", frame_kind_name(g.kind),
                     g.paths.size(), gain_text(g.gain), exposure_text(g.exposure_s),
                     g.level ? fmt::format(", level {}", *g.level) : "");
}

std::string summary_of(const Session& s) {
  std::size_t frames = 0;
  for (const FrameGroup& g : s.groups) frames += g.paths.size();
  return fmt::format("<malus.Session {}: {} frames in {} groups>", s.source.string(), frames,
                     s.groups.size());
}

// Its number, or one of session.groups, which are copies in Python's list and known by their files.
using WhichGroup = std::variant<std::size_t, FrameGroup>;

std::size_t number_of(const Session& session, const WhichGroup& group) {
  if (const auto* number = std::get_if<std::size_t>(&group)) return *number;
  const auto found = std::find_if(
      session.groups.begin(), session.groups.end(),
      [&](const FrameGroup& own) { return own.paths == std::get<FrameGroup>(group).paths; });
  if (found == session.groups.end())
    throw InputError("group", "is none of this session's", "take it from session.groups");
  return static_cast<std::size_t>(found - session.groups.begin());
}

HeldFrame load_of_session(const Session& session, const WhichGroup& which, std::size_t index) {
  const std::size_t group = number_of(session, which);
  if (group >= session.groups.size() || index >= session.groups[group].paths.size())
    throw py::index_error(fmt::format("the session has no frame {} in group {}", index, group));
  const Session alone{session.sensor, {session.groups[group]}, session.source};
  const py::gil_scoped_release release;
  const Session settled = with_settings_of_files(alone);
  const FrameGroup& frames = settled.groups.front();
  const std::filesystem::path& path = frames.paths[index];
  return {load_session_frame(settled, frames, path),
          probe_frame(path, frame_options(settled, frames)).holds};
}

HeldFrame frame_from_array(const py::object& dn, const std::optional<std::string>& layout,
                           const Black& black, const std::optional<double>& white,
                           const std::optional<double>& gain_db, const std::optional<double>& iso,
                           const std::optional<double>& exposure_s, int mean_of) {
  require_setting(mean_of, kMeanOf);
  HeldFrame frame{frame_of_array(dn, "dn", {layout, black, white})};
  frame.mean_of = mean_of;
  const CameraSettings settings = settings_given(gain_db, iso, exposure_s, true);
  frame.gain = settings.gain;
  frame.exposure_s = settings.exposure_s;
  return frame;
}

// Those of files are named by these; all arrays are "array", and their place tells which.
HeldFrame named_by_place(const HeldFrame& frame, std::size_t place) {
  HeldFrame named = frame;
  named.source = fmt::format("frames[{}]", place);
  return named;
}

// Frames one by one: an iterator may load them as they are asked for.
HeldFrame average(const py::list& frames) {
  constexpr std::size_t kLeast = 2;
  if (frames.size() < kLeast || frames.size() > kMostAveraged)
    throw InputError("average", fmt::format("of {}", counted(std::ssize(frames), "frame")),
                     fmt::format("give {} to {} of one scene", kLeast, kMostAveraged));
  SceneMean mean(static_cast<int>(frames.size()));
  std::string first;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const auto object = py::reinterpret_borrow<py::object>(frames[i]);
    const HeldFrame* held = held_frame(object);
    if (!held)
      throw py::type_error(fmt::format("average takes a list of Frames; frames[{}] is none", i));
    require_raw(object, "give the raw frames");
    if (i == 0) first = held->source;
    std::optional<HeldFrame> named;
    if (held->source == kArraySource) named = named_by_place(*held, i);
    const HeldFrame& frame = named ? *named : *held;
    std::string cut_off;
    {
      const py::gil_scoped_release release;
      cut_off = app::cut_off_of_mean_note(frame);
      mean.add(frame);
    }
    if (!cut_off.empty()) give_warning(frame.source + ": " + cut_off);
  }
  HeldFrame result{mean.take()};
  result.source = first;
  for (const std::string& complaint : app::mean_complaints(result))
    give_warning(result.source + ": " + complaint);
  return result;
}

// The names of a cell's sites: a session may describe one that has no name.
std::vector<std::vector<std::string>> sites_of(const SensorLayout& layout) {
  std::vector<std::vector<std::string>> rows(static_cast<std::size_t>(layout.rows()));
  for (int channel = 0; channel < layout.channels(); ++channel)
    rows[static_cast<std::size_t>(channel / layout.cols())].push_back(layout.channel_name(channel));
  return rows;
}

py::tuple state_of_frame(const py::object& self) {
  const auto& f = self.cast<const HeldFrame&>();
  return py::make_tuple(self.attr("dn"), sites_of(f.layout), f.black_dn, f.white_dn, f.gain.gain_db,
                        f.gain.iso, f.exposure_s, f.bits, f.black_known, f.white_known,
                        f.layout_known, f.file_layout, text_of_path(f.source), f.holds, f.mean_of);
}

HeldFrame frame_of_state(const py::tuple& state) {
  HeldFrame f;
  std::size_t i = 0;
  f.dn = image_of(input_from(state[i++], "dn"), "dn");
  f.layout = SensorLayout::from_sites(state[i++].cast<std::vector<std::vector<std::string>>>());
  f.black_dn = state[i++].cast<std::vector<double>>();
  f.white_dn = state[i++].cast<double>();
  f.gain.gain_db = state[i++].cast<std::optional<double>>();
  f.gain.iso = state[i++].cast<std::optional<double>>();
  f.exposure_s = state[i++].cast<std::optional<double>>();
  f.bits = state[i++].cast<int>();
  f.black_known = state[i++].cast<bool>();
  f.white_known = state[i++].cast<bool>();
  f.layout_known = state[i++].cast<bool>();
  f.file_layout = state[i++].cast<std::string>();
  f.source = state[i++].cast<std::filesystem::path>().string();
  f.holds = state[i++].cast<std::string>();
  f.mean_of = state[i++].cast<int>();
  return f;
}

void bind_frame(py::module_& m) {
  py::class_<HeldFrame>(m, "Frame",
                        "One raw mosaic with its black and white level, gain and exposure, from "
                        "load_frame or of an array.")
      .def(py::init(&frame_from_array), py::arg("dn"), py::arg("layout") = py::none(),
           py::arg("black") = py::none(), py::arg("white") = py::none(), py::kw_only(),
           py::arg("gain_db") = py::none(), py::arg("iso") = py::none(),
           py::arg("exposure_s") = py::none(), py::arg("mean_of") = 1,
           "A frame of an array.\n\n"
           "dn: [row, column] in DN, black included. layout: name of the mosaic layout (mono if "
           "left out).\n"
           "black: one number, or one per channel in mosaic order: a list, an array or a tensor of "
           "one dimension [DN]; not known if left out, taken as 0.\n"
           "white: saturation, black included [DN]; if left out that of integers' type, of float "
           "pixels the largest.\n"
           "gain_db or iso, exposure_s [s]: how it was taken, where that is known.\n"
           "mean_of: of how many frames of a scene that stood still it is the mean (black "
           "included): a model's noise is less in it.\n\n"
           "Throws InputError for an unknown layout, black levels that are not one per channel or "
           "not below white, and a gain or exposure that is none; TypeError for what is no array "
           "of numbers.")
      .def_property_readonly(
          "dn",
          [](const py::object& self) { return array_sharing(self.cast<HeldFrame&>().dn, self); },
          "float32 [row, column], DN, black included; shares the frame's memory")
      .def_property_readonly(
          "layout", [](const HeldFrame& f) { return f.layout.name(); }, "name of the mosaic layout")
      .def_property_readonly(
          "channels", [](const HeldFrame& f) { return f.layout.channel_names(); },
          "names of the channels, row by row of the layout's cell")
      .def_readonly("black_dn", &RawFrame::black_dn, "black level per channel, DN")
      .def_readonly("white_dn", &RawFrame::white_dn, "saturation, black included, DN")
      .def_property_readonly(
          "gain_db", [](const HeldFrame& f) { return f.gain.gain_db; }, "gain, dB, or None")
      .def_property_readonly(
          "iso", [](const HeldFrame& f) { return f.gain.iso; }, "gain as ISO, or None")
      .def_readonly("exposure_s", &RawFrame::exposure_s, "exposure time, s, or None")
      .def_readonly("mean_of", &RawFrame::mean_of, "frames of one scene whose mean it is, mostly 1")
      .def_property_readonly(
          "source", [](const HeldFrame& f) { return text_of_path(f.source); },
          "the file it came from")
      .def(py::pickle(&state_of_frame, &frame_of_state))
      .def("__repr__", [](const HeldFrame& f) { return text_of(summary_of(f)); });
}

void bind_session(py::module_& m) {
  py::class_<FrameGroup>(m, "FrameGroup", "Frames of a session that were taken alike.")
      .def_property_readonly(
          "kind", [](const FrameGroup& g) { return std::string(frame_kind_name(g.kind)); },
          "bias, flat, burst, reference, short or long")
      .def_property_readonly(
          "gain_db", [](const FrameGroup& g) { return g.gain.gain_db; }, "gain, dB, or None")
      .def_property_readonly(
          "iso", [](const FrameGroup& g) { return g.gain.iso; }, "gain as ISO, or None")
      .def_readonly("exposure_s", &FrameGroup::exposure_s, "exposure time, s, or None")
      .def_readonly("level", &FrameGroup::level, "light level, or None")
      .def_readonly("paths", &FrameGroup::paths, "files in order")
      .def("__repr__", [](const FrameGroup& g) { return summary_of(g); });

  py::class_<Session>(m, "Session", "A session file: which frames were taken how.")
      .def(py::init([](const std::filesystem::path& path) {
             const py::gil_scoped_release release;
             return load_session(path);
           }),
           py::arg("path"))
      .def_property_readonly(
          "sensor", [](const Session& s) { return s.sensor.name; }, "name of the sensor")
      .def_property_readonly(
          "layout",
          [](const Session& s) {
            return s.sensor.layout ? std::optional(s.sensor.layout->name()) : std::nullopt;
          },
          "name of the mosaic layout, or None where the files tell it")
      .def_readonly("groups", &Session::groups, "list of FrameGroup")
      .def("load", &load_of_session, py::arg("group"), py::arg("index"),
           "Frame `index` of group `group` (its number, or one of `groups`), read with the "
           "session's black, white, layout, gain and exposure. InputError where the file tells "
           "another gain or exposure than the session or the group's first file.")
      .def("__repr__", [](const Session& s) { return text_of(summary_of(s)); });
}

}  // namespace

void bind_frames(py::module_& m) {
  bind_frame(m);
  bind_session(m);
  m.def(
      "frames",
      [](const std::filesystem::path& path) {
        const py::gil_scoped_release release;
        return frame_names(path);
      },
      py::arg("path"),
      "The frames of a file, in order: of a stack (TIFF of several pages, .npy of (frame, row, "
      "column), FITS cube) their names, stack.tif[0] and on, which load_frame and info take; else "
      "the path itself. Only headers are read.");
  m.def(
      "average", &average, py::arg("frames"),
      "The mean of a list of Frames of a scene that stood still, taken alike, as a Frame that "
      "knows its mean_of: what denoise and stokes make of a model's noise in it. Black level "
      "included; a pixel that is saturated in more than a tenth of them is at white. `malus "
      "average` does the same of files, and says whether the scene moved.\n\n"
      "Warns of unknown black and white levels.\n\n"
      "Throws InputError where size, layout, levels, gain or exposure differ, for a mean, and for "
      "a file that is denoised.");
  m.def(
      "info", &info, py::arg("raw"), py::arg("layout") = py::none(), py::arg("black") = py::none(),
      py::arg("white") = py::none(), py::kw_only(), py::arg("raw_format") = py::none(),
      py::arg("size") = py::none(),
      "What `malus info --json` tells of a frame: the path of one (other arguments as load_frame "
      "takes them; of a stack the first frame, or the one that is named), a Frame, or an array.\n\n"
      "dict of layout, black, white and whether each is known or assumed, bits, frames_in_file, "
      "exposure_s, mean_of, gain_db, iso; per channel mean, minimum, maximum [DN], "
      "saturated_share, below_black_share, "
      "noise_sd [DN, None where the scene decides nothing: of the flatter half of the picture] and "
      "noise_sd_at [DN, the mean light of that half]; value_grid (how integers fill their "
      "type), layout_check (as check_layout, and the declared pairing), nonfinite_pixels, "
      "warnings: what speaks against the levels or the layout.");
  m.def("load_frame", &load, py::arg("path"), py::arg("layout") = py::none(),
        py::arg("black") = py::none(), py::arg("white") = py::none(), py::kw_only(),
        py::arg("raw_format") = py::none(), py::arg("size") = py::none(),
        py::arg("mean_of") = py::none(),
        "Reads TIFF, PNG, BMP, PGM, EXR, FITS, .npy or camera raw into a Frame: DN exactly as "
        "stored. One frame of a stack is named stack.tif[3], counted from 0. layout, black (one "
        "number, or one per channel), white [DN] win over what the file "
        "says, but that floats are above black already, and where a denoised file is saturated, is "
        "believed, with a warning. A headerless file needs raw_format (mono8, mono10p, mono12p, "
        "mono12packed, mono16) "
        "and size=(width, height). mean_of: of a file that a mean of frames was saved to "
        "elsewhere, as "
        "of Frame.");
}

}  // namespace malus::python
