// Pictures and planes to and from files; the ending chooses the format: .tif .tiff .png .exr .fits
// .fit .npy. Every file appears whole or not at all (base/atomic_file.h).
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/view.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// Any number of named channels, values as stored (integers unscaled).
struct Picture {
  Planes planes;                   ///< [channel, row, column]
  std::vector<std::string> names;  ///< one per channel: "R", "G", "B", "Y", "R90", ...
  double white = 0;                ///< white_of_picture
  int bits = 0;                    ///< of integer data; 0 for float
  std::string holds;               ///< SaveOptions::holds of the writer; empty where none is kept
};

/// The bits that whole numbers of a NumPy type fill: less the sign, at most the 24 that float
/// holds; 1 of bool (kind b), 0 of floats (f).
int bits_of_numbers(char kind, int item_bytes);

/// What the picture shows as white: the largest number of this many bits, 1 of floats. Of types
/// that no camera fills (white_of_bits) the largest number that there is.
double white_of_picture(int bits, const Planes& planes);

/// Throws InputError naming the source where that is a guess: how bright such a picture is, is not
/// known.
void require_known_white(const std::filesystem::path& source, int bits);

/// Throws InputError naming the source unless float holds the whole number exactly.
void require_exact(const std::filesystem::path& source, double whole);

/// Index of the plane that is coverage, not colour. Planes of .npy and FITS have no names, and a
/// fourth one may be anything.
std::optional<std::size_t> alpha_plane(const std::filesystem::path& path, const Picture& picture);

/// Throws InputError as load_frame does. .npy: 2-D, or 3-D as [channel, row, column]; a last axis
/// of at most 4 with a longer first axis is taken as [row, column, channel]. FITS: 2-D or
/// [channel, row, column].
Picture load_picture(const std::filesystem::path& path);

/// load_picture for scenes that noise is added to, from JPEG too (8 bit sRGB, grey or colour, rows
/// and columns as stored). What a sensor measured is never read from JPEG: its loss would pass for
/// noise or signal.
Picture load_clean_picture(const std::filesystem::path& path);

enum class SampleType { kUint8, kUint16, kHalf, kFloat };

struct SaveOptions {
  bool force = false;
  /// Integers: values are rounded to nearest (ties to even) and held to the type's range, NaN
  /// becomes 0. Unset: float, but 16 bit for .png. Half exists in .exr only; PNG holds no float.
  std::optional<SampleType> type;
  /// What the values are where channels and layout do not tell: one word, kept in the file's
  /// description (all endings but .npy).
  std::string holds{};
};

/// The word for variances [DN^2].
inline constexpr const char* kHoldsVariance = "variance";
/// The word for a mosaic that the noise was taken out of.
inline constexpr const char* kHoldsDenoised = "denoised";

/// Whether save_picture knows the ending, in any case of letters.
bool has_picture_ending(const std::filesystem::path& path);

/// What save_picture would say of the ending, before the work: throws InputError where it is
/// unknown or its files cannot hold the type.
void require_ending_for(const std::filesystem::path& path, SampleType type);

/// names: one per channel, or empty for Y / RGB / RGBA / C00, C01, ... Throws InputError when the
/// ending is unknown or cannot hold the type or the number of channels (PNG: 1 to 4).
void save_picture(const std::filesystem::path& path, const Planes& planes,
                  const std::vector<std::string>& names, const SaveOptions& options = {});
void save_picture(const std::filesystem::path& path, const Image& image,
                  const SaveOptions& options = {});

/// A mosaic with layout, black, white, gain and exposure in its description, so that load_frame
/// gets them back (all endings but .npy).
void save_frame(const std::filesystem::path& path, const RawFrame& frame,
                const SaveOptions& options = {});

}  // namespace malus
