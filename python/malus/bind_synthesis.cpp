// Clean mosaics from pictures, and frames of one gain as if taken at another.
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/frame_mean.h"
#include "malus/io/picture_file.h"
#include "malus/noise/frame_levels.h"
#include "malus/synthesize/light_scale.h"
#include "malus/synthesize/model_renoiser.h"
#include "malus/synthesize/scene.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "array_frame.h"
#include "frame_contents.h"
#include "model_with_sampler.h"
#include "settings.h"
#include <fmt/format.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace malus::python {
namespace {

/// The keyword arguments of malus.simulate that the program has as flags.
struct SimulateKeywords {
  CameraResponse response;
  SceneSettings scene;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    CameraResponse::describe(self.response, field);
    SceneSettings::describe(self.scene, field);
  }
};

// [row, column], [colour, row, column] or, as of files, [row, column, colour].
Picture picture_of_array(const py::object& object) {
  py::array array = numbers_from(object, "picture");
  constexpr py::ssize_t kMostColours = 4;
  if (array.ndim() == 3 && array.shape(2) <= kMostColours && array.shape(0) > kMostColours)
    array = py::module_::import("numpy").attr("moveaxis")(array, 2, 0).cast<py::array>();
  Picture picture;
  const py::dtype type = array.dtype();
  picture.bits = bits_of_numbers(type.kind(), static_cast<int>(type.itemsize()));
  require_known_white("picture", picture.bits);
  std::vector<Image> planes;
  if (array.ndim() == 2)
    planes.push_back(image_of(input_from(array, "picture"), "picture"));
  else
    planes = images_of(array, "picture", "colour");
  if (planes.empty())
    throw InputError("picture", "holds no plane", "give one, or red, green, blue");
  picture.names =
      planes.size() < 3 ? std::vector<std::string>{"Y"} : std::vector<std::string>{"R", "G", "B"};
  picture.names.resize(planes.size());
  picture.planes = Planes(static_cast<int>(planes.size()), 0, 0);
  std::move(planes.begin(), planes.end(), picture.planes.begin());
  picture.white = white_of_picture(picture.bits, picture.planes);
  return picture;
}

Picture picture_from(const py::object& given) {
  if (!is_path(given)) return picture_of_array(given);
  const auto path = given.cast<std::filesystem::path>();
  const py::gil_scoped_release release;
  return load_clean_picture(path);
}

void require_tone(const std::string& tone) {
  const std::vector<std::string>& tones = picture_tones();
  if (std::ranges::find(tones, tone) == tones.end())
    throw InputError("tone", tone + " is not known", "choose one of " + joined(tones));
}

template <class ImageOf>
py::object stack_of_colours(const PolarScene& scene, const ImageOf& image_of) {
  std::vector<Image> planes;
  for (const StokesPlanes& colour : scene.stokes) planes.push_back(image_of(colour));
  return stack_of(std::move(planes));
}

void add_truth(py::dict& out, PolarScene& scene) {
  out["s0"] = stack_of_colours(scene, [](const StokesPlanes& s) { return s.s0; });
  out["s1"] = stack_of_colours(scene, [](const StokesPlanes& s) { return s.s1; });
  out["s2"] = stack_of_colours(scene, [](const StokesPlanes& s) { return s.s2; });
  out["dolp"] = stack_of_colours(scene, [](const StokesPlanes& s) { return dolp_of(s); });
  out["aolp_deg"] = stack_of_colours(scene, [](const StokesPlanes& s) { return aolp_deg_of(s); });
  if (scene.normal_x.empty()) return;
  std::vector<Image> normals;
  for (Image* part : {&scene.normal_x, &scene.normal_y, &scene.normal_z})
    normals.push_back(std::move(*part));
  out["normals"] = stack_of(std::move(normals));
}

