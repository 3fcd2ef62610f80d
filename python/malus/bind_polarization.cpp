// Stokes parameters and normals.
#include "malus/base/error.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/pack.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/raw_variance.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/normals.h"
#include "malus/polar/render.h"
#include "malus/polar/stokes.h"
#include "malus/polar/uncertainty.h"

#include <algorithm>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "array_frame.h"
#include "frame_contents.h"
#include "model_with_sampler.h"
#include "settings.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

constexpr const char* kLight = "dn_above_black";

/// The light of a mosaic.
struct Light {
  Array dn;  ///< above black
  SensorLayout layout;
  std::string source = "array";
  SaturatedCells saturated{};  ///< none where white is not known
  View<const float> view() const { return view_of(dn, kLight); }
};

// In the program's words.
void warn_of_saturation(const std::string& source, const SaturatedCells& cells) {
  if (const auto complaint = cells.complaint(); !complaint.empty())
    give_warning(source + ": " + complaint);
}

void warn_of_lost_light(View<const float> dn, const std::string& source) {
  if (const auto complaint = app::nonfinite_complaint(dn, source, app::fate_in_polarization());
      !complaint.empty())
    give_warning(complaint);
}

// Of a Frame above black.
void warn_of_guesses(const RawFrame& frame) {
  for (const std::string& complaint : app::guess_complaints(frame))
    give_warning(frame.source + ": " + complaint);
}

void warn_of_no_light(const std::string& source, std::span<const StokesPlanes> planes, bool whole) {
  if (const auto complaint = app::no_light_complaint(planes, whole); !complaint.empty())
    give_warning(source + ": " + complaint);
}

// An array, or a Frame, which knows its black level and its layout.
Light light_of(const py::object& given, const std::optional<std::string>& layout,
               const Black& black) {
  Light light;
  if (held_frame(given)) {
    RawFrame frame = frame_from(given, {layout, black, {}}, nullptr);
    const std::vector<float> saturated_dn = app::take_as_light(frame);
    require_polarized(frame.layout, frame.source);
    warn_of_guesses(frame);
    const auto saturated = saturated_cells(frame.dn, frame.layout, saturated_dn);
    light = {array_of(std::move(frame.dn)).cast<Array>(), frame.layout, frame.source, saturated};
  } else {
    if (!layout) throw InputError("layout", "is not told by an array", "name it, or give a Frame");
    light.dn = above_black(given, kLight, {layout, black, {}});
    light.layout = SensorLayout::named(*layout);
  }
  require_polarized(light.layout, light.source);
  require_whole_cell(light.view(), light.layout, kLight);
  return light;
}

/// None: one value per cell.
using Method = std::optional<Demosaicking>;

Method method_named(const std::optional<std::string>& name) {
  if (!name) return std::nullopt;
  const auto found = std::find(kDemosaickingNames.begin(), kDemosaickingNames.end(), *name);
  if (found == kDemosaickingNames.end())
    throw InputError("demosaick", fmt::format("\"{}\" is not known", *name),
                     fmt::format("give {}, or None for one value per cell",
                                 fmt::join(kDemosaickingNames, " or ")));
  return static_cast<Demosaicking>(found - kDemosaickingNames.begin());
}

StokesPicture stokes_picture(View<const float> mosaic, const SensorLayout& layout,
                             const Method& method) {
  const PythonProgress progress;
  return method ? demosaick(mosaic, layout, *method, kLight, progress)
                : merge_greens(stokes_per_color(pack(mosaic, layout), layout), layout);
}

// [colour, row, column]
template <class Colors, class PlaneOf>
py::object stacked(const Colors& colors, const PlaneOf& plane_of) {
  std::vector<Image> planes;
  for (const auto& color : colors) planes.push_back(plane_of(color));
  return stack_of(std::move(planes));
}

void add_uncertainty(py::dict& out, const std::vector<StokesUncertainty>& colors) {
  const auto numpy = py::module_::import("numpy");
  for (const auto& [name, variance] : {std::pair{"s0_sd", &StokesUncertainty::s0_variance},
                                       {"s1_sd", &StokesUncertainty::s1_variance},
                                       {"s2_sd", &StokesUncertainty::s2_variance}})
    out[name] = numpy.attr("sqrt")(
        stacked(colors, [&](const StokesUncertainty& u) { return u.*variance; }));
  for (const auto& [name, plane] : {std::pair{"dolp_sd", &StokesUncertainty::dolp_sd},
                                    {"aolp_sd_deg", &StokesUncertainty::aolp_sd_deg},
                                    {"dolp_corrected", &StokesUncertainty::dolp_corrected}})
    out[name] = stacked(colors, [&](const StokesUncertainty& u) { return u.*plane; });
}

