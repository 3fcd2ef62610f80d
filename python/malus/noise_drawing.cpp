#include "noise_drawing.h"

#include "malus/base/error.h"
#include "malus/base/frame_numbers.h"
#include "malus/base/statistics.h"
#include "malus/image/black_levels.h"
#include "malus/image/pack.h"
#include "malus/synthesize/exact.h"
#include "malus/synthesize/light_scale.h"

#include <algorithm>
#include <string>
#include <vector>

#include "array_frame.h"

namespace malus::python {
namespace {

struct Planes3D {
  std::vector<py::array> keep_alive;
  std::vector<View<const float>> clean;
  std::vector<View<float>> noisy;
};

// [channel, row, column] as views of its planes.
Planes3D planes_of(const py::array& clean, const py::array& noisy) {
  Planes3D planes;
  for (py::ssize_t k = 0; k < clean.shape(0); ++k) {
    const auto from = part_of(clean, k).cast<Array>();
    auto to = part_of(noisy, k);
    planes.clean.push_back(view_of(from, "clean"));
    planes.noisy.push_back(writable_view_of(to));
    planes.keep_alive.push_back(from);
    planes.keep_alive.push_back(to);
  }
  return planes;
}

LevelCoverage draw_packed(const NoiseAtGain& noise, const py::array& clean, const py::array& noisy,
                          const Place& place) {
  const auto planes = planes_of(clean, noisy);
  const py::gil_scoped_release release;
  return noise.synthesize_packed(planes.clean, planes.noisy, place.seed, place.frame);
}

// By way of the mosaic, as the camera has it.
LevelCoverage draw_rounded(const NoiseAtGain& noise, const py::array& clean, const py::array& noisy,
                           const Place& place) {
  const auto planes = planes_of(clean, noisy);
  const SensorLayout& layout = noise.model().layout;
  noise.require_planes(planes.clean, planes.noisy);
  const py::gil_scoped_release release;
  Planes packed(layout.channels(), planes.clean[0].rows(), planes.clean[0].cols());
  for (int k = 0; k < layout.channels(); ++k)
    for (int r = 0; r < packed.rows(); ++r)
      std::copy_n(planes.clean[static_cast<std::size_t>(k)].row(r), packed.cols(),
                  packed[k].row(r));
  Image mosaic(packed.rows() * layout.rows(), packed.cols() * layout.cols());
  unpack(packed, layout, mosaic);
  FrameParameters drawn;
  const RawFrame raw = noise.synthesize_raw(mosaic, place.seed, place.frame, 0, 0, &drawn);
  const Planes codes = pack(raw.dn, layout);
  for (int k = 0; k < layout.channels(); ++k)
    for (int r = 0; r < codes.rows(); ++r)
      std::copy_n(codes[k].row(r), codes.cols(), planes.noisy[static_cast<std::size_t>(k)].row(r));
  return drawn.coverage;
}

LevelCoverage draw_mosaic(const NoiseAtGain& noise, const Array& clean, py::array& noisy,
                          const Place& place, bool rounded) {
  const auto from = view_of(clean, "clean");
  const auto to = writable_view_of(noisy);
  const int row0 = require_place("row0", place.row0, from.rows());
  const int col0 = require_place("col0", place.col0, from.cols());
  const py::gil_scoped_release release;
  if (!rounded) return noise.synthesize(from, to, place.seed, place.frame, row0, col0);
  FrameParameters drawn;
  const RawFrame raw = noise.synthesize_raw(from, place.seed, place.frame, row0, col0, &drawn);
  for (int r = 0; r < to.rows(); ++r) std::copy_n(raw.dn.row(r), to.cols(), to.row(r));
  return drawn.coverage;
}

LevelCoverage draw_batch(const NoiseAtGain& noise, const py::array& clean, const py::array& noisy,
                         Place place, bool rounded) {
  require_numbers_left("frame", place.frame, clean.shape(0));
  LevelCoverage coverage;
  for (py::ssize_t i = 0; i < clean.shape(0); ++i, ++place.frame)
    coverage.add(
        (rounded ? draw_rounded : draw_packed)(noise, part_of(clean, i), part_of(noisy, i), place));
  return coverage;
}

// As the program takes files of clean mosaics: integers hold a black level, which is told.
Array clean_from(const py::array& numbers, const NoiseAtGain& noise, const Place& place,
                 const Black& black) {
  if (!holds_codes(numbers)) {
    if (black && mean_of(levels_of(black)) != 0)
      give_warning("clean: float pixels are DN above black; black= is not subtracted");
    return input_from(numbers, "clean");
  }
  if (!black)
    throw InputError("clean", "holds integers, but their black level is not known",
                     "give black= (0 where black is subtracted already)");
  const SensorLayout& layout = noise.model().layout;
  const std::vector<double> levels = black_per_channel(levels_of(black), layout, "black");
  Array clean = input_from(numbers, "clean");  // a copy: the elements are none of float
  const auto rows = clean.shape(clean.ndim() - 2), cols = clean.shape(clean.ndim() - 1);
  const bool mosaic = clean.ndim() == 2;
  const int row0 = mosaic ? require_place("row0", place.row0, static_cast<int>(rows)) : 0;
  const int col0 = mosaic ? require_place("col0", place.col0, static_cast<int>(cols)) : 0;
  float* value = clean.mutable_data();
  const auto planes = rows * cols > 0 ? clean.size() / (rows * cols) : 0;
  for (py::ssize_t k = 0; k < planes; ++k)
    for (py::ssize_t r = 0; r < rows; ++r)
      for (py::ssize_t c = 0; c < cols; ++c) {
        const auto channel =
            mosaic ? layout.channel_at(row0 + static_cast<int>(r), col0 + static_cast<int>(c))
                   : static_cast<int>(k % layout.channels());
        *value++ -= static_cast<float>(levels[static_cast<std::size_t>(channel)]);
      }
  return clean;
}

// In whatever order the pixels are.
void warn_of_scale(const Array& clean, const NoiseModel& model) {
  if (clean.size() == 0) return;
  const auto cols = clean.shape(clean.ndim() - 1);
  const View<const float> light({clean.data(), static_cast<std::size_t>(clean.size())},
                                static_cast<int>(clean.size() / cols), static_cast<int>(cols),
                                cols);
  const std::string line = light_scale_complaint(light, white_of_light_dn(model));
  if (!line.empty()) give_warning("clean: " + line);
}

}  // namespace

py::object synthesize(const NoiseAtGain& noise, const py::object& clean_object, const Place& place,
                      const Pixels& pixels, const py::object& out) {
  const py::array numbers = numbers_from(clean_object, "clean");
  const auto dimensions = numbers.ndim();
  if (pixels.rounded && (noise.settings().amplify || noise.settings().debias))
    throw InputError("rounded", "an array cannot tell the black level that amplify and debias move",
                     "leave them out, or round by yourself");
  if (dimensions < 2 || dimensions > 4)
    throw py::value_error(
        "clean has to be [row, column] (a mosaic), [channel, row, column] (packed planes) or "
        "[frame, channel, row, column] (a batch of packed planes)");
  if (dimensions > 2 && (place.row0 != 0 || place.col0 != 0))
    throw py::value_error("row0 and col0 place a mosaic; packed planes are whole frames");
  const Array clean = clean_from(numbers, noise, place, pixels.black);
  warn_of_scale(clean, noise.model());  // now: out may be clean
  const std::vector<py::ssize_t> shape(clean.shape(), clean.shape() + dimensions);
  py::array noisy = out.is_none() ? py::array(py::array_t<float>(shape)) : output_from(out);
  if (noisy.ndim() != dimensions || !std::equal(shape.begin(), shape.end(), noisy.shape()))
    throw py::value_error("out has another shape than the clean array");
  if (!out.is_none()) require_apart_or_same(clean, noisy);
  const LevelCoverage coverage =
      dimensions == 2   ? draw_mosaic(noise, clean, noisy, place, pixels.rounded)
      : dimensions == 4 ? draw_batch(noise, clean, noisy, place, pixels.rounded)
      : pixels.rounded  ? draw_rounded(noise, clean, noisy, place)
                        : draw_packed(noise, clean, noisy, place);
  if (const std::string complaint = coverage.complaint(); !complaint.empty())
    give_warning(complaint);
  return out.is_none() ? py::object(noisy) : out;
}

}  // namespace malus::python
