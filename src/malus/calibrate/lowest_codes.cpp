#include "malus/calibrate/internal/lowest_codes.h"

#include "malus/noise/calibration.h"

#include <algorithm>
#include <cmath>

namespace malus {

void LowestCodes::insert(float dn) {
  std::size_t at = 0;
  while (at < count_ && codes_[at].dn < dn) ++at;
  if (at < count_ && codes_[at].dn == dn) {
    ++codes_[at].pixels;
    return;
  }
  if (at == kKept || dn != dn) return;
  count_ = std::min(count_ + 1, kKept);
  for (std::size_t i = count_ - 1; i > at; --i) codes_[i] = codes_[i - 1];
  codes_[at] = {dn, 1};
}

bool LowestCodes::is_pile(double step_dn, double pixels) const {
  constexpr double kMoreThanExpected = 1.25, kErrors = 5.0, kFewest = 20;
  if (count_ < kKept) return false;
  for (std::size_t i = 0; i < kKept; ++i) {
    const double steps = (double{codes_[i].dn} - codes_[0].dn) / step_dn;
    if (std::abs(steps - static_cast<double>(i)) > 0.01) return false;  // a gap: stuck pixels
    if (static_cast<double>(codes_[i].pixels) < kFewest) return false;
  }
  const auto count = [&](std::size_t i) { return static_cast<double>(codes_[i].pixels); };
  if (!(count(0) > kMostSilentZeros * pixels)) return false;
  const double above = std::log(count(0)) -
                       (3 * std::log(count(1)) - 3 * std::log(count(2)) + std::log(count(3))),
               error = std::sqrt(1 / count(0) + 9 / count(1) + 9 / count(2) + 1 / count(3));
  return above > std::max(std::log(kMoreThanExpected), kErrors * error);
}

}  // namespace malus
