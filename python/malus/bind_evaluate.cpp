// Metrics of pictures and of noise.
#include "malus/evaluate/divergence.h"
#include "malus/evaluate/evaluation.h"
#include "malus/evaluate/noise_comparison.h"

#include <optional>
#include <string>
#include <vector>

#include "arrays.h"
#include "settings.h"
#include <pybind11/stl.h>

namespace malus::python {
namespace {

using Counts = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

py::dict evaluate(const py::object& reference, const py::object& test, const std::string& layout,
                  double peak) {
  const Array first = input_from(reference), second = input_from(test);
  const auto a = view_of(first), b = view_of(second);
  const auto sensor = SensorLayout::named(layout);
  std::optional<Evaluation> result;
  {
    const py::gil_scoped_release release;
    result = evaluate_mosaics(a, b, sensor, peak);
  }
  py::dict out;
  for (const auto& quantity : quantities_of(*result))
    out[quantity.name.c_str()] = quantity.value.at(0);
  return out;
}

std::vector<Image> images_of(const py::object& frames) {
  const Array stack = input_from(frames);
  if (stack.ndim() != 3) throw py::value_error("expected frames as [frame, row, column]");
  std::vector<Image> images;
  for (py::ssize_t i = 0; i < stack.shape(0); ++i)
    images.push_back(image_of(part_of(stack, i).cast<Array>()));
  return images;
}

NoiseFrames frames_of(const std::vector<Image>& images) {
  return {static_cast<int>(images.size()),
          [&images](int i) { return images[static_cast<std::size_t>(i)]; }};
}

py::dict dict_of(const NoiseDistance& d) {
  using namespace py::literals;
  return py::dict("signal_dn"_a = d.signal_dn, "kld"_a = d.kld_nats, "jsd"_a = d.jsd_bits,
                  "sqrt_jsd"_a = d.sqrt_jsd, "sqrt_jsd_floor"_a = d.sqrt_jsd_floor);
}

py::dict compare(const py::object& reference, const py::object& test, const std::string& layout,
                 const py::object& clean, const py::kwargs& kwargs) {
  const auto settings = settings_from<NoiseComparisonSettings>(kwargs);
  const auto first = images_of(reference), second = images_of(test);
  std::optional<Image> scene;
  if (!clean.is_none()) scene = image_of(input_from(clean));
  const auto sensor = SensorLayout::named(layout);
  PythonProgress progress;
  NoiseComparison result;
  {
    const py::gil_scoped_release release;
    result = compare_noise(frames_of(first), frames_of(second), scene, sensor, settings, progress);
  }
  progress.give_warnings();
  py::dict out;
  for (const auto& quantity : quantities_of(result))
    out[quantity.name.c_str()] =
        quantity.value.size() == 1 ? py::cast(quantity.value[0]) : py::cast(quantity.value);
  py::list levels;
  for (const auto& level : result.levels) levels.append(dict_of(level));
  out["levels"] = levels;
  return out;
}

double divergence(const Counts& a, const Counts& b, bool symmetric) {
  if (a.size() != b.size()) throw py::value_error("histograms of different lengths");
  const std::span<const std::int64_t> first(a.data(), static_cast<std::size_t>(a.size())),
      second(b.data(), static_cast<std::size_t>(b.size()));
  const auto result = symmetric ? jsd_bits(first, second) : kld_nats(first, second);
  if (!result) throw py::value_error(result.reason());
  return *result;
}

}  // namespace

void bind_evaluate(py::module_& m) {
  m.def("evaluate", &evaluate, py::arg("reference"), py::arg("test"), py::arg("layout"),
        py::arg("peak"),
        "Metrics of a mosaic [row, column] against its reference, both in DN above black; peak "
        "[DN]: white above black. dict of image_psnr [dB], image_ssim, and for polarized layouts "
        "dolp_psnr [dB], aolp_psnr [dB], aolp_circular [deg].");
  m.def("compare_noise", &compare, py::arg("reference"), py::arg("test"), py::arg("layout"),
        py::arg("clean") = py::none(),
        ("Is the noise of two stacks [frame, row, column] of mosaics, DN above black, the same? "
         "clean: the scene [row, column] that both hold; None for dark or flat frames.\n\n"
         "dict of kld [nat], jsd [bit], sqrt_jsd and its floor for equal distributions, pooled and "
         "per signal level (levels), and of mean, sd, row and column noise [DN] and correlations "
         "of both stacks." +
         settings_help<NoiseComparisonSettings>())
            .c_str());
  m.def(
      "kld_nats", [](const Counts& q, const Counts& p) { return divergence(q, p, false); },
      py::arg("test_q"), py::arg("reference_p"),
      "Kullback-Leibler divergence D(Q||P) [nat] of two histograms: integer counts over the same "
      "bins.");
  m.def(
      "jsd_bits", [](const Counts& a, const Counts& b) { return divergence(a, b, true); },
      py::arg("a"), py::arg("b"),
      "Jensen-Shannon divergence [bit], 0 to 1, of two histograms: integer counts over the same "
      "bins.");
}

}  // namespace malus::python
