// Photo cameras' raw files through LibRaw: the visible area of the sensor, values as stored.
#pragma once

#include "malus/io/internal/decoded.h"

#include <filesystem>

namespace malus::internal {

/// Bayer and monochrome sensors; black per channel, white, ISO, exposure and the layout at the
/// visible area's corner come from the file. Throws InputError, also for what is no mosaic (linear
/// DNG, X-Trans, four-colour) and for compression that LibRaw cannot undo.
Decoded read_camera_raw(const std::filesystem::path& path, bool pixels);

}  // namespace malus::internal
