// The Python module malus._malus: NumPy in, NumPy out, no algorithms. Arrays are C-contiguous along
// the last axis; anything else is copied once. The GIL is released around every computation.
#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/evaluate/divergence.h"
#include "malus/image/pack.h"
#include "malus/malus.h"

#include <optional>
#include <string>

#include "model_json.h"
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

namespace py = pybind11;

namespace malus::python {
namespace {

using Array = py::array_t<float, py::array::c_style | py::array::forcecast>;

View<const float> view_of(const Array& array) {
  if (array.ndim() != 2) throw py::value_error("expected a 2-D array [row, column]");
  return {{array.data(), static_cast<std::size_t>(array.size())},
          static_cast<int>(array.shape(0)),
          static_cast<int>(array.shape(1)),
          static_cast<std::ptrdiff_t>(array.shape(1))};
}

// An output array must be written in place: no conversion, contiguous rows.
View<float> writable(py::array_t<float>& array) {
  if (array.ndim() != 2 || array.strides(1) != sizeof(float))
    throw py::value_error("out must be a 2-D float32 array with contiguous rows");
  const auto stride =
      static_cast<std::ptrdiff_t>(array.strides(0)) / static_cast<std::ptrdiff_t>(sizeof(float));
  const auto rows = static_cast<int>(array.shape(0)), cols = static_cast<int>(array.shape(1));
  return {{array.mutable_data(), rows ? static_cast<std::size_t>((rows - 1) * stride + cols) : 0},
          rows,
          cols,
          stride};
}

py::array_t<float> array_of(const Image& image) {
  py::array_t<float> out({image.rows(), image.cols()});
  std::copy(image.values().begin(), image.values().end(), out.mutable_data());
  return out;
}

Image image_of(const Array& array) {
  const auto view = view_of(array);
  Image image(view.rows(), view.cols());
  std::copy_n(view.data(), image.size(), image.values().data());
  return image;
}

// JSON results become dictionaries through Python's own parser.
py::object python_of(const nlohmann::ordered_json& json) {
  return py::module_::import("json").attr("loads")(json.dump());
}

// Ctrl-C reaches long work: the signal is looked at between steps.
class PythonProgress final : public Progress {
 public:
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t) override {}
  void warn(std::string_view message) override {
    const py::gil_scoped_acquire gil;
    PyErr_WarnEx(PyExc_UserWarning, std::string(message).c_str(), 1);
  }
  bool stop_requested() const override {
    const py::gil_scoped_acquire gil;
    return PyErr_CheckSignals() != 0;
  }
};

SynthesisSettings synthesis_settings(const py::kwargs& kwargs);

// Fills a settings struct from keyword arguments; an unknown name or a value out of range is a
// ValueError / TypeError.
template <class Settings>
void read_settings(Settings& settings, const py::kwargs& kwargs) {
  std::size_t used = 0;
  Settings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    if (!kwargs.contains(info.name.c_str())) return;
    using Value = std::decay_t<decltype(value)>;
    value = kwargs[info.name.c_str()].template cast<Value>();
    ++used;
    if constexpr (std::is_arithmetic_v<Value> && !std::is_same_v<Value, bool>)
      if (static_cast<double>(value) < info.minimum || static_cast<double>(value) > info.maximum)
        throw py::value_error(info.name + " is outside its range");
    if constexpr (std::is_same_v<Value, std::string>)
      if (!info.choices.empty() &&
          std::find(info.choices.begin(), info.choices.end(), value) == info.choices.end())
        throw py::value_error(info.name + " is not one of its choices");
  });
  if (used != kwargs.size()) throw py::type_error("unknown keyword argument; see help()");
}

SynthesisSettings synthesis_settings(const py::kwargs& kwargs) {
  SynthesisSettings settings;
  read_settings(settings, kwargs);
  return settings;
}

// 2-D: a mosaic. 3-D: packed planes [channel, row, column].
py::array synthesize(const Model& model, const Array& clean, const std::optional<double>& gain,
                     std::uint64_t seed, std::uint32_t frame, std::optional<py::array_t<float>> out,
                     const py::kwargs& kwargs) {
  const auto settings = synthesis_settings(kwargs);
  const auto noise = gain ? model.at_gain(*gain, settings) : model.at_random_gain(settings);
  py::array_t<float> noisy = out ? *out
                                 : py::array_t<float>(std::vector<py::ssize_t>(
                                       clean.shape(), clean.shape() + clean.ndim()));
  if (noisy.ndim() != clean.ndim() ||
      !std::equal(clean.shape(), clean.shape() + clean.ndim(), noisy.shape()))
    throw py::value_error("out has another shape than the clean array");
  if (clean.ndim() == 2) {
    const auto from = view_of(clean);
    const auto to = writable(noisy);
    const py::gil_scoped_release release;
    noise.synthesize(from, to, seed, frame);
  } else if (clean.ndim() == 3) {
    std::vector<View<const float>> from;
    std::vector<View<float>> to;
    for (py::ssize_t k = 0; k < clean.shape(0); ++k) {
      auto clean_plane = py::array(clean[py::int_(k)]).cast<Array>();
      auto noisy_plane = noisy[py::int_(k)].cast<py::array_t<float>>();
      from.push_back(view_of(clean_plane));
      to.push_back(writable(noisy_plane));
    }
    const py::gil_scoped_release release;
    noise.synthesize_packed(from, to, seed, frame);
  } else {
    throw py::value_error(
        "expected [row, column] (a mosaic) or [channel, row, column] (packed planes)");
  }
  return noisy;
}