// Per colour of the picture, from the variance of every pixel of the mosaic, which tells as well
// where the light is saturated.
std::vector<StokesUncertainty> uncertainty_from(const py::object& given,
                                                const StokesPicture& picture, Light& light,
                                                bool denoised) {
  const View<const float> mosaic = light.view();
  const Array variance = input_from(given, "variance");
  const auto view = view_of(variance, "variance");
  if (view.rows() != mosaic.rows() || view.cols() != mosaic.cols())
    throw InputError("variance",
                     fmt::format("{} x {}, the mosaic {} x {}", view.cols(), view.rows(),
                                 mosaic.cols(), mosaic.rows()),
                     "give what denoise(variance=True) returned beside the mosaic");
  const py::gil_scoped_release release;
  const Planes packed = pack(view, light.layout);
  require_variances(packed, light.layout, "variance");
  light.saturated = saturated_cells(mosaic, light.layout, packed);
  return uncertainty_of(picture, packed, light.layout,
                        denoised ? Intensities::kDenoised : Intensities::kMeasured);
}

py::dict dict_of(const StokesPicture& picture) {
  const std::vector<StokesPlanes>& colors = picture.planes;
  py::dict out;
  out["s0"] = stacked(colors, [](const StokesPlanes& s) { return s.s0; });
  out["s1"] = stacked(colors, [](const StokesPlanes& s) { return s.s1; });
  out["s2"] = stacked(colors, [](const StokesPlanes& s) { return s.s2; });
  out["dolp"] = stacked(colors, [](const StokesPlanes& s) { return dolp_of(s); });
  out["aolp_deg"] = stacked(colors, [](const StokesPlanes& s) { return aolp_deg_of(s); });
  return out;
}

// A frame above black, and where its channels are saturated.
struct RawLight {
  RawFrame frame;
  std::vector<float> saturated_dn;
};

// A raw frame as light, with the levels that it does not know from the model.
RawLight raw_light_of(const py::object& given, const ToldOfFrame& told, const NoiseModel& model) {
  RawLight light;
  RawFrame& frame = light.frame;
  // As denoise takes them: integers hold the model's black level, floats one that is told.
  if (held_frame(given) || told.black || holds_codes(numbers_from(given, kLight))) {
    frame = frame_from(given, told, &model);
    if (const auto warning = take_levels_of_model(model, frame); !warning.empty())
      give_warning(frame.source + ": " + warning);
    light.saturated_dn = app::take_as_light(frame);
    warn_of_guesses(frame);
  } else {
    frame = pixels_of(given, kLight);
    frame.layout = told.layout ? SensorLayout::named(*told.layout) : model.layout;
    // Above black as its argument's name says: which pixels are saturated the model tells.
    frame.black_dn = model.black_dn;
    frame.white_dn = model.white_dn;
    frame.white_known = model.white_dn > 0;
    light.saturated_dn = saturation_dn(frame);
    frame.white_dn = white_above_black(model.white_dn, model.black_dn);
    frame.black_dn.assign(static_cast<std::size_t>(frame.layout.channels()), 0.0);
    frame.black_known = true;
  }
  require_layout_of_model(frame, model.layout);
  require_polarized(frame.layout, frame.source);
  require_whole_cell(frame.dn, frame.layout, kLight);
  return light;
}

// Of raw pixels, whose noise a model tells: its bias is taken out.
py::dict stokes_by_model(const py::object& given, const ToldOfFrame& told, const Model& model,
                         const Gain& gain_given, bool extrapolate, bool fixed_pattern) {
  require_raw(given, "give variance= with what denoise(variance=True) returned, or the raw frame");
  RawLight light = raw_light_of(given, told, model.description());
  RawFrame& frame = light.frame;
  warn_of_lost_light(frame.dn, frame.source);
  const SensorLayout& layout = frame.layout;
  const GainSetting gain = gain_given ? model.gain_setting(*gain_given) : frame.gain;
  std::optional<StokesPicture> picture;
  std::vector<StokesUncertainty> uncertainty;
  SaturatedCells saturated;
  {
    const py::gil_scoped_release release;
    const NoiseProfile profile =
        raw_profile(frame, model.description(), gain, gain_range(extrapolate), fixed_pattern);
    const Planes variance = pack(take_out_bias(frame, profile, light.saturated_dn), layout);
    saturated = saturated_cells(frame.dn, layout, variance);
    picture = stokes_picture(frame.dn, layout, std::nullopt);
    uncertainty =
        uncertainty_of(*picture, variance, layout, Intensities::kMeasured, shared_offsets(profile));
  }
  for (const std::string& line : model_complaints(model.description(), gain, false))
    give_warning(line);
  warn_of_saturation(frame.source, saturated);
  warn_of_no_light(frame.source, picture->planes, false);
  py::dict out = dict_of(*picture);
  add_uncertainty(out, uncertainty);
  return out;
}

