// links: malus_io
#include "malus/io/raw_format.h"

#include <vector>

#include "target.h"

// The first three bytes choose format and size; the rest are pixels, cut or repeated to the length
// that the frame needs, as the reader's length check leaves only such.
void parse_bytes(std::span<const std::uint8_t> data) {
  if (data.size() < 4) return;
  const auto names = malus::raw_format_names();
  const malus::RawFormat format = malus::raw_format_named(names[data[0] % names.size()]);
  const int rows = 1 + data[1] % 16, cols = 1 + data[2] % 16;
  std::vector<std::uint8_t> bytes(malus::raw_format_bytes(format, rows, cols));
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = data[3 + i % (data.size() - 3)];
  malus::Image image(rows, cols);
  malus::decode_raw(format, bytes, image);
}