RawFrame frame_from(const Array& dn, const SensorLayout& layout, double black, double white) {
  RawFrame frame;
  frame.dn = image_of(dn);
  frame.layout = layout;
  frame.black_dn.assign(static_cast<std::size_t>(layout.channels()), black);
  frame.white_dn = white;
  frame.source = "array";
  return frame;
}

py::dict denoise(const Array& dn, const std::string& layout, double black, double white,
                 const std::optional<Model>& model, const std::optional<double>& gain,
                 bool variance, const py::kwargs& kwargs) {
  DenoiseSettings settings;
  read_settings(settings, kwargs);
  RawFrame frame = frame_from(dn, SensorLayout::named(layout), black, white);
  PythonProgress progress;
  NoiseProfile profile;
  Denoised result;
  {
    const py::gil_scoped_release release;
    if (model) {
      profile = model->description().profile_at(gain ? model->gain_setting(*gain) : GainSetting{});
    } else {
      const auto estimated = estimate_profile(frame);
      if (!estimated) throw InputError("noise of the picture", estimated.reason(), "give a model");
      profile = estimated->profile;
    }
    result = denoise_frame(std::move(frame), profile, settings, progress, variance);
  }
  py::dict out;
  out["dn"] = array_of(result.dn_above_black);
  out["variance"] = result.variance_dn2 ? py::object(array_of(*result.variance_dn2)) : py::none();
  out["sigma_used_dn"] = result.sigma_used_dn;
  out["row_noise_removed_dn"] = result.row_noise_removed_dn;
  out["noise_estimated_from_picture"] = profile.estimated_from_picture;
  return out;
}

py::dict stokes(const Array& dn_above_black, const std::string& layout_name) {
  const auto layout = SensorLayout::named(layout_name);
  require_polarized(layout, "array");
  const auto picture =
      merge_greens(stokes_per_color(pack(view_of(dn_above_black), layout), layout), layout);
  const auto stacked = [&](auto&& plane_of) {
    py::list planes;
    for (const auto& s : picture.planes) planes.append(array_of(plane_of(s)));
    return py::module_::import("numpy").attr("stack")(planes);
  };
  py::dict out;
  out["s0"] = stacked([](const StokesPlanes& s) { return s.s0; });
  out["s1"] = stacked([](const StokesPlanes& s) { return s.s1; });
  out["s2"] = stacked([](const StokesPlanes& s) { return s.s2; });
  out["dolp"] = stacked([](const StokesPlanes& s) { return dolp_of(s); });
  out["aolp_deg"] = stacked([](const StokesPlanes& s) { return aolp_deg_of(s); });
  return out;
}

py::dict evaluate(const Array& reference, const Array& test, const std::string& layout,
                  double peak) {
  const auto result =
      evaluate_mosaics(view_of(reference), view_of(test), SensorLayout::named(layout), peak);
  py::dict out;
  for (const auto& quantity : quantities_of(result))
    out[quantity.name.c_str()] = quantity.value.at(0);
  return out;
}

double divergence(const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>& a,
                  const py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>& b,
                  bool symmetric) {
  if (a.size() != b.size()) throw py::value_error("histograms of different lengths");
  const std::span<const std::int64_t> first(a.data(), static_cast<std::size_t>(a.size())),
      second(b.data(), static_cast<std::size_t>(b.size()));
  const auto result = symmetric ? jsd_bits(first, second) : kld_nats(first, second);
  if (!result) throw py::value_error(result.reason());
  return *result;
}

}  // namespace

