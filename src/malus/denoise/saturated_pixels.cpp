#include "malus/denoise/saturated_pixels.h"

#include "malus/denoise/estimate_noise.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

namespace malus {
namespace {

// The two largest values of a channel, and how many pixels have them.
struct Top {
  float top = -std::numeric_limits<float>::infinity(), below = top;
  std::int64_t at_top = 0, at_below = 0;

  void add(float v) {
    if (!std::isfinite(v) || v < below) return;
    if (v > top) {
      below = std::exchange(top, v);
      at_below = std::exchange(at_top, 0);
    } else if (v > below && v < top) {
      below = v;
      at_below = 0;
    }
    ++(v == top ? at_top : at_below);
  }

  bool is_pile() const {
    constexpr std::int64_t kPile = 4;  // times the pixels of the value below
    constexpr std::int64_t kLeast = kNoiseBlock * kNoiseBlock;  // fewer fill no block
    return at_below > 0 && at_top >= kLeast && at_top > kPile * at_below;
  }
};

}  // namespace

std::vector<float> piled_up_dn(View<const float> dn, const SensorLayout& layout) {
  std::vector<Top> tops(static_cast<std::size_t>(layout.channels()));
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c)
      tops[static_cast<std::size_t>(layout.channel_at(r, c))].add(dn(r, c));
  std::vector<float> piles_dn;
  for (const Top& channel : tops)
    piles_dn.push_back(channel.is_pile() ? channel.top : std::numeric_limits<float>::infinity());
  return piles_dn;
}

bool clips_at_white(const RawFrame& frame) {
  std::vector<float> piles_dn = piled_up_dn(frame.dn, frame.layout);
  std::erase_if(piles_dn, [](float dn) { return !std::isfinite(dn); });
  const auto white_dn = static_cast<float>(frame.white_dn);
  return !piles_dn.empty() &&
         std::count(piles_dn.begin(), piles_dn.end(), white_dn) == std::ssize(piles_dn);
}

}  // namespace malus