py::dict stokes(const py::object& dn_above_black, const std::optional<std::string>& layout_name,
                const std::optional<std::string>& demosaick_name,
                const std::optional<py::object>& variance, bool denoised,
                const py::object& given_model, const Gain& gain, bool extrapolate_gain,
                bool fixed_pattern, const Black& black) {
  const Method method = method_named(demosaick_name);
  const std::optional<Model> model = model_from(given_model);
  if (method && (variance || model))
    throw InputError("demosaick", "errors are known per cell only",
                     model ? "leave it or model out" : "leave it or variance out");
  if (variance && model)
    throw InputError("variance", "and model tell the same", "leave one of them out");
  require_model_for("gain", gain.has_value(), model);
  require_model_for("extrapolate_gain", extrapolate_gain, model);
  require_model_for("fixed_pattern", !fixed_pattern, model);
  if (model)
    return stokes_by_model(dn_above_black, {layout_name, black, {}}, *model, gain, extrapolate_gain,
                           fixed_pattern);
  Light light = light_of(dn_above_black, layout_name, black);
  const auto view = light.view();
  warn_of_lost_light(view, light.source);
  std::optional<StokesPicture> picture;
  {
    const py::gil_scoped_release release;
    picture = stokes_picture(view, light.layout, method);
  }
  py::dict out = dict_of(*picture);
  if (variance) add_uncertainty(out, uncertainty_from(*variance, *picture, light, denoised));
  warn_of_saturation(light.source, light.saturated);
  warn_of_no_light(light.source, picture->planes, method.has_value());
  return out;
}

// The object's pixels, of one colour's size.
Image mask_from(const py::object& given, const Image& s0) {
  Image mask = image_of(input_from(given, "mask"), "mask");
  if (mask.rows() != s0.rows() || mask.cols() != s0.cols())
    throw InputError(
        "mask",
        fmt::format("{} x {}, the normals {} x {}", mask.cols(), mask.rows(), s0.cols(), s0.rows()),
        "give one value per cell, or per pixel with demosaick=");
  return mask;
}

py::object normals(const py::object& dn_above_black, const std::optional<std::string>& layout_name,
                   const std::optional<py::object>& mask,
                   const std::optional<std::string>& demosaick_name, const Black& black,
                   const py::kwargs& kwargs) {
  const auto settings = settings_from<NormalSettings>(kwargs);
  const Light light = light_of(dn_above_black, layout_name, black);
  warn_of_saturation(light.source, light.saturated);
  const SensorLayout& layout = light.layout;
  const auto view = light.view();
  warn_of_lost_light(view, light.source);
  const Method method = method_named(demosaick_name);
  StokesPlanes mean;
  {
    const py::gil_scoped_release release;
    mean = mean_stokes(stokes_picture(view, layout, method).planes);
  }
  warn_of_no_light(light.source, {&mean, 1}, method.has_value());
  std::optional<Image> object;
  if (mask) object = mask_from(*mask, mean.s0);
  NormalMap map;
  {
    const py::gil_scoped_release release;
    map = normals_of(mean, object ? *object : foreground_mask(mean.s0, settings.foreground),
                     settings);
  }
  return stacked(std::vector{&NormalMap::x, &NormalMap::y, &NormalMap::z},
                 [&](Image NormalMap::*axis) { return map.*axis; });
}

}  // namespace

void bind_polarization(py::module_& m) {
  m.def(
      "stokes", &stokes, py::arg("dn_above_black"), py::arg("layout") = py::none(), py::kw_only(),
      py::arg("demosaick") = py::none(), py::arg("variance") = py::none(),
      py::arg("denoised") = true, py::arg("model") = py::none(), py::arg("gain") = py::none(),
      py::arg("extrapolate_gain") = false, py::arg("fixed_pattern") = true,
      py::arg("black") = py::none(),
      "Stokes parameters of a raw mosaic [row, column] in DN above black, or of a Frame: dict of "
      "s0, s1, s2 [DN], dolp [1], aolp_deg [deg, 0 to 180], each float32 [colour, row, column], at "
      "one "
      "value per cell of the layout; with demosaick=\"residual\" (or \"bilinear\") at one per "
      "pixel.\n\n"
      "black: the level that integers hold, and floats and Frames where it is given: one number, "
      "or one per channel. Not given, that of the Frame, or of integers the model's.\n\n"
      "variance: of every pixel of the mosaic [DN^2], as denoise(variance=True) gives it: adds "
      "the standard deviations s0_sd, s1_sd, s2_sd [DN], dolp_sd, aolp_sd_deg, and "
      "dolp_corrected. denoised=False: the mosaic is raw, its pixels' noise independent; what its "
      "rows and columns share is known with model alone.\n\n"
      "model: a Model, or the path or name of one, that tells the variance of raw pixels at gain "
      "[dB or ISO] (that of the Frame if not given), adds the same, and takes its bias out first. "
      "PRNU and DSNU are part of the errors; fixed_pattern=False: the frame was flat-fielded.");
  m.def("normals", &normals, py::arg("dn_above_black"), py::arg("layout") = py::none(),
        py::kw_only(), py::arg("mask") = py::none(), py::arg("demosaick") = py::none(),
        py::arg("black") = py::none(),
        ("Surface normals from the polarization of a raw mosaic [row, column] in DN above black, "
         "or of a Frame: float32 [3, row, column], unit vectors x right, y up, z towards the "
         "camera; NaN outside "
         "the object. One per cell of the layout; with demosaick=\"residual\" (or \"bilinear\") "
         "one per pixel.\n\n"
         "mask: of the normals' size, above 0 where the object is; None: bright pixels. black: as "
         "stokes takes it." +
         settings_help<NormalSettings>())
            .c_str());
}

}  // namespace malus::python
