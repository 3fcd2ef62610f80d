// Frames that are a part of a calibrated sensor: what the model knows of single pixels, as such a
// frame sees it.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <optional>
#include <string>

namespace malus {

/// Place on the sensor of a frame's first pixel.
struct SensorPlace {
  int row = 0, col = 0;
};

/// Throws InputError, naming `source`, where a frame that begins at `origin` does not begin with a
/// whole cell of the layout and a whole row group: its channels and rows would be others than the
/// layout says.
void require_whole_cells(SensorPlace origin, const SensorLayout& layout, int row_group,
                         const std::string& source);

/// Cuts the profile's defects and maps to a frame of rows x cols pixels whose first pixel lies at
/// `origin`. Throws InputError as require_whole_cells, and where the frame reaches beyond the
/// sensor.
void cut_to_window(NoiseProfile& profile, SensorPlace origin, int rows, int cols,
                   const std::string& source);

/// That the profile's defects or maps are of a sensor of another size than the frame and are left
/// out, for a warning; empty where nothing is.
std::string left_out_of_window(const NoiseProfile& profile, int rows, int cols);

/// The profile as this frame sees it: cut to its window where `origin` is known, else as it is, and
/// left_out_of_window is returned. Without fill_defects it has none.
std::string fit_to_sensor(NoiseProfile& profile, const RawFrame& frame,
                          std::optional<SensorPlace> origin, bool fill_defects);

}  // namespace malus