py::dict simulate(const py::object& given, const std::string& layout_name, bool polarized,
                  bool truth, const std::string& tone, std::uint64_t seed, std::uint32_t number,
                  const py::kwargs& kwargs) {
  const auto settings = settings_from<SimulateKeywords>(kwargs);
  const auto layout = SensorLayout::named(layout_name);
  const Picture picture = picture_from(given);
  require_tone(tone);
  const std::string source =
      is_path(given) ? given.cast<std::filesystem::path>().string() : "picture";
  if (const auto complaint = app::nonfinite_light_complaint(
          nonfinite_light(picture.planes, picture.names), picture.planes[0].size(), source);
      !complaint.empty())
    give_warning(complaint);
  PolarScene scene;
  Image mosaic;
  std::string of_scale;
  {
    const py::gil_scoped_release release;
    const Planes light =
        linear_light(picture.planes, picture.names, picture.white, is_srgb(tone, picture.bits));
    of_scale = picture_scale_complaint(light, picture.bits, settings.response.exposure);
    const Planes camera = camera_rgb_of(whole_cells(light, layout, "picture"), settings.response);
    if (polarized)
      scene = polarized_scene(camera, settings.scene, seed, number);
    else
      scene.stokes = unpolarized(camera);
    mosaic = mosaic_of(scene.stokes, layout);
  }
  if (!of_scale.empty()) give_warning(source + ": " + of_scale);
  py::dict out;
  out["dn"] = array_of(std::move(mosaic));
  if (truth) add_truth(out, scene);
  return out;
}

// Says in the program's words what comes of pixels that are no numbers.
void warn_of_nonfinite(const Image& dn, const std::string& source, std::string_view what_comes,
                       Progress& progress) {
  if (const auto complaint = app::nonfinite_complaint(dn, source, what_comes); !complaint.empty())
    progress.warn(complaint);
}

// The clean signal of the frame as a denoiser sees it, with its fixed pattern, as the program's.
Image guide_from(const py::object& guide, const RawFrame& frame, const NoiseModel& model,
                 const GainSetting& gain, Progress& progress) {
  if (guide.is_none()) {
    const py::gil_scoped_release release;
    return denoise_frame(frame, denoising_profile(frame, model, gain), {}, progress).dn_above_black;
  }
  Image given = image_of(input_from(guide, "guide"), "guide");
  if (given.rows() != frame.dn.rows() || given.cols() != frame.dn.cols())
    throw InputError("guide",
                     fmt::format("has {} x {} pixels, the frame {} x {}", given.cols(),
                                 given.rows(), frame.dn.cols(), frame.dn.rows()),
                     "give the same scene's denoised mosaic");
  return given;
}

GainSetting source_gain(const Model& model, const RawFrame& frame, const Gain& told,
                        SynthesisKind kind) {
  if (!told) {
    const NoiseModel& held = model.description();
    const auto gains =
        kind == SynthesisKind::kNonparametric ? held.nonparametric.size() : held.physics.size();
    if (!frame.gain.decibel() && gains > 1)
      throw InputError(frame.source, "does not tell its gain, and the model holds several",
                       "give from_gain=");
    return frame.gain;
  }
  const GainSetting gain = model.gain_setting(*told);
  require_gain(frame, gain, "from_gain");
  return gain;
}

