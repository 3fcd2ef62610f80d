#include "malus/io/raw_format.h"

#include "malus/base/text.h"

#include <array>

#include <fmt/format.h>

namespace malus {
namespace {

struct Entry {
  RawFormat format;
  const char* name;
  int bits;         ///< significant
  int stored_bits;  ///< per pixel in the file
};

constexpr std::array<Entry, 5> kFormats = {{{RawFormat::kMono8, "mono8", 8, 8},
                                            {RawFormat::kMono10p, "mono10p", 10, 10},
                                            {RawFormat::kMono12p, "mono12p", 12, 12},
                                            {RawFormat::kMono12Packed, "mono12packed", 12, 12},
                                            {RawFormat::kMono16, "mono16", 16, 16}}};

const Entry& entry(RawFormat format) {
  for (const Entry& e : kFormats)
    if (e.format == format) return e;
  MALUS_REQUIRE(false);
}

// Pixel i of a stream of `width`-bit numbers, least significant bit first.
unsigned lsb_first(std::span<const std::uint8_t> bytes, std::size_t i, unsigned width) {
  const std::size_t bit = i * width, byte = bit / 8;
  unsigned word = bytes[byte];
  if (byte + 1 < bytes.size()) word |= static_cast<unsigned>(bytes[byte + 1]) << 8;
  return (word >> (bit % 8)) & ((1u << width) - 1u);
}

// GigE Vision packs a pair as a[11:4], b[3:0] a[3:0], b[11:4].
unsigned gige_packed(std::span<const std::uint8_t> bytes, std::size_t i) {
  const std::size_t pair = i / 2 * 3;
  if (i % 2 == 0) return static_cast<unsigned>(bytes[pair]) << 4 | (bytes[pair + 1] & 0x0fu);
  return static_cast<unsigned>(bytes[pair + 2]) << 4 | (bytes[pair + 1] >> 4);
}

}  // namespace

std::vector<std::string> raw_format_names() {
  std::vector<std::string> names;
  for (const Entry& e : kFormats) names.emplace_back(e.name);
  return names;
}

RawFormat raw_format_named(std::string_view name) {
  for (const Entry& e : kFormats)
    if (name == e.name) return e.format;
  const auto names = raw_format_names();
  throw InputError(fmt::format("raw format \"{}\"", name), "is no known format of headerless files",
                   did_you_mean(name, names) + "known: " + joined(names));
}

std::string_view raw_format_name(RawFormat format) { return entry(format).name; }

int raw_format_bits(RawFormat format) { return entry(format).bits; }

std::size_t raw_format_bytes(RawFormat format, int rows, int cols) {
  MALUS_REQUIRE(rows > 0 && cols > 0);
  const std::size_t bits = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols) *
                           static_cast<std::size_t>(entry(format).stored_bits);
  return (bits + 7) / 8;
}

void decode_raw(RawFormat format, std::span<const std::uint8_t> bytes, View<float> dn) {
  MALUS_REQUIRE(bytes.size() == raw_format_bytes(format, dn.rows(), dn.cols()));
  std::size_t i = 0;
  for (int r = 0; r < dn.rows(); ++r)
    for (float& pixel : dn.row_span(r)) {
      unsigned value = 0;
      switch (format) {
        case RawFormat::kMono8:
          value = bytes[i];
          break;
        case RawFormat::kMono10p:
          value = lsb_first(bytes, i, 10);
          break;
        case RawFormat::kMono12p:
          value = lsb_first(bytes, i, 12);
          break;
        case RawFormat::kMono12Packed:
          value = gige_packed(bytes, i);
          break;
        case RawFormat::kMono16:
          value = bytes[2 * i] | static_cast<unsigned>(bytes[2 * i + 1]) << 8;
          break;
      }
      pixel = static_cast<float>(value);
      ++i;
    }
}

}  // namespace malus
