#include "malus/io/internal/fits.h"
#include "malus/io/internal/stored_value.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include <fmt/format.h>

namespace malus::internal {
namespace {

template <class T>
void append_big_endian(std::string& out, T value) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if constexpr (std::endian::native == std::endian::little) std::reverse(raw, raw + sizeof(T));
  out.append(raw, sizeof(T));
}

// As the standard has it (section 4.2.4).
std::string upper_exponent(double value) {
  std::string text = fmt::format("{}", value);
  std::replace(text.begin(), text.end(), 'e', 'E');
  return text;
}

void pad_block(std::string& out, char fill) {
  out.append((kFitsBlock - out.size() % kFitsBlock) % kFitsBlock, fill);
}

}  // namespace

std::string fits_content(std::span<const Image> planes, FitsSample sample,
                         const std::string& description, std::optional<double> exposure_s) {
  std::string out;
  const auto card = [&](std::string text) {
    text.resize(kFitsCard, ' ');
    out += text;
  };
  const int bitpix = sample == FitsSample::kUint8 ? 8 : sample == FitsSample::kUint16 ? 16 : -32;
  card("SIMPLE  =                    T");
  card(fmt::format("BITPIX  = {:>20}", bitpix));
  card(fmt::format("NAXIS   = {:>20}", planes.size() == 1 ? 2 : 3));
  card(fmt::format("NAXIS1  = {:>20}", planes[0].cols()));
  card(fmt::format("NAXIS2  = {:>20}", planes[0].rows()));
  if (planes.size() > 1) card(fmt::format("NAXIS3  = {:>20}", planes.size()));
  if (bitpix == 16) card(fmt::format("BZERO   = {:>20}", 32768));
  card("ROWORDER= 'TOP-DOWN'");
  if (exposure_s) card(fmt::format("EXPTIME = {:>20}", upper_exponent(*exposure_s)));
  for (std::size_t at = 0; at < description.size(); at += kFitsCard - 8)
    card("COMMENT " + description.substr(at, kFitsCard - 8));
  card("END");
  pad_block(out, ' ');
  for (const Image& plane : planes)
    for (const float value : plane.values()) {
      if (sample == FitsSample::kUint8)
        out += static_cast<char>(stored_value<std::uint8_t>(value));
      else if (sample == FitsSample::kUint16)
        append_big_endian(out,
                          static_cast<std::int16_t>(stored_value<std::uint16_t>(value) - 32768));
      else
        append_big_endian(out, value);
    }
  pad_block(out, '\0');
  return out;
}

}  // namespace malus::internal
