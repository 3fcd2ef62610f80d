// Noise of a model drawn into arrays.
#pragma once

#include "malus/synthesize/model.h"

#include <cstdint>

#include "arrays.h"

namespace malus::python {

/// Which noise is drawn: Philox's key and counter, and where a mosaic lies on the sensor.
struct Place {
  std::uint64_t seed;
  std::uint32_t frame;
  std::int64_t row0, col0;
};

/// What becomes of the pixels before and after the noise.
struct Pixels {
  Black black;           ///< of integers
  bool rounded = false;  ///< to the camera's codes
};

/// The noisy version of a clean array, in `out` where that is not None. Throws InputError,
/// TypeError, ValueError.
py::object synthesize(const NoiseAtGain& noise, const py::object& clean_object, const Place& place,
                      const Pixels& pixels, const py::object& out);

}  // namespace malus::python
