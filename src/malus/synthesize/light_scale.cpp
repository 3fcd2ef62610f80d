#include "malus/synthesize/light_scale.h"

#include "malus/base/wording.h"
#include "malus/image/raw_frame.h"

#include <algorithm>
#include <cstdint>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

struct LightScale {
  std::int64_t finite = 0, brighter = 0;  // than white
  float least = std::numeric_limits<float>::infinity(), most = -least;

  bool too_dark() const { return most > 0 && most <= 1 && least < most; }
  bool too_bright() const {
    constexpr std::int64_t kOneOf = 10;
    return brighter * kOneOf > finite;
  }
  void add(const LightScale& other) {
    finite += other.finite;
    brighter += other.brighter;
    least = std::min(least, other.least);
    most = std::max(most, other.most);
  }
};

// Of every step-th pixel.
LightScale light_scale_of(View<const float> clean_dn, float white_dn, std::int64_t step) {
  LightScale scale;
  const std::int64_t cols = clean_dn.cols(), pixels = cols * clean_dn.rows();
  for (std::int64_t i = 0; i < pixels; i += step) {
    const float light = clean_dn(static_cast<int>(i / cols), static_cast<int>(i % cols));
    if (light - light != 0.0f) continue;
    ++scale.finite;
    scale.brighter += light > white_dn;
    scale.least = std::min(scale.least, light);
    scale.most = std::max(scale.most, light);
  }
  return scale;
}

}  // namespace

std::string light_scale_complaint(View<const float> clean_dn, double white_dn) {
  constexpr std::int64_t kLookedAt = 1024;
  if (clean_dn.empty() || !(white_dn > 1)) return "";
  const auto white = static_cast<float>(white_dn);
  // An odd step meets all channels of a cell.
  const std::int64_t pixels = std::int64_t{clean_dn.rows()} * clean_dn.cols(),
                     step = (pixels / kLookedAt) | 1;
  LightScale scale = light_scale_of(clean_dn, white, step);
  if (step > 1 && (scale.too_dark() || scale.too_bright()))
    scale = light_scale_of(clean_dn, white, 1);
  // Without the picture's own numbers: Python shows a warning of one text once.
  if (scale.too_dark())
    return fmt::format(
        "no pixel is brighter than 1 DN, where white is {:g} DN above black: light counts in DN; "
        "multiply a picture from 0 to 1 by its white",
        white_dn);
  if (scale.too_bright())
    return fmt::format(
        "more than a tenth of the pixels are brighter than white, {:g} DN above black: is their "
        "light in DN of this camera? It would show them saturated",
        white_dn);
  return "";
}

std::string picture_scale_complaint(const Planes& light, int bits, double exposure) {
  if (bits > 0) return "";
  // More exposure is what the caller wants; less may be what brings another scale to this one.
  const double white = 1 / std::min(exposure, 1.0);
  LightScale scale;
  for (const Image& plane : light)
    scale.add(light_scale_of(plane.view(), static_cast<float>(white), 1));
  if (!scale.too_bright()) return "";
  return fmt::format(
      "more than a tenth of the picture is brighter than white, which is 1 of float pixels; divide "
      "one of 0 to 255 or to 65535 by that, or lower {}",
      setting("exposure"));
}

double white_of_light_dn(const NoiseModel& model) {
  return model.white_dn > 0 ? white_above_black(model.white_dn, model.black_dn) : 0.0;
}

}  // namespace malus
