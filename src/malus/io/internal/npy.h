// NumPy's .npy, format versions 1 to 3 (numpy.lib.format): bool, integers, half, float, double, of
// either byte order, C or Fortran order.
#pragma once

#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace malus::internal {

struct NpyHeader {
  char kind = 0;  ///< b, u, i, f
  int item_bytes = 0;
  bool big_endian = false, fortran_order = false;
  std::vector<std::int64_t> shape;
  std::size_t data_offset = 0;
};

/// Throws InputError; path is for messages.
NpyHeader parse_npy_header(Bytes bytes, const std::filesystem::path& path);
/// Three axes: of pictures that anybody made, as picture_file.h says; or what malus wrote.
enum class NpyAxes { kOfPictures, kChannelsFirst };
/// 2-D or 3-D. Integers beyond 2^24 are refused.
Decoded parse_npy(Bytes bytes, const std::filesystem::path& path,
                  NpyAxes order = NpyAxes::kOfPictures);

/// Whether a file begins as one does.
bool begins_as_npy(Bytes head);

/// How many frames the file holds, as frame_stack.h says. Reads its header, and throws InputError
/// where the file's size contradicts it.
int npy_frames(const std::filesystem::path& path);

/// The file, or its header alone; with `frame` that frame alone, of which no other's pixels are
/// read. Contract: frame is below npy_frames.
Decoded read_npy(const std::filesystem::path& path, bool pixels,
                 std::optional<int> frame = std::nullopt);

enum class NpySample { kUint8, kUint16, kFloat };
/// 2-D for one plane, else [channel, row, column]; integers by stored_value. Contract: at least one
/// plane.
std::string npy_content(std::span<const Image> planes, NpySample sample);

}  // namespace malus::internal
