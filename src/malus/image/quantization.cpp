#include "malus/image/quantization.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

namespace malus {

double quantization_step(View<const float> dn) {
  constexpr float kLargest = 4294967296.0F;  // that an integer file holds
  if (dn.rows() == 0 || dn.cols() == 0) return 0.0;
  std::int64_t step = 0;
  const float origin = dn(0, 0);
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const float difference = dn(r, c) - origin;
      if (!(std::abs(dn(r, c)) <= kLargest)) return 0.0;  // NaN too
      if (difference != std::floor(difference) || dn(r, c) != std::floor(dn(r, c))) return 0.0;
      step = std::gcd(step, static_cast<std::int64_t>(difference));
      if (step == 1) return 1.0;
    }
  return static_cast<double>(step);
}

double quantization_step(std::span<const float> pixels_dn) {
  const auto count = static_cast<int>(pixels_dn.size());
  return quantization_step(View<const float>(pixels_dn, 1, count, count));
}

double code_spacing(std::vector<float> pixels_dn) {
  constexpr double kPixelsPerCode = 20.0;
  std::sort(pixels_dn.begin(), pixels_dn.end());
  const auto quarter = static_cast<std::ptrdiff_t>(pixels_dn.size() / 4);
  const auto begin = pixels_dn.begin() + quarter, end = pixels_dn.end() - quarter;
  if (end - begin < 2) return 0.0;
  const double extent = double{*(end - 1)} - *begin;
  if (!(extent > 0) || static_cast<double>(end - begin) < kPixelsPerCode * extent) return 0.0;
  std::ptrdiff_t steps = 0;
  for (auto next = begin + 1; next != end; ++next) steps += *next != *(next - 1);
  return extent / static_cast<double>(steps);
}

double occupied_spacing(std::vector<float> pixels_dn) {
  constexpr std::ptrdiff_t kPixels = 20;
  std::sort(pixels_dn.begin(), pixels_dn.end());
  const auto outer = static_cast<std::ptrdiff_t>(pixels_dn.size() / 20);
  const auto end = pixels_dn.end() - outer;
  std::ptrdiff_t common = 0, codes = 0, last_common = 0;
  float first = 0, last = 0;
  for (auto at = pixels_dn.begin() + outer; at != end;) {
    const auto next = std::upper_bound(at, end, *at);
    ++codes;
    if (next - at >= kPixels) {
      if (common++ == 0) {
        first = *at;
        codes = 1;
      }
      last = *at;
      last_common = codes;
    }
    at = next;
  }
  if (common < 3) return 0.0;
  return (double{last} - first) / static_cast<double>(last_common - 1);
}

std::optional<double> left_out_code(std::vector<float> pixels_dn, double step) {
  constexpr double kShare = 0.05, kFewest = 100;
  if (!(step > 0)) return std::nullopt;
  std::sort(pixels_dn.begin(), pixels_dn.end());
  std::optional<double> left_out;
  double most = std::max(kShare * static_cast<double>(pixels_dn.size()), kFewest);
  double below = 0, before = 0;
  for (auto at = pixels_dn.begin(); at != pixels_dn.end();) {
    const auto next = std::upper_bound(at, pixels_dn.end(), *at);
    const auto here = static_cast<double>(next - at);
    if (const double fewer = std::min(here, below);
        fewer >= most && std::round((*at - before) / step) == 2.0) {
      most = fewer;
      left_out = before + step;
    }
    below = here;
    before = *at;
    at = next;
  }
  return left_out;
}

}  // namespace malus
