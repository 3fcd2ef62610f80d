// One raw mosaic from a file: TIFF, PNG, BMP, PGM, EXR, FITS, .npy, camera raw (LibRaw) or
// headerless. Pixels are DN exactly as stored: no gamma, no scaling, no black subtraction.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/io/frame_stack.h"
#include "malus/io/raw_format.h"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace malus {

/// What the user or a session says about frames; each wins over the file's own metadata.
struct FrameOptions {
  std::optional<SensorLayout> layout;  ///< else from the file, else mono
  std::vector<double> black_dn;    ///< empty: from the file, by place in the cell where a layout
                                   ///< is declared, else 0; one number, or one per channel
  GainSetting black_gain;          ///< black_dn was measured at; unknown: of any frame
  std::optional<double> white_dn;  ///< else from the file, else assumed_white_dn
  GainSetting gain;                ///< either field set: replaces the file's
  std::optional<double> exposure_s;
  std::optional<int> mean_of;  ///< RawFrame's, from 1 to kMostAveraged; else from the file, else 1
  std::optional<RawFormat> raw_format;  ///< set: the file is headerless, rows and cols are needed
  int rows = 0, cols = 0;               ///< 0 = any; otherwise every file must have this size
};

/// Fills what `options` leaves open from `fallback` (a session's sensor below a command's flags).
FrameOptions merged(const FrameOptions& options, const FrameOptions& fallback);

/// {rows, cols} of "2448x2048" (width first); throws InputError.
std::pair<int, int> parse_frame_size(std::string_view text);

/// A frame and what its file is.
struct FrameInfo {
  RawFrame frame;  ///< dn is empty after probe_frame
  int rows = 0, cols = 0;
  std::string format;      ///< "png", "bmp", "tiff", "openexr", "pgm", "fits", "npy", "camera raw",
                           ///< "mono12p", ...
  std::string camera;      ///< maker and model, where the file tells
  std::string sample;      ///< "uint8", "uint16", "half", "float", ...
  std::string holds;       ///< SaveOptions::holds of the writer; empty where none is kept
  int frames_in_file = 1;  ///< more than 1 of a stack, of which this is one
};

/// path: of a file, or one frame of a stack, stack.tif[3] (frame_stack.h). Throws InputError:
/// missing, empty, a folder, truncated, not a mosaic, a stack of which no frame is named, of an
/// unknown type, too large (2^31 pixels), of another size than asked for, black >= white, a
/// negative black of unsigned integers, of another gain than its black level. NaN and infinite
/// pixels of float files are kept: commands decide. Integer data above 24 bits are refused (not
/// exact in float).
RawFrame load_frame(const std::filesystem::path& path, const FrameOptions& options = {});

/// The same with the facts of the file beside the pixels.
FrameInfo load_frame_info(const std::filesystem::path& path, const FrameOptions& options = {});

/// The same without reading the pixels, where the format allows it. white_dn of a float file
/// without metadata is 0.
FrameInfo probe_frame(const std::filesystem::path& path, const FrameOptions& options = {});

}  // namespace malus
