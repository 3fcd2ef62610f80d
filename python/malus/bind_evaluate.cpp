// Metrics of pictures and of noise.
#include "malus/base/error.h"
#include "malus/evaluate/divergence.h"
#include "malus/evaluate/evaluation.h"
#include "malus/evaluate/noise_cautions.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/image/pack.h"

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "array_frame.h"
#include "arrays.h"
#include "settings.h"
#include <fmt/format.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

// Nobody tells the black level of integers here: they are taken as they are.
void warn_of_codes(const py::object& reference, const py::object& test, bool black_matters) {
  const bool first = holds_codes(numbers_from(reference, "reference")),
             second = holds_codes(numbers_from(test, "test"));
  if (first != second)
    give_warning(fmt::format(
        "{}: holds integers, which are taken as DN above black like the floats beside them; "
        "subtract their black level if they hold one",
        first ? "reference" : "test"));
  else if (first && black_matters)
    give_warning(
        "reference and test hold integers, which are taken as DN above black; DoLP is too low if "
        "they hold a black level: subtract it");
}

py::dict evaluate(const py::object& reference, const py::object& test, const std::string& layout,
                  double peak) {
  const Array first = input_from(reference, "reference"), second = input_from(test, "test");
  const auto a = view_of(first, "reference"), b = view_of(second, "test");
  if (a.rows() != b.rows() || a.cols() != b.cols())
    throw InputError("test",
                     fmt::format("has {} rows and {} columns, the reference {} and {}", b.rows(),
                                 b.cols(), a.rows(), a.cols()),
                     "compare pictures of one size");
  if (!(peak > 0 && std::isfinite(peak)))
    throw InputError("peak", fmt::format("is {:g} DN", peak), "give a finite number above 0");
  const auto sensor = SensorLayout::named(layout);
  require_whole_cell(a, sensor, "reference");
  warn_of_codes(reference, test, sensor.polarized());
  std::optional<Evaluation> result;
  {
    const py::gil_scoped_release release;
    result = evaluate_mosaics(a, b, sensor, peak);
  }
  py::dict out;
  for (const auto& quantity : quantities_of(*result))
    out[quantity.name.c_str()] = quantity.value.at(0);
  out["pixels_left_out"] = result->pixels_left_out;
  return out;
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
  const auto first = images_of(reference, "reference", "frame"),
             second = images_of(test, "test", "frame");
  std::optional<Image> scene;
  if (!clean.is_none()) scene = image_of(input_from(clean, "clean"), "clean");
  const auto sensor = SensorLayout::named(layout);
  warn_of_codes(reference, test, false);
  PythonProgress progress;
  NoiseComparison result;
  {
    const py::gil_scoped_release release;
    result = compare_noise(frames_of(first), frames_of(second), scene, sensor, settings, progress);
  }
  progress.give_warnings();
  for (const std::string& line : cautions_of(result, settings)) give_warning(line);
  py::dict out;
  for (const auto& quantity : quantities_of(result))
    out[quantity.name.c_str()] =
        quantity.value.size() == 1 ? py::cast(quantity.value[0]) : py::cast(quantity.value);
  py::list levels;
  for (const auto& level : result.levels) levels.append(dict_of(level));
  out["levels"] = levels;
  return out;
}

struct Histogram {
  py::object counts;
  const char* name;  ///< of the argument
};

// Any type of number is read as double, in which the divergences are computed (np.histogram with
// weights gives counts as floats). The library adds counts up as 64-bit integers.
std::vector<std::int64_t> counts_of(const Histogram& histogram) {
  using Doubles = py::array_t<double, py::array::c_style | py::array::forcecast |
                                          py::detail::npy_api::NPY_ARRAY_ALIGNED_>;
  const auto values = converted<Doubles>(histogram.counts, histogram.name);
  constexpr double kLimit = 0x1p63;
  std::vector<std::int64_t> counts;
  std::int64_t sum = 0;
  for (const double value : std::span(values.data(), static_cast<std::size_t>(values.size()))) {
    if (!(value >= 0 && value == std::floor(value) && std::isfinite(value)))
      throw InputError(histogram.name, fmt::format("bin {} holds {}", counts.size(), value),
                       "give counts of samples: whole numbers, 0 or more");
    if (value >= kLimit ||
        static_cast<std::int64_t>(value) > std::numeric_limits<std::int64_t>::max() - sum)
      throw InputError(histogram.name, "holds 2^63 samples or more", "scale its counts down");
    counts.push_back(static_cast<std::int64_t>(value));
    sum += counts.back();
  }
  return counts;
}

double divergence(const Histogram& a, const Histogram& b, bool symmetric) {
  const auto first = counts_of(a), second = counts_of(b);
  if (first.size() != second.size()) throw py::value_error("histograms of different lengths");
  const auto result = symmetric ? jsd_bits(first, second) : kld_nats(first, second);
  if (!result) throw py::value_error(result.reason());
  return *result;
}

}  // namespace

void bind_evaluate(py::module_& m) {
  m.def(
      "evaluate", &evaluate, py::arg("reference"), py::arg("test"), py::arg("layout"),
      py::arg("peak"),
      "Metrics of a mosaic [row, column] against its reference, both in DN above black; peak "
      "[DN]: white above black. dict of image_psnr [dB], image_ssim, and for polarized layouts "
      "dolp_psnr [dB], aolp_psnr [dB], aolp_circular [deg], without those that too few pixels are "
      "left for; and pixels_left_out, those that are not finite in one of the pictures.");
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
      "kld_nats",
      [](const py::object& q, const py::object& p) {
        return divergence({q, "test_q"}, {p, "reference_p"}, false);
      },
      py::arg("test_q"), py::arg("reference_p"),
      "Kullback-Leibler divergence D(Q||P) [nat] of two histograms: integer counts over the same "
      "bins.");
  m.def(
      "jsd_bits",
      [](const py::object& a, const py::object& b) {
        return divergence({a, "a"}, {b, "b"}, true);
      },
      py::arg("a"), py::arg("b"),
      "Jensen-Shannon divergence [bit], 0 to 1, of two histograms: integer counts over the same "
      "bins.");
}

}  // namespace malus::python
