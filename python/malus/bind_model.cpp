// Noise models: load, draw, save.
#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/noise/builtin_models.h"
#include "malus/noise/frame_levels.h"
#include "malus/synthesize/model.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "arrays.h"
#include "json_objects.h"
#include "model_json.h"
#include "model_with_sampler.h"
#include "noise_drawing.h"
#include "settings.h"
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace malus::python {
namespace {

std::string synthesize_help() {
  return "Noisy version of clean, float32, in the same shape.\n\n"
         "clean: signal in DN above the black level: [row, column] mosaic, [channel, row, column] "
         "packed planes\n"
         "    in the model's channel order, or [frame, channel, row, column], a batch whose frames "
         "are numbered\n"
         "    frame, frame + 1, ...; a NumPy array, or a torch tensor on the CPU. Float32 in C "
         "order is not copied.\n"
         "gain: in the model's unit (dB, or ISO); None draws one per frame over the calibrated "
         "range.\n"
         "seed, frame: the same seed, frame and pixel give the same noise for any number of "
         "threads.\n"
         "out: float32 array or tensor of clean's shape, written in place and returned; may be "
         "clean itself,\n"
         "    but not overlap it in part.\n"
         "row0, col0: place of a mosaic's first pixel on the sensor: a crop gets the noise of its "
         "place.\n"
         "black: the level that integers in clean hold, one number or one per channel; 0 where it "
         "is subtracted already.\n\n"
         "The result is DN above black, not rounded, not clipped, with the converter's "
         "quantisation noise: rounding it would\n"
         "count that twice. rounded=True: the camera's integers, with black, as float32.";
}

void bind_noise(py::module_& m) {
  py::class_<NoiseAtGain>(m, "Noise",
                          "The noise of a model at one gain (or at random gains): Model.at_gain "
                          "makes it.")
      .def(
          "synthesize",
          [](const NoiseAtGain& noise, const py::object& clean, std::uint64_t seed,
             std::uint32_t frame, const py::object& out, std::int64_t row0, std::int64_t col0,
             const Black& black, bool rounded) {
            return synthesize(noise, clean, {seed, frame, row0, col0}, {black, rounded}, out);
          },
          py::arg("clean"), py::arg("seed") = 0, py::arg("frame") = 0, py::arg("out") = py::none(),
          py::kw_only(), py::arg("row0") = 0, py::arg("col0") = 0, py::arg("black") = py::none(),
          py::arg("rounded") = false, synthesize_help().c_str())
      .def("__repr__",
           [](const NoiseAtGain& noise) { return fmt::format("<malus.Noise {}>", noise.text()); });
}

using ModelClass = py::class_<ModelWithSampler>;

NoiseAtGain noise_of(ModelWithSampler& model, const Gain& gain, const py::kwargs& kwargs) {
  NoiseAtGain noise = model.noise(gain, kwargs);
  if (!gain) return noise;
  const NoiseModel& held = model.description();
  if (const std::string line = untold_gain_line(held, {held.setting_of(*gain)}); !line.empty())
    give_warning(line);
  return noise;
}

void add_drawing(ModelClass& model_class) {
  model_class
      .def(
          "at_gain",
          [](ModelWithSampler& model, const Gain& gain, const py::kwargs& kwargs) {
            return noise_of(model, gain, kwargs);
          },
          py::arg("gain"),
          ("The noise at one gain [dB or ISO]; None: every frame draws its own." +
           settings_help<SynthesisSettings>())
              .c_str())
      .def(
          "synthesize",
          [](ModelWithSampler& model, const py::object& clean, const Gain& gain, std::uint64_t seed,
             std::uint32_t frame, const py::object& out, std::int64_t row0, std::int64_t col0,
             const Black& black, bool rounded, const py::kwargs& kwargs) {
            return synthesize(noise_of(model, gain, kwargs), clean, {seed, frame, row0, col0},
                              {black, rounded}, out);
          },
          py::arg("clean"), py::arg("gain") = py::none(), py::arg("seed") = 0, py::arg("frame") = 0,
          py::arg("out") = py::none(), py::kw_only(), py::arg("row0") = 0, py::arg("col0") = 0,
          py::arg("black") = py::none(), py::arg("rounded") = false,
          (synthesize_help() + settings_help<SynthesisSettings>()).c_str())
      .def(
          "random_gain",
          [](const ModelWithSampler& model, std::uint64_t seed, std::uint32_t frame,
             const std::string& kind) {
            SynthesisSettings settings;
            settings.kind = kind;
            require_settings(settings);
            const auto gain = random_gain(model.description(), settings, seed, frame);
            if (!gain.decibel())
              throw InputError("model", "was calibrated at one gain that nobody told",
                               "leave the gain out: there is no other to draw");
            return gain.iso ? *gain.iso : *gain.gain_db;
          },
          py::arg("seed"), py::arg("frame"), py::kw_only(), py::arg("kind") = "physics",
          "The gain [dB or ISO] that synthesize(gain=None) draws for this seed, frame and kind.");
}

// Pickled is the model file itself, by way of a folder that goes with the call.
template <class Use>
auto with_temporary_file(const Use& use) {
  const py::object folder = py::module_::import("tempfile").attr("TemporaryDirectory")();
  const auto result =
      use(std::filesystem::path(folder.attr("name").cast<std::string>()) / "model.h5");
  folder.attr("cleanup")();
  return result;
}

py::bytes bytes_of_model(const ModelWithSampler& model) {
  return with_temporary_file([&](const std::filesystem::path& path) {
    save_model(model.description(), path);
    std::ifstream file(path, std::ios::binary);
    return py::bytes(std::string(std::istreambuf_iterator<char>(file), {}));
  });
}

std::unique_ptr<ModelWithSampler> model_of_bytes(const py::bytes& bytes) {
  return std::make_unique<ModelWithSampler>(
      with_temporary_file([&](const std::filesystem::path& path) {
        std::ofstream(path, std::ios::binary) << std::string_view(bytes);
        return Model::load(path);
      }));
}

void add_file(ModelClass& model_class) {
  model_class
      .def(py::init([](const std::filesystem::path& path) {
             const py::gil_scoped_release release;
             return std::make_unique<ModelWithSampler>(Model::load(path));
           }),
           py::arg("path"))
      .def(
          "save",
          [](const ModelWithSampler& model, const std::filesystem::path& path, bool force) {
            const py::gil_scoped_release release;
            save_model(model.description(), path, force);
          },
          py::arg("path"), py::arg("force") = false,
          "Writes HDF5; an existing file needs force=True.")
      .def(py::pickle(&bytes_of_model, &model_of_bytes));
}

std::string summary_of(const NoiseModel& model) {
  return fmt::format("<malus.Model {}: {}, {}>", model.sensor.empty() ? "unnamed" : model.sensor,
                     model.layout.name(), fmt::join(model_kind_names(model.kinds()), ", "));
}

void add_description(ModelClass& model_class) {
  model_class
      .def(
          "as_dict",
          [](const ModelWithSampler& model) {
            return python_of(app::model_json(model.description()));
          },
          "What `malus model show --json` prints: every parameter with unit and standard error.")
      .def("__repr__",
           [](const ModelWithSampler& model) { return text_of(summary_of(model.description())); })
      .def_property_readonly(
          "sensor",
          [](const ModelWithSampler& model) { return text_of(model.description().sensor); },
          "Name of the sensor.")
      .def_property_readonly(
          "layout", [](const ModelWithSampler& model) { return model.description().layout.name(); },
          "Name of the mosaic layout.")
      .def_property_readonly(
          "channels",
          [](const ModelWithSampler& model) { return model.description().layout.channel_names(); },
          "Names of the channels in the order of packed planes: row by row of the layout's cell.")
      .def_property_readonly(
          "kinds",
          [](const ModelWithSampler& model) {
            return model_kind_names(model.description().kinds());
          },
          "Kinds of noise model that it holds.");
}

}  // namespace

std::optional<Model> model_from(const py::object& given) {
  if (given.is_none()) return std::nullopt;
  if (py::isinstance<ModelWithSampler>(given)) return given.cast<ModelWithSampler&>().model();
  std::filesystem::path path;
  try {
    path = given.cast<std::filesystem::path>();
  } catch (const py::cast_error&) {
    throw py::type_error("model must be a Model, the path of one or a built-in model's name");
  }
  const py::gil_scoped_release release;
  return Model::load(path);
}

void require_model_for(const char* name, bool given, const std::optional<Model>& model) {
  if (given && !model)
    throw InputError(name, "is of a model, and none is given", "give model=, or leave it out");
}

std::vector<std::string> model_complaints(const NoiseModel& model, const GainSetting& gain,
                                          bool undone) {
  std::vector<std::string> lines = complaints_at_gain(model, gain, undone);
  for (std::string& line : lines) line = fmt::format("{}: {}", model.name(), line);
  return lines;
}

std::string untold_gain_line(const NoiseModel& model, const std::vector<GainSetting>& asked) {
  const std::string line = untold_gain_complaint(model, asked);
  return line.empty() ? line : fmt::format("{}: {}", model.name(), line);
}

void bind_model(py::module_& m) {
  bind_noise(m);
  ModelClass model_class(m, "Model",
                         "A noise model: a file that calibrate wrote, or a built-in one by name. "
                         "Throws InputError.");
  add_file(model_class);
  add_drawing(model_class);
  add_description(model_class);
  m.def("models", &builtin_model_names, "Names of the built-in models.");
}

}  // namespace malus::python
