// Denoising and polarization.
#include "malus/base/error.h"
#include "malus/denoise/column_noise.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/image/black_levels.h"
#include "malus/image/pack.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/sensor_window.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/stokes.h"
#include "malus/polar/uncertainty.h"

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "arrays.h"
#include "model_with_sampler.h"
#include "settings.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

// The element type tells, as the type of a file does, whether pixels are the camera's codes.
int bits_of(const py::array& array) {
  return array.dtype().kind() == 'f' ? 0 : static_cast<int>(8 * array.dtype().itemsize());
}

// A Frame, or an array with what an array does not know. What a model tells of its sensor, it fills
// in later (take_levels_of_model).
RawFrame frame_from(const py::object& raw, const std::optional<std::string>& layout,
                    const Black& black, const std::optional<double>& white,
                    const NoiseModel* model) {
  RawFrame frame;
  if (py::isinstance<RawFrame>(raw)) {
    frame = raw.cast<const RawFrame&>();
  } else {
    if (!(layout || model) || !(white || (model && model->white_dn > 0)))
      throw InputError("array", "does not know its layout and white level",
                       "give layout and white (and black), a model that tells them, or a Frame");
    const py::array numbers = numbers_from(raw, "raw");
    frame.dn = image_of(input_from(numbers, "raw"));
    frame.bits = bits_of(numbers);
    frame.source = "array";
    frame.black_dn = {0.0};
    if (model && !layout) {
      frame.layout = model->layout;
      frame.black_dn.assign(model->black_dn.size(), 0.0);
    }
  }
  const SensorLayout wanted = layout ? SensorLayout::named(*layout) : frame.layout;
  frame.black_dn = black ? black_per_channel(levels_of(black), wanted, "black")
                         : blacks_for_layout(frame, wanted);
  frame.layout = wanted;
  frame.layout_known = frame.layout_known || layout.has_value();
  frame.black_known = frame.black_known || black.has_value();
  frame.white_known = frame.white_known || white.has_value();
  if (white) frame.white_dn = *white;
  if ((black || white) && !model) require_levels(frame);
  return frame;
}

/// Row and column on the sensor of a frame's first pixel.
using Origin = std::optional<std::pair<int, int>>;

// As a frame of this size sees the model's defects and maps; returns what to warn of.
std::string fit_to_sensor(NoiseProfile& profile, const RawFrame& frame, const Origin& origin,
                          bool fill_defects) {
  if (!fill_defects) profile.defects.places.clear();
  const int rows = frame.dn.rows(), cols = frame.dn.cols();
  if (!origin) return left_out_of_window(profile, rows, cols);
  cut_to_window(profile, {origin->first, origin->second}, rows, cols, frame.source);
  return {};
}

py::dict denoise(const py::object& raw, const std::optional<std::string>& layout,
                 const Black& black, const std::optional<double>& white,
                 const ModelWithSampler* model, const Gain& gain, const Origin& origin,
                 bool variance, const py::kwargs& kwargs) {
  const auto settings = settings_from<DenoiseSettings>(kwargs);
  denoise_method(settings.method);  // a wrong one is refused before any work
  RawFrame frame = frame_from(raw, layout, black, white, model ? &model->description() : nullptr);
  const std::string source = frame.source;
  PythonProgress progress;
  if (model)
    if (const auto warning = take_levels_of_model(model->description(), frame); !warning.empty())
      progress.warn(source + ": " + warning);
  NoiseProfile profile;
  Denoised result;
  std::string left_out, estimated;
  {
    const py::gil_scoped_release release;
    if (model) {
      const GainSetting setting = gain ? model->model().gain_setting(*gain) : frame.gain;
      profile = denoising_profile(frame, model->description(), setting);
      if (settings.fixed_pattern) profile.pattern = fixed_pattern_at(model->description(), setting);
      left_out = fit_to_sensor(profile, frame, origin, settings.defects);
    } else {
      PictureNoise picture = require_estimate(frame, "give a model");
      profile = std::move(picture.profile);
      estimated = std::move(picture.trust);
    }
    result = denoise_frame(std::move(frame), profile, settings, progress, variance);
  }
  const std::string noise = result.noise ? noise_complaint(*result.noise) : "";
  std::vector<std::string> complaints = frame_complaints(result);
  complaints.insert(complaints.begin(), {estimated, left_out, noise});
  for (const std::string& complaint : complaints)
    if (!complaint.empty()) progress.warn(source + ": " + complaint);
  progress.give_warnings();
  py::dict out;
  out["dn"] = array_of(std::move(result.dn_above_black));
  out["variance"] =
      result.variance_dn2 ? py::object(array_of(std::move(*result.variance_dn2))) : py::none();
  out["sigma_used_dn"] = result.sigma_used_dn;
  out["row_noise_removed_dn"] = result.row_noise_removed_dn;
  out["column_noise_removed_dn"] = result.column_noise_removed_dn;
  out["nonfinite_pixels"] = result.nonfinite_pixels;
  out["saturated_pixels"] = result.saturated_pixels;
  out["cut_off_share"] = result.cut_off_share;
  out["cut_off_undone"] = result.cut_off_undone;
  out["defect_pixels"] = result.defect_pixels;
  out["impulse_pixels"] = result.impulse_pixels;
  out["kept_pixels"] = result.kept_pixels;
  out["dark_pattern_share"] = result.dark_pattern_share;
  out["response_pattern_share"] = result.response_pattern_share;
  out["mean_dn"] = result.mean_dn;
  out["mean_shift_dn"] = result.mean_shift_dn;
  out["noise_estimated_from_picture"] = profile.estimated_from_picture;
  return out;
}