PYBIND11_MODULE(_malus, m) {
  m.doc() = "Measure a camera's noise, imitate it and remove it";
  static py::exception<InputError> input_error(m, "InputError", PyExc_ValueError);
  py::register_exception_translator([](std::exception_ptr pending) {
    try {
      if (pending) std::rethrow_exception(pending);
    } catch (const InputError& error) {
      input_error(error.what());
    } catch (const Cancelled&) {
      if (!PyErr_Occurred()) PyErr_SetString(PyExc_KeyboardInterrupt, "");
    }
  });

  py::class_<RawFrame>(m, "Frame",
                       "One raw mosaic with its black and white level, gain and exposure.")
      .def_property_readonly(
          "dn", [](const RawFrame& f) { return array_of(f.dn); },
          "float32 [row, column], DN, black included")
      .def_property_readonly("layout", [](const RawFrame& f) { return f.layout.name(); })
      .def_property_readonly("channels", [](const RawFrame& f) { return f.layout.channel_names(); })
      .def_readonly("black_dn", &RawFrame::black_dn)
      .def_readonly("white_dn", &RawFrame::white_dn)
      .def_property_readonly("gain_db", [](const RawFrame& f) { return f.gain.gain_db; })
      .def_property_readonly("iso", [](const RawFrame& f) { return f.gain.iso; })
      .def_readonly("exposure_s", &RawFrame::exposure_s);

  py::class_<Model>(
      m, "Model", "A noise model: a file that `malus calibrate` wrote, or a built-in one by name.")
      .def(py::init([](const std::filesystem::path& path) {
             const py::gil_scoped_release release;
             return Model::load(path);
           }),
           py::arg("path"))
      .def("synthesize", &synthesize, py::arg("clean"), py::arg("gain") = py::none(),
           py::arg("seed") = 0, py::arg("frame") = 0, py::arg("out") = py::none(),
           "Noisy version of clean (DN above black; [row, column] mosaic or [channel, row, column] "
           "packed planes) as float32. gain in "
           "the model's unit (dB or ISO), None draws one per frame. out: float32 array written in "
           "place. Further keywords: kind, "
           "parameters, ratio, amplify, debias, shot, read, row, quantization, bias, exact, "
           "extrapolate_gain.")
      .def(
          "save",
          [](const Model& model, const std::filesystem::path& path, bool force) {
            save_model(model.description(), path, force);
          },
          py::arg("path"), py::arg("force") = false)
      .def(
          "as_dict",
          [](const Model& model) { return python_of(app::model_json(model.description())); },
          "What `malus model show --json` prints.")
      .def_property_readonly("sensor",
                             [](const Model& model) { return model.description().sensor; })
      .def_property_readonly("layout",
                             [](const Model& model) { return model.description().layout.name(); })
      .def_property_readonly(
          "channels", [](const Model& model) { return model.description().layout.channel_names(); })
      .def_property_readonly("kinds",
                             [](const Model& model) { return model.description().kinds(); });

  m.def(
      "load_frame",
      [](const std::filesystem::path& path, const std::optional<std::string>& layout,
         const std::optional<double>& black, const std::optional<double>& white) {
        FrameOptions options;
        if (layout) options.layout = SensorLayout::named(*layout);
        if (black) options.black_dn = {*black};
        options.white_dn = white;
        const py::gil_scoped_release release;
        return load_frame(path, options);
      },
      py::arg("path"), py::arg("layout") = py::none(), py::arg("black") = py::none(),
      py::arg("white") = py::none(),
      "Reads TIFF, PNG, EXR, FITS, .npy or camera raw. Pixels are DN exactly as stored.");
  m.def(
      "calibrate",
      [](const std::filesystem::path& session, const py::kwargs& kwargs) {
        CalibrationSettings settings;
        read_settings(settings, kwargs);
        PythonProgress progress;
        const py::gil_scoped_release release;
        return Model(
            calibrate_physics(calibration_input(load_session(session)), settings, progress));
      },
      py::arg("session"),
      "Session file -> Model. Keywords: saturation_limit, shape, single_frame, maps.");
  m.def("denoise", &denoise, py::arg("dn"), py::kw_only(), py::arg("layout"),
        py::arg("black") = 0.0, py::arg("white"), py::arg("model") = py::none(),
        py::arg("gain") = py::none(), py::arg("variance") = false,
        "Denoises one raw mosaic (DN, black included). Result: dict with dn (float32, DN above "
        "black), variance, sigma_used_dn, "
        "row_noise_removed_dn, noise_estimated_from_picture. Keywords: method, profile, memory, "
        "strength, row_noise.");
  m.def("stokes", &stokes, py::arg("dn_above_black"), py::arg("layout"),
        "dict of s0, s1, s2, dolp, aolp_deg, each float32 [colour, row, column] at one value per "
        "cell.");
  m.def("evaluate", &evaluate, py::arg("reference"), py::arg("test"), py::arg("layout"),
        py::arg("peak"),
        "Metrics of a mosaic against its reference, both DN above black; peak: white above black.");
  m.def(
      "kld_nats",
      [](const py::array_t<std::int64_t>& q, const py::array_t<std::int64_t>& p) {
        return divergence(q, p, false);
      },
      py::arg("test_q"), py::arg("reference_p"), "D(Q||P) of two histograms, natural logarithm.");
  m.def(
      "jsd_bits",
      [](const py::array_t<std::int64_t>& a, const py::array_t<std::int64_t>& b) {
        return divergence(a, b, true);
      },
      py::arg("a"), py::arg("b"), "Jensen-Shannon divergence of two histograms, base 2.");
  m.def("layouts", &SensorLayout::known_names);
  m.def("set_threads", &set_thread_count, py::arg("threads"),
        "0 = all cores; returns the number in force.");
}

}  // namespace malus::python