py::array renoise(const py::object& raw, const py::object& model_object, double to_gain,
                  const Gain& from_gain, const py::object& guide, bool rounded, std::uint64_t seed,
                  std::uint32_t number, const ToldOfFrame& told, const py::kwargs& kwargs) {
  const auto settings = settings_from<RenoiseSettings>(kwargs);
  const std::optional<Model> model = model_from(model_object);
  if (!model) throw InputError("model", "is None", "give the noise model of the frame's sensor");
  const NoiseModel& description = model->description();
  require_raw(raw, "give the raw frame");
  RawFrame frame = frame_from(raw, told, &description);
  require_single(frame);
  PythonProgress progress;
  if (const auto warning = take_levels_of_model(description, frame, told.white.has_value());
      !warning.empty())
    progress.warn(frame.source + ": " + warning);
  const GainSetting from = source_gain(*model, frame, from_gain, synthesis_kind(settings.kind));
  const GainSetting to = model->gain_setting(to_gain);
  if (const auto line = untold_gain_line(description, {from, to}); !line.empty())
    progress.warn(line);
  if (app::shows_noisy_frame(settings.method, !guide.is_none()))
    warn_of_nonfinite(frame.dn, frame.source, app::fate_of_nonfinite(!rounded), progress);
  Image result = guide_from(guide, frame, description, from, progress);
  if (!guide.is_none())
    warn_of_nonfinite(result, "guide", app::fate_in_guide(settings.method, !rounded), progress);
  LevelCoverage coverage;
  {
    const py::gil_scoped_release release;
    const ModelRenoiser renoiser(description, from, to, settings, rounded);
    subtract_black(frame);
    coverage = renoiser.apply(frame.dn, result, {.seed = seed, .frame = number});
  }
  if (const std::string complaint = coverage.complaint(); !complaint.empty())
    progress.warn(complaint);
  progress.give_warnings();
  return array_of(std::move(result));
}

void bind_renoise(py::module_& m) {
  m.def(
      "renoise",
      [](const py::object& raw, const py::object& model, double to_gain, const Gain& from_gain,
         const py::object& guide, bool rounded, std::uint64_t seed, std::uint32_t frame,
         const std::optional<std::string>& layout, const Black& black,
         const std::optional<double>& white, const py::kwargs& kwargs) {
        return renoise(raw, model, to_gain, from_gain, guide, rounded, seed, frame,
                       {layout, black, white}, kwargs);
      },
      py::arg("raw"), py::arg("model"), py::arg("to_gain"), py::kw_only(),
      py::arg("from_gain") = py::none(), py::arg("guide") = py::none(), py::arg("rounded") = false,
      py::arg("seed") = 0, py::arg("frame") = 0, py::arg("layout") = py::none(),
      py::arg("black") = py::none(), py::arg("white") = py::none(),
      ("A noisy mosaic of one gain as if taken at a noisier one, to_gain, as `malus renoise` makes "
       "it: float32 [row, column].\n\n"
       "raw, layout, black, white: as denoise takes them. model: a Model, or the path or name of "
       "one. from_gain, to_gain\n"
       "    [dB or ISO]: that of the Frame if from_gain is not given. guide: the denoised mosaic, "
       "DN above black; None:\n"
       "    denoise makes it. seed, frame: as of Model.synthesize.\n"
       "The result is DN above black, not rounded, not clipped; rounded=True: the camera's "
       "integers, with black." +
       settings_help<RenoiseSettings>())
          .c_str());
}

}  // namespace

void bind_synthesis(py::module_& m) {
  m.def("simulate", &simulate, py::arg("picture"), py::arg("layout") = "polar-bayer-rggb",
        py::kw_only(), py::arg("polarized") = false, py::arg("truth") = false,
        py::arg("tone") = "auto", py::arg("seed") = 0, py::arg("scene") = 0,
        ("A clean mosaic as a camera without noise would see a picture, as `malus simulate` makes "
         "it: dict of dn (float32 [row, column], DN above black, whole cells of the layout).\n\n"
         "picture: [row, column], [colour, row, column] or [row, column, colour], or the path of "
         "one. White is the largest\n"
         "    number of integers of 8 or 16 bits (wider ones are refused), 1 of floats. tone: auto "
         "undoes the sRGB curve of integers; "
         "srgb, linear.\n"
         "polarized: the scene gets a relief, which seed and scene (its number) decide, and light "
         "that is polarized by the\n"
         "    Fresnel equations. truth: also s0, s1, s2, dolp, aolp_deg [colour, row, column], and "
         "normals [3, row, column]\n"
         "    of a polarized scene." +
         settings_help<SimulateKeywords>())
            .c_str());
  bind_renoise(m);
}

}  // namespace malus::python
