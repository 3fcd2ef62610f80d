// Frames that are a part of a calibrated sensor: what the model knows of single pixels, as such a
// frame sees it.
#pragma once

#include "malus/noise/profile.h"

#include <string>

namespace malus {

/// Place on the sensor of a frame's first pixel.
struct SensorPlace {
  int row = 0, col = 0;
};

/// Cuts the profile's defects and maps to a frame of rows x cols pixels whose first pixel lies at
/// `origin`. Throws InputError, naming `source`, where that is not a multiple of the layout's cell
/// and of the row group, and where the frame reaches beyond the sensor.
void cut_to_window(NoiseProfile& profile, SensorPlace origin, int rows, int cols,
                   const std::string& source);

/// That the profile's defects or maps are of a sensor of another size than the frame and are left
/// out, for a warning; empty where nothing is.
std::string left_out_of_window(const NoiseProfile& profile, int rows, int cols);

}  // namespace malus
