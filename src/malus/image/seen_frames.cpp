#include "malus/image/seen_frames.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cstring>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

bool has_one_value(const Image& dn) {
  constexpr double kOfPixels = 0.9;
  std::vector<float> sorted = dn.values();
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), middle, sorted.end());
  const auto equal = std::count(sorted.begin(), sorted.end(), *middle);
  return static_cast<double>(equal) >= kOfPixels * static_cast<double>(sorted.size());
}

}  // namespace

std::uint64_t pixel_fingerprint(const Image& dn) {
  const std::vector<float>& values = dn.values();
  std::uint64_t hash = values.size();
  for (std::size_t i = 0; i + 1 < values.size(); i += 2) {
    std::uint64_t two = 0;
    std::memcpy(&two, &values[i], sizeof two);
    hash = (hash ^ two) * 0x9e3779b97f4a7c15u;
    hash ^= hash >> 29;
  }
  std::uint32_t last = 0;
  if (!values.empty()) std::memcpy(&last, &values.back(), sizeof last);
  return (hash ^ last) * 0x9e3779b97f4a7c15u;
}

void SeenFrames::refuse_copy(const RawFrame& frame, std::uint64_t fingerprint) {
  const auto [seen, is_new] = sources_.emplace(fingerprint, frame.source);
  if (is_new || has_one_value(frame.dn)) return;
  throw InputError(frame.source, fmt::format("has the same pixels as {}", seen->second),
                   "frames of one set are taken one by one: remove the copy");
}

}  // namespace malus
