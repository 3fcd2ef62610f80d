// Headerless camera buffers: pixel formats of the GenICam Pixel Format Naming Convention 2.4 and of
// GigE Vision 2.0. Pixels follow each other without padding at line ends.
#pragma once

#include "malus/image/view.h"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

enum class RawFormat {
  kMono8,
  kMono10p,      ///< PFNC: 4 pixels in 5 bytes, least significant bits first
  kMono12p,      ///< PFNC: 2 pixels in 3 bytes, least significant bits first
  kMono12Packed  ///< GigE Vision: bytes a[11:4], b[3:0]a[3:0], b[11:4]
  ,
  kMono16  ///< little endian; 10 or 12 bit unpacked data too
};

/// mono8, mono10p, ...; throws InputError that lists the names and the nearest one.
RawFormat raw_format_named(std::string_view name);
std::vector<std::string> raw_format_names();
std::string_view raw_format_name(RawFormat format);
int raw_format_bits(RawFormat format);  ///< 8, 10, 12, 12, 16
/// Bytes of a rows x cols frame, rounded up.
std::size_t raw_format_bytes(RawFormat format, int rows, int cols);
/// Contract: bytes.size() == raw_format_bytes(format, dn.rows(), dn.cols()).
void decode_raw(RawFormat format, std::span<const std::uint8_t> bytes, View<float> dn);

}  // namespace malus
