#include "malus/calibrate/internal/dark_codes.h"

#include "malus/base/index.h"

#include <algorithm>
#include <cmath>

namespace malus {

DarkCodes::DarkCodes(const MosaicGeometry& geometry, View<const float> frame_dn, double step_dn)
    : geometry_(geometry),
      step_dn_(step_dn),
      origin_dn_(std::fmod(frame_dn(0, 0), step_dn)),
      codes_(as_index(geometry.channels())) {}

void DarkCodes::add(View<const float> dn) {
  constexpr double kFarthest = 1 << 24;  // whole numbers are exact up to here
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c) {
      const double code = std::round((dn(r, c) - origin_dn_) / step_dn_);
      codes_[as_index(geometry_.channel(r, c))].at(
          static_cast<std::ptrdiff_t>(std::clamp(code, -kFarthest, kFarthest))) += 1.0;
    }
  ++frames_;
}

double& DarkCodes::Codes::at(std::ptrdiff_t code) {
  constexpr std::ptrdiff_t kAhead = 64;
  if (counts.empty()) first = code;
  if (code < first) {
    counts.insert(counts.begin(), as_index(first - code + kAhead), 0.0);
    first = code - kAhead;
  }
  if (as_index(code - first) >= counts.size()) counts.resize(as_index(code - first + kAhead), 0.0);
  return counts[as_index(code - first)];
}

std::vector<double> DarkCodes::occurred(int channel, std::int64_t& first_code) const {
  const auto& [first, counts] = codes_[as_index(channel)];
  const auto used = [](double n) { return n > 0; };
  const auto begin = std::find_if(counts.begin(), counts.end(), used);
  const auto end = std::find_if(counts.rbegin(), counts.rend(), used).base();
  first_code = first + (begin - counts.begin());
  return {begin, end};
}

}  // namespace malus
