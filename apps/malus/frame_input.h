// Frames as light: black subtracted, whatever the file holds.
#pragma once

#include "malus/io/frame_file.h"

#include <filesystem>

namespace malus::app {

/// A raw frame minus its black level. Float files hold DN above black already (interface: malus
/// writes them so): there --black moves white alone. white_dn is above black.
RawFrame load_above_black(const std::filesystem::path& path, const FrameOptions& options);

/// A copy of the frame's pixels, black level taken off.
Image above_black(const RawFrame& frame);

/// Says on stderr what a frame was taken for without anybody having stated it, layout and black
/// level, and where its pixels contradict the layout.
void warn_of_guesses(const RawFrame& frame);

}  // namespace malus::app
