// Pictures inside a report: planes of integer codes, predicted, packed and deflated.
//
// code -> value: t = (code - d) * step; value = t sqrt(offset) where t < 0 or slope = 0, else
// ((t slope/2 + sqrt(offset))² - offset) / slope: the inverse of f(s) = integral of ds/sigma(s) for
// the variance line slope s + offset, so that a step is the same part of the noise's standard
// deviation everywhere. slope 0, offset 1 and no dither make code * step the value.
// d is subtractive dither (Schuchman, IEEE Trans. Commun. 12, 1964): without it coarse steps would
// leave whole angles empty in a histogram of AoLP. d * 256 is an integer given by channel, row,
// column. code -> bytes: difference from what the west, north-west, north and north-east neighbours
// let expect (first row: west; first and last column: north), zigzag, seven bits a byte with the
// low ones first, zlib.
#pragma once

#include "malus/image/view.h"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace malus {

struct RasterScale {
  double slope = 0, offset = 1, step = 1;
};

/// The code of a pixel without a value (not finite).
inline constexpr std::int32_t kNoValueCode = -1'048'576;

/// A pixel's place, for its dither.
struct RasterPlace {
  int channel = 0, row = 0, col = 0;
};
/// 256 times the dither of a place, in [-128, 127].
std::int32_t dither_256(const RasterPlace& place);

/// Nearest code, within ±1,048,575. NaN and infinities give kNoValueCode. Contract: slope >= 0,
/// offset > 0, step > 0.
std::int32_t raster_code(double value, const RasterScale& scale, std::int32_t dither = 0);

/// The bytes of planes of one size. Contract: one scale per plane.
std::string encode_raster(const Planes& planes, std::span<const RasterScale> scales, bool dithered);

std::string base64(std::string_view bytes);

}  // namespace malus
