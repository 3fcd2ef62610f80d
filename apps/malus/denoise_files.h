// The files that `malus denoise` writes for one frame.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/image/raw_frame.h"
#include "malus/neural/network_target.h"
#include "malus/noise/model.h"

#include <filesystem>
#include <string>
#include <vector>

namespace malus::app {

/// Empty: not wanted.
struct OutputNames {
  std::filesystem::path mosaic, record, integers, planes, variance;
  std::filesystem::path picture;  ///< alone, of networks that give pictures
  /// What an earlier run left beside them. It goes before they are written: wherever this run is
  /// stopped, and whatever it does not write again, would look like a part of the new result.
  std::vector<std::filesystem::path> stale;
};

/// Throws InputError for a frame that integers of 16 bits (names.integers) cannot hold: white above
/// their range, black below it, or float pixels on a scale so small that rounding takes more than
/// the noise does. frame: its pixels are not asked for. remedy: how to do without integers.
void check_integers(const RawFrame& frame, const NoiseProfile& profile, const std::string& remedy);

/// The same for frames as the model's camera would write them at `gain`; the remedy is --float. The
/// error names the model's file.
void check_integers_of_camera(const NoiseModel& model, const std::filesystem::path& file,
                              const GainSetting& gain, GainRange range);

/// The denoised mosaic and what else names asks for; returns the files. result's pixels exist once:
/// they move into the file's frame and back. profile: its bias is missing from saturated pixels,
/// and so from white, which the files tell where header knows it. Throws InputError.
std::vector<std::string> write_outputs(const RawFrame& header, const NoiseProfile& profile,
                                       Denoised& result, const OutputNames& names, bool force);

/// A network's picture (kRgb or kSrgb): displayed values as 16 bit where the file holds
/// integers, else float. Throws InputError.
void save_result_picture(const std::filesystem::path& path, Planes picture, NetworkTarget target,
                         bool force);

}  // namespace malus::app
