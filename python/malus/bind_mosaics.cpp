// Mosaics as planes and of Stokes parameters, and which of a mosaic's pixels are crossed.
#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/polar/layout_check.h"
#include "malus/polar/stokes.h"
#include "malus/synthesize/scene.h"

#include <iterator>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "array_frame.h"
#include <fmt/format.h>
#include <pybind11/stl.h>

namespace malus::python {
namespace {

constexpr const char* kMosaicLight = "dn_above_black";

py::array mosaic_from_stokes(const py::object& s0, const py::object& s1, const py::object& s2,
                             const std::string& layout_name) {
  const auto layout = SensorLayout::named(layout_name);
  auto planes = images_of(s0, "s0", "colour"), second = images_of(s1, "s1", "colour"),
       third = images_of(s2, "s2", "colour");
  if (planes.size() != 1 && planes.size() != 3)
    throw InputError("s0", fmt::format("has {} colours", planes.size()),
                     "give one, or red, green and blue");
  std::vector<StokesPlanes> stokes;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const auto same_size = [&](const std::vector<Image>& others) {
      return others.size() == planes.size() && others[i].rows() == planes[i].rows() &&
             others[i].cols() == planes[i].cols();
    };
    if (!same_size(second) || !same_size(third))
      throw py::value_error("s0, s1 and s2 have to be of one shape");
    stokes.push_back({std::move(planes[i]), std::move(second[i]), std::move(third[i])});
  }
  std::optional<Image> mosaic;
  {
    const py::gil_scoped_release release;
    mosaic = mosaic_of(stokes, layout);
  }
  return array_of(std::move(*mosaic));
}

// Planes [channel, row, column] in the order of the layout's channels.
py::object packed(const py::object& mosaic_object, const std::string& layout_name) {
  const auto layout = SensorLayout::named(layout_name);
  const Array mosaic = input_from(mosaic_object, "mosaic");
  const auto view = view_of(mosaic, "mosaic");
  require_whole_cell(view, layout, "mosaic");
  Planes planes;
  {
    const py::gil_scoped_release release;
    planes = pack(view, layout);
  }
  return stack_of({std::make_move_iterator(planes.begin()), std::make_move_iterator(planes.end())});
}

py::array unpacked(const py::object& planes_object, const std::string& layout_name) {
  const auto layout = SensorLayout::named(layout_name);
  auto given = images_of(planes_object, "planes", "channel");
  if (std::ssize(given) != layout.channels())
    throw InputError("planes", fmt::format("are {}", given.size()),
                     fmt::format("give one for each of the {} channels of {}", layout.channels(),
                                 layout.name()));
  Planes planes(layout.channels(), 0, 0);
  std::move(given.begin(), given.end(), planes.begin());
  Image mosaic(planes[0].rows() * layout.rows(), planes[0].cols() * layout.cols());
  {
    const py::gil_scoped_release release;
    unpack(planes, layout, mosaic);
  }
  return array_of(std::move(mosaic));
}

py::dict layout_check(const py::object& dn_above_black, const Black& black) {
  const Array mosaic = above_black(dn_above_black, kMosaicLight, {{}, black, {}});
  const auto view = view_of(mosaic, kMosaicLight);
  LayoutCheck check;
  {
    const py::gil_scoped_release release;
    check = check_layout(view);
  }
  using namespace py::literals;
  return py::dict("diagonal"_a = check.diagonal, "row"_a = check.row, "column"_a = check.column,
                  "winner"_a = std::string(pairing_name(check.winner())),
                  "margin"_a = check.margin(), "decided"_a = check.decided());
}

}  // namespace

void bind_mosaics(py::module_& m) {
  m.def("pack", &packed, py::arg("mosaic"), py::arg("layout"),
        "A mosaic [row, column] as planes [channel, row, column], float32, in the order of the "
        "layout's channels. Where it ends inside a cell, the last samples are repeated.");
  m.def("unpack", &unpacked, py::arg("planes"), py::arg("layout"),
        "The mosaic of such planes: whole cells.");
  m.def("mosaic", &mosaic_from_stokes, py::arg("s0"), py::arg("s1"), py::arg("s2"),
        py::arg("layout"),
        "What a sensor's pixels see of Stokes parameters, without noise: the mosaic [row, column], "
        "float32, in the unit of s0. Each [colour, row, column] at one value per pixel, as "
        "stokes(demosaick=...) gives them: red, green and blue, or one.");
  m.def("check_layout", &layout_check, py::arg("dn_above_black"), py::kw_only(),
        py::arg("black") = py::none(),
        "Which pixels of a polarization mosaic [row, column] in DN above black hold crossed "
        "polarizers, by Malus's law (as `malus info` tells): dict of the mismatch of the pairings "
        "diagonal, row and column [1], the winner (of the least), its margin, and whether they "
        "decide: an unpolarized scene does not. black: the one level that integers hold, and "
        "floats where it is given.");
}

}  // namespace malus::python