Demosaicking demosaicking_named(const std::string& name) {
  const auto found = std::find(kDemosaickingNames.begin(), kDemosaickingNames.end(), name);
  if (found == kDemosaickingNames.end())
    throw InputError("demosaick", fmt::format("\"{}\" is not known", name),
                     fmt::format("give {}, or None for one value per cell",
                                 fmt::join(kDemosaickingNames, " or ")));
  return static_cast<Demosaicking>(found - kDemosaickingNames.begin());
}

// [colour, row, column]
template <class Colors, class PlaneOf>
py::object stacked(const Colors& colors, const PlaneOf& plane_of) {
  py::list planes;
  for (const auto& color : colors) planes.append(array_of(plane_of(color)));
  return py::module_::import("numpy").attr("stack")(planes);
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

// Per colour of the picture, from the variance of every pixel of the mosaic.
std::vector<StokesUncertainty> uncertainty_from(const py::object& given,
                                                const StokesPicture& picture,
                                                View<const float> mosaic,
                                                const SensorLayout& layout, bool denoised) {
  const Array variance = input_from(given, "variance");
  const auto view = view_of(variance);
  if (view.rows() != mosaic.rows() || view.cols() != mosaic.cols())
    throw InputError("variance",
                     fmt::format("{} x {}, the mosaic {} x {}", view.cols(), view.rows(),
                                 mosaic.cols(), mosaic.rows()),
                     "give what denoise(variance=True) returned beside the mosaic");
  const py::gil_scoped_release release;
  return uncertainty_of(picture, pack(view, layout), layout,
                        denoised ? Intensities::kDenoised : Intensities::kMeasured);
}

py::dict stokes(const py::object& dn_above_black, const std::string& layout_name,
                const std::optional<std::string>& demosaick_name,
                const std::optional<py::object>& variance, bool denoised) {
  const auto layout = SensorLayout::named(layout_name);
  require_polarized(layout, "array");
  const Array mosaic = input_from(dn_above_black, "dn_above_black");
  const auto view = view_of(mosaic);
  require_whole_cell(view, layout, "dn_above_black");
  std::optional<Demosaicking> method;
  if (demosaick_name) method = demosaicking_named(*demosaick_name);
  if (method && variance)
    throw InputError("demosaick", "errors are known per cell only", "leave it or variance out");
  std::optional<StokesPicture> picture;
  {
    const py::gil_scoped_release release;
    picture = method ? demosaick(view, layout, *method, "dn_above_black")
                     : merge_greens(stokes_per_color(pack(view, layout), layout), layout);
  }
  py::dict out;
  const std::vector<StokesPlanes>& colors = picture->planes;
  out["s0"] = stacked(colors, [](const StokesPlanes& s) { return s.s0; });
  out["s1"] = stacked(colors, [](const StokesPlanes& s) { return s.s1; });
  out["s2"] = stacked(colors, [](const StokesPlanes& s) { return s.s2; });
  out["dolp"] = stacked(colors, [](const StokesPlanes& s) { return dolp_of(s); });
  out["aolp_deg"] = stacked(colors, [](const StokesPlanes& s) { return aolp_deg_of(s); });
  if (variance) add_uncertainty(out, uncertainty_from(*variance, *picture, view, layout, denoised));
  return out;
}

}  // namespace

void bind_denoise(py::module_& m) {
  m.def(
      "denoise", &denoise, py::arg("raw"), py::kw_only(), py::arg("layout") = py::none(),
      py::arg("black") = py::none(), py::arg("white") = py::none(), py::arg("model") = py::none(),
      py::arg("gain") = py::none(), py::arg("origin") = py::none(), py::arg("variance") = false,
      ("Denoises one raw mosaic.\n\n"
       "raw: a Frame, or an array [row, column] in DN, black included. layout: the Frame's, else "
       "the model's.\n"
       "black: one number, or one per channel in mosaic order. Not known to the Frame, not given: "
       "the model's for integers, 0\n"
       "    for float pixels, which are taken as DN above black, and without a model. white: the "
       "Frame's, else the model's.\n"
       "model: a Model; None estimates the noise from the picture. gain [dB or ISO]: that of "
       "the Frame if not given.\n"
       "origin: (row, column) on the calibrated sensor of the first pixel, where raw is a part of "
       "it: for the model's defects\n"
       "    and fixed pattern.\n\n"
       "Returns a dict: dn (float32 [row, column], DN above black), variance (its expected "
       "squared error [DN^2], NaN of saturated pixels; with variance=True, else None), "
       "sigma_used_dn (per channel), "
       "row_noise_removed_dn, column_noise_removed_dn, defect_pixels, impulse_pixels, kept_pixels, "
       "mean_dn, mean_shift_dn, "
       "noise_estimated_from_picture." +
       settings_help<DenoiseSettings>())
          .c_str());
  m.def("stokes", &stokes, py::arg("dn_above_black"), py::arg("layout"), py::kw_only(),
        py::arg("demosaick") = py::none(), py::arg("variance") = py::none(),
        py::arg("denoised") = true,
        "Stokes parameters of a raw mosaic [row, column] in DN above black: dict of s0, s1, s2 "
        "[DN], dolp [1], aolp_deg [deg, 0 to 180], each float32 [colour, row, column], at one "
        "value per cell of the layout; with demosaick=\"residual\" (or \"bilinear\") at one per "
        "pixel.\n\n"
        "variance: of every pixel of the mosaic [DN^2], as denoise(variance=True) gives it: adds "
        "the standard deviations s0_sd, s1_sd, s2_sd [DN], dolp_sd, aolp_sd_deg, and "
        "dolp_corrected. denoised=False: the mosaic is raw, its pixels' noise independent.");
}

}  // namespace malus::python
