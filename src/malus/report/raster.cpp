#include "malus/report/internal/raster.h"

#include "malus/base/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <zlib.h>

namespace malus {
namespace {

constexpr std::int32_t kLargestCode = 1'048'575;
constexpr int kDeflateLevel = 6;

// What the earlier neighbours let expect, from their values in 1/256 of a step with the dither
// taken off; `at` is the pixel's place among them.
std::int32_t expected_256(const std::int32_t* at, int row, int col, int cols) {
  if (row == 0) return col == 0 ? 0 : at[-1];
  const std::int32_t* north = at - cols;
  if (col == 0 || col == cols - 1) return *north;
  return (at[-1] + north[-1] + north[0] + north[1]) >> 2;
}

// The code nearest to a value in 1/256 of a step.
std::int32_t code_of_256(std::int32_t value, std::int32_t dither) {
  return (value + dither + 128) >> 8;
}

void append_integer(std::string& bytes, std::int32_t value) {
  auto zigzag =
      (static_cast<std::uint32_t>(value) << 1) ^ static_cast<std::uint32_t>(value < 0 ? -1 : 0);
  while (zigzag > 127) {
    bytes.push_back(static_cast<char>((zigzag & 127) | 128));
    zigzag >>= 7;
  }
  bytes.push_back(static_cast<char>(zigzag));
}

std::string deflated_with(const std::string& bytes, int strategy) {
  z_stream stream = {};
  constexpr int kWindowBits = 15, kMemory = 9;
  MALUS_REQUIRE(deflateInit2(&stream, kDeflateLevel, Z_DEFLATED, kWindowBits, kMemory, strategy) ==
                Z_OK);
  std::string out(deflateBound(&stream, static_cast<uLong>(bytes.size())), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  stream.avail_in = static_cast<uInt>(bytes.size());
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  const int status = deflate(&stream, Z_FINISH);
  out.resize(stream.total_out);
  deflateEnd(&stream);
  MALUS_REQUIRE(status == Z_STREAM_END);
  return out;
}

// In noise the matches that deflate finds are accidents that cost more than they save; in a smooth
// picture's runs they pay.
std::string deflated(const std::string& bytes) {
  std::string plain = deflated_with(bytes, Z_HUFFMAN_ONLY);
  std::string matched = deflated_with(bytes, Z_FILTERED);
  return matched.size() < plain.size() ? matched : plain;
}

}  // namespace

std::int32_t dither_256(const RasterPlace& place) {
  // Channels must not share their dither: differences of channels are what AoLP is made of.
  std::uint32_t mixed = 0x9e3779b1U * static_cast<std::uint32_t>(place.row) +
                        0x85ebca6bU * static_cast<std::uint32_t>(place.col) +
                        0xc2b2ae35U * static_cast<std::uint32_t>(place.channel);
  mixed = (mixed ^ (mixed >> 15)) * 0x2c1b3c6dU;
  mixed ^= mixed >> 13;
  return static_cast<std::int32_t>(mixed & 255U) - 128;
}

std::int32_t raster_code(double value, const RasterScale& scale, std::int32_t dither) {
  MALUS_REQUIRE(scale.slope >= 0 && scale.offset > 0 && scale.step > 0);
  if (!std::isfinite(value)) return kNoValueCode;
  const double root = std::sqrt(scale.offset);
  const double t = value < 0 || scale.slope == 0
                       ? value / root
                       : 2 / scale.slope * (std::sqrt(scale.slope * value + scale.offset) - root);
  const double code =
      std::clamp(t / scale.step + dither / 256.0, -double{kLargestCode}, double{kLargestCode});
  return static_cast<std::int32_t>(std::lround(code));
}

std::string encode_raster(const Planes& planes, std::span<const RasterScale> scales,
                          bool dithered) {
  MALUS_REQUIRE(static_cast<int>(scales.size()) == planes.channels());
  std::string bytes;
  std::vector<std::int32_t> placed;
  for (int channel = 0; channel < planes.channels(); ++channel) {
    const Image& plane = planes[channel];
    const RasterScale& scale = scales[static_cast<std::size_t>(channel)];
    placed.resize(plane.size());
    std::int32_t* at = placed.data();
    for (int r = 0; r < plane.rows(); ++r)
      for (int c = 0; c < plane.cols(); ++c, ++at) {
        const std::int32_t dither = dithered ? dither_256({channel, r, c}) : 0;
        const std::int32_t code = raster_code(static_cast<double>(plane(r, c)), scale, dither);
        append_integer(bytes, code - code_of_256(expected_256(at, r, c, plane.cols()), dither));
        *at = 256 * code - dither;
      }
  }
  return deflated(bytes);
}

std::string base64(std::string_view bytes) {
  static constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (k < count ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      out.push_back(k <= count ? kDigits[group >> (18 - 6 * k) & 63] : '=');
  }
  return out;
}

}  // namespace malus
