#include "malus/image/digital_gain.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

namespace malus {
namespace {

constexpr std::int64_t kPixelsPerCode = 10;

struct CodeCount {
  std::int64_t code = 0, pixels = 0;
};

// Of the codes in use, rising.
std::vector<CodeCount> counts_of(const std::vector<float>& pixels_dn, double step_dn) {
  std::vector<std::int64_t> codes;
  for (const float v : pixels_dn)
    if (std::isfinite(v)) codes.push_back(std::llround(double{v} / step_dn));
  std::sort(codes.begin(), codes.end());
  std::vector<CodeCount> counts;
  for (const std::int64_t code : codes) {
    if (counts.empty() || counts.back().code != code) counts.push_back({code, 0});
    ++counts.back().pixels;
  }
  return counts;
}

// Of neighbouring codes, those that hold the most pixels together.
std::span<const CodeCount> densest(const std::vector<CodeCount>& counts) {
  constexpr std::int64_t kCodes = 128;
  std::int64_t within = 0, most = 0;
  std::size_t begin = 0, first = 0, size = 0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    within += counts[i].pixels;
    for (; counts[begin].code <= counts[i].code - kCodes; ++begin) within -= counts[begin].pixels;
    if (within <= most) continue;
    most = within;
    first = begin;
    size = i + 1 - begin;
  }
  return std::span(counts).subspan(first, size);
}

// From the first code to the last that enough pixels have: further out some are not in use by
// chance.
std::span<const CodeCount> well_used(std::span<const CodeCount> counts) {
  while (!counts.empty() && counts.front().pixels < kPixelsPerCode) counts = counts.subspan(1);
  while (!counts.empty() && counts.back().pixels < kPixelsPerCode)
    counts = counts.first(counts.size() - 1);
  return counts;
}

}  // namespace

double digital_gain(const std::vector<float>& pixels_dn, double step_dn) {
  constexpr std::size_t kFewestCodes = 12;
  constexpr double kIrregular = 0.05;
  if (!(step_dn > 0)) return 1.0;
  const std::vector<CodeCount> all = counts_of(pixels_dn, step_dn);
  const std::span<const CodeCount> used = well_used(densest(all));
  if (used.size() < kFewestCodes) return 1.0;
  std::int64_t pixels = 0;
  for (const CodeCount& code : used) pixels += code.pixels;
  if (pixels < kPixelsPerCode * std::ssize(used)) return 1.0;
  const auto codes = static_cast<double>(used.size());
  const double distance = static_cast<double>(used.back().code - used.front().code) / (codes - 1);
  double irregular = 0;
  for (std::size_t i = 1; i < used.size(); ++i)
    irregular += std::abs(static_cast<double>(used[i].code - used[i - 1].code) - distance) >= 1.0;
  return irregular <= kIrregular * codes ? distance : 1.0;
}

}  // namespace malus
