// Denoising, and the noise of a picture.
#include "malus/base/error.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/black_levels.h"
#include "malus/io/picture_file.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/sensor_window.h"

#include <algorithm>
#include <iterator>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "array_frame.h"
#include "frame_contents.h"
#include "kept_network.h"
#include "model_with_sampler.h"
#include "modules.h"
#include "settings.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

/// Row and column on the sensor of a frame's first pixel.
using Origin = std::optional<std::pair<int, int>>;

std::optional<SensorPlace> place_of(const Origin& origin) {
  if (!origin) return std::nullopt;
  return SensorPlace{origin->first, origin->second};
}

// What is told of the noise, with or without a model.
struct ToldOfNoise {
  std::optional<Model> model;
  Gain gain;
  Origin origin;
  bool extrapolate_gain = false;
};

// The noise that is taken out; what is to be said of it goes to complaints, whole lines.
NoiseProfile profile_of_frame(const RawFrame& frame, const ToldOfNoise& told,
                              const DenoiseSettings& settings, bool cut_off_undone,
                              std::vector<std::string>& complaints) {
  const auto add = [&](const std::string& line) {
    if (!line.empty()) complaints.push_back(frame.source + ": " + line);
  };
  if (!told.model) {
    PictureNoise picture = require_estimate(frame, "give model=");
    add(picture.trust);
    add(std::string(kPictureNoiseLimits) + "; a calibrated model (model=) is better");
    return std::move(picture.profile);
  }
  const NoiseModel& model = told.model->description();
  const GainSetting gain = told.gain ? told.model->gain_setting(*told.gain) : frame.gain;
  FrameProfile made = frame_profile(frame, model, gain, settings, place_of(told.origin),
                                    gain_range(told.extrapolate_gain));
  for (std::string& line : model_complaints(model, gain, cut_off_undone))
    complaints.push_back(std::move(line));
  add(made.left_out);
  add(made.unseen);
  return std::move(made.profile);
}

// Facts about the frame, its noise and what was done.
py::dict facts_of(const Denoised& result, bool noise_estimated) {
  py::dict out = dict_of_described(result);
  out["noise_estimated_from_picture"] = noise_estimated;
  return out;
}

// A denoised mosaic, or the picture that a network gives in its place.
struct Result {
  Denoised mosaic;
  std::optional<NetworkInference::Rendered> rendered;
};

py::dict dict_of(Result& result, NetworkTarget target, bool noise_estimated) {
  const bool picture = result.rendered.has_value();
  py::dict out = facts_of(picture ? result.rendered->report : result.mosaic, noise_estimated);
  out["target"] = network_target_name(target);
  out["dn"] = picture ? py::object(py::none()) : array_of(std::move(result.mosaic.dn_above_black));
  out["variance"] = result.mosaic.variance_dn2
                        ? py::object(array_of(std::move(*result.mosaic.variance_dn2)))
                        : py::none();
  out["picture"] = py::none();
  out["scale_dn"] = py::none();
  if (!picture) return out;
  Planes& planes = result.rendered->picture;
  out["picture"] =
      stack_of({std::make_move_iterator(planes.begin()), std::make_move_iterator(planes.end())});
  out["scale_dn"] = result.rendered->scale_dn;
  return out;
}

// One frame through a denoiser; what is to be said of it goes to complaints.
Result run(const app::FrameDenoiser& denoiser, RawFrame frame, const NoiseProfile& profile,
           const std::string& method, Progress& progress, std::vector<std::string>& complaints) {
  RawFrame before;
  before.source = frame.source;
  before.layout = frame.layout;
  Result result;
  std::vector<std::string> lines;
  if (denoiser.target() == NetworkTarget::kMosaic) {
    result.mosaic = denoiser(std::move(frame), profile, progress);
    lines = result_complaints(before, result.mosaic, profile,
                              app::is_weight_file(method) ? method : "");
  } else {
    result.rendered = denoiser.render(std::move(frame), profile, progress);
    lines = app::picture_complaints(*result.rendered);
  }
  for (const std::string& line : lines) complaints.push_back(before.source + ": " + line);
  return result;
}

// A path is the name of a network's file; its bytes need not be UTF-8.
void take_path_as_text(py::kwargs& kwargs) {
  if (!kwargs.contains("method") || !is_path(kwargs["method"])) return;
  const py::module_ os = py::module_::import("os");
  py::object method = os.attr("fspath")(kwargs["method"]);
  kwargs["method"] = method;
  try {
    kwargs["method"] = os.attr("fsencode")(method);
  } catch (py::error_already_set&) {  // no file's name: refused as other settings are
  }
}

