#include "malus/image/raw_frame.h"

#include "malus/base/text.h"
#include "malus/image/finite_pixels.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {

std::string GainSetting::text() const {
  if (gain_db) return fmt::format("{:g} dB", *gain_db);
  if (iso) return fmt::format("ISO {:g}", *iso);
  return "unknown gain";
}

std::optional<double> GainSetting::decibel() const {
  if (gain_db) return gain_db;
  if (iso) return 20.0 * std::log10(*iso / 100.0);
  return std::nullopt;
}

GainSetting GainSetting::at_decibel(double db, bool in_iso) {
  GainSetting gain;
  (in_iso ? gain.iso : gain.gain_db) = in_iso ? 100.0 * std::pow(10.0, db / 20.0) : db;
  return gain;
}

bool GainSetting::contradicts(const GainSetting& other) const {
  constexpr double kRoundingDb = 0.172;  // 2 %
  const bool comparable = (gain_db && other.gain_db) || (!gain_db && !other.gain_db);
  const auto own = decibel(), others = other.decibel();
  return comparable && own && others && std::abs(*own - *others) > kRoundingDb;
}

std::string gain_prefix(const std::vector<GainSetting>& gains, const std::string& kind) {
  std::vector<std::string> named;
  for (const GainSetting& gain : gains)
    if (gain.decibel()) named.push_back(gain.text());
  if (!kind.empty()) named.push_back(kind);
  return named.empty() ? "" : joined(named) + ": ";
}

std::optional<double> white_of_bits(int bits) {
  constexpr int kMostBits = 16;
  if (bits <= 0 || bits > kMostBits) return std::nullopt;
  return std::ldexp(1.0, bits) - 1.0;
}

double assumed_white_dn(int bits, View<const float> dn) {
  if (const auto white_dn = white_of_bits(bits)) return *white_dn;
  const double largest_dn = finite_largest(dn);
  if (largest_dn <= kMostCountedDn) return largest_dn;
  double counted_dn = 0;
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c)
      if (dn(r, c) <= kMostCountedDn) counted_dn = std::max(counted_dn, double{dn(r, c)});
  return counted_dn > 0 ? counted_dn : largest_dn;
}

bool white_is_guessed(const RawFrame& frame) {
  return !frame.white_known && !white_of_bits(frame.bits);
}

double white_above_black(double white_dn, const std::vector<double>& black_dn) {
  return white_dn - (black_dn.empty() ? 0.0 : *std::max_element(black_dn.begin(), black_dn.end()));
}

LightRange light_range(const RawFrame& frame) {
  constexpr float kLargest = std::numeric_limits<float>::max();
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  if (!(range_dn > 0)) return {-kLargest, kLargest};
  const double black_dn = frame.black_dn.empty()
                              ? 0.0
                              : *std::min_element(frame.black_dn.begin(), frame.black_dn.end());
  const auto bound = [](double dn) {
    return static_cast<float>(std::clamp(dn, -double{kLargest}, double{kLargest}));
  };
  return {bound(black_dn - kMostWhites * range_dn), bound(frame.white_dn + kMostWhites * range_dn)};
}

void subtract_black(RawFrame& frame) {
  MALUS_REQUIRE(static_cast<int>(frame.black_dn.size()) == frame.layout.channels());
  for (int r = 0; r < frame.dn.rows(); ++r) {
    float* row = frame.dn.row(r);
    for (int c = 0; c < frame.dn.cols(); ++c) row[c] -= static_cast<float>(frame.black_at(r, c));
  }
  frame.white_dn = white_above_black(frame.white_dn, frame.black_dn);
  frame.black_dn.assign(frame.black_dn.size(), 0.0);
}

}  // namespace malus