py::dict denoise(const py::object& raw, const ToldOfFrame& told_of_frame, const ToldOfNoise& told,
                 bool variance, py::kwargs kwargs) {
  take_path_as_text(kwargs);
  const auto settings = settings_from<DenoiseKeywords>(kwargs);
  const std::string& method = settings.filter.method;
  app::require_method(method);  // a wrong one is refused before any work
  require_model_for("gain", told.gain.has_value(), told.model);
  require_model_for("origin", told.origin.has_value(), told.model);
  require_model_for("extrapolate_gain", told.extrapolate_gain, told.model);
  const NoiseModel* model = told.model ? &told.model->description() : nullptr;
  if (model) require_raw(raw, "give the raw frame");
  RawFrame frame = frame_from(raw, told_of_frame, model);
  PythonProgress progress;
  if (const HeldFrame* held = held_frame(raw); held && held->holds == kHoldsDenoised)
    progress.warn(fmt::format("{}: {}", held->source, app::kDenoisedAgain));
  if (model)
    if (const auto warning = take_levels_of_model(*model, frame, told_of_frame.white.has_value());
        !warning.empty())
      progress.warn(frame.source + ": " + warning);
  const std::shared_ptr<SharedDenoiser> shared = denoiser_for(settings, variance);
  const app::FrameDenoiser& denoiser = shared->denoiser;
  denoiser.require_used(given_settings<InferenceSettings>(kwargs));
  denoiser.require_used_of_filter(given_settings<DenoiseSettings>(kwargs));
  if (variance && denoiser.target() != NetworkTarget::kMosaic)
    throw InputError("variance", "the network gives pictures, not denoised mosaics",
                     "leave it out");
  std::vector<std::string> complaints{take_networks_complaint(), denoiser.precision_complaint()};
  Result result;
  bool estimated = false;
  {
    const py::gil_scoped_release release;
    const std::lock_guard one_at_a_time(shared->mutex);
    const NoiseProfile profile =
        profile_of_frame(frame, told, settings.filter, denoiser.undoes_cut_off(), complaints);
    estimated = profile.estimated_from_picture;
    for (const std::string& line : app::guess_complaints(frame))
      complaints.push_back(frame.source + ": " + line);
    result = run(denoiser, std::move(frame), profile, method, progress, complaints);
  }
  for (const std::string& line : complaints)
    if (!line.empty()) progress.warn(line);
  progress.give_warnings();
  return dict_of(result, denoiser.target(), estimated);
}

// A line's slope and offset, of one that is cut off at the bottom too.
std::pair<double, double> line_of(const VarianceCurve& curve, double white_dn) {
  const double slope = 2 * (curve(white_dn) - curve(white_dn / 2)) / white_dn;
  return {slope, curve(white_dn) - slope * white_dn};
}

py::dict noise_of_picture(const py::object& raw, const std::optional<std::string>& layout,
                          const Black& black, const std::optional<double>& white) {
  const RawFrame frame = frame_from(raw, {layout, black, white}, nullptr);
  std::optional<PictureNoise> noise;
  {
    const py::gil_scoped_release release;
    noise = require_estimate(frame, "give a larger picture, or calibrate the camera");
  }
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  std::vector<double> slope, offset, rows;
  for (const ChannelProfile& channel : noise->profile.channels) {
    const auto [rise, dark] = line_of(channel.variance, range_dn);
    slope.push_back(rise);
    offset.push_back(dark);
    rows.push_back(channel.sigma_row_dn);
  }
  using namespace py::literals;
  return py::dict("slope_dn"_a = slope, "offset_dn2"_a = offset, "sigma_row_dn"_a = rows,
                  "relative_error"_a = noise->relative_error, "levels"_a = noise->levels,
                  "smooth_share"_a = noise->smooth_share, "texture_share"_a = noise->texture_share,
                  "trust"_a = noise->trust);
}

}  // namespace

void bind_denoise(py::module_& m) {
  m.def(
      "denoise",
      [](const py::object& raw, const std::optional<std::string>& layout, const Black& black,
         const std::optional<double>& white, const py::object& model, const Gain& gain,
         const Origin& origin, bool variance, bool extrapolate_gain, const py::kwargs& kwargs) {
        return denoise(raw, {layout, black, white},
                       {model_from(model), gain, origin, extrapolate_gain}, variance, kwargs);
      },
      py::arg("raw"), py::kw_only(), py::arg("layout") = py::none(), py::arg("black") = py::none(),
      py::arg("white") = py::none(), py::arg("model") = py::none(), py::arg("gain") = py::none(),
      py::arg("origin") = py::none(), py::arg("variance") = false,
      py::arg("extrapolate_gain") = false,
      ("Denoises one raw mosaic.\n\n"
       "raw: a Frame, or an array [row, column] in DN, black included. layout: the Frame's, else "
       "the model's.\n"
       "black: one number, or one per channel in mosaic order. Not known to the Frame, not given: "
       "the model's for integers, 0\n"
       "    for float pixels, which are taken as DN above black, and without a model. white: the "
       "Frame's, else the model's.\n"
       "model: a Model, or the path or name of one; None estimates the noise from the picture. "
       "gain [dB or ISO]: that of the Frame if not given.\n"
       "origin: (row, column) on the calibrated sensor of the first pixel, where raw is a part of "
       "it: for the model's defects\n"
       "    and fixed pattern. extrapolate_gain: a gain outside the calibrated range is taken.\n"
       "method: one of those by name, or a network's weight file (.safetensors), which device, "
       "precision, tile_batch\n"
       "    and ratio are for; the last one is kept for the next call.\n\n"
       "Returns a dict: dn (float32 [row, column], DN above black), variance (its expected "
       "squared error [DN^2], NaN of saturated pixels; with variance=True, else None), "
       "noise_estimated_from_picture, target ('mosaic'), picture and scale_dn (None). Of a network "
       "that gives pictures, target is 'rgb' or 'srgb', dn None, and picture (float32 [3, row, "
       "column]) DN above black, or displayed values of about 0 to 1 at scale_dn, the light that "
       "is shown as 1. And of the frame:\n" +
       results_help<Denoised>() + settings_help<DenoiseKeywords>())
          .c_str());
  m.def("estimate_noise", &noise_of_picture, py::arg("raw"), py::kw_only(),
        py::arg("layout") = py::none(), py::arg("black") = py::none(),
        py::arg("white") = py::none(),
        "The noise of a single picture, without a model: raw, layout, black, white as denoise "
        "takes them.\n\n"
        "Returns a dict: per channel the line variance = slope_dn * signal + offset_dn2 of the "
        "pixel noise against the signal above black, and sigma_row_dn; relative_error (of the "
        "deviation at the mean signal, one standard error), levels (of brightness that carry the "
        "fit), smooth_share and texture_share of the blocks, trust (one sentence with the "
        "numbers). InputError where the picture is too small or has no noise.");
}

}  // namespace malus::python
