// Frames that a camera sent in vain, from the numbers that it gives its frames.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

namespace malus {

/// Counts the gaps in a camera's own numbers. GigE Vision counts 1 to 65535 and then 1 again (or in
/// 64 bits); USB3 Vision counts in 64 bits from 0. A step back that is no such turn (frames out of
/// order, a camera that began anew) is not a loss.
class LossCount {
 public:
  void add(std::uint64_t number) {
    if (last_) lost_ += between(*last_, number);
    last_ = number;
  }
  std::uint64_t lost() const { return lost_; }

 private:
  static constexpr std::uint64_t kTurn = 65535;  // numbers of a 16-bit count, which leaves out 0
  static std::uint64_t between(std::uint64_t last, std::uint64_t number) {
    if (number > last) return number - last - 1;
    const bool turned = last <= kTurn && last - number > kTurn / 2;
    return turned ? std::max<std::uint64_t>(number, 1) + kTurn - last - 1 : 0;
  }

  std::optional<std::uint64_t> last_;
  std::uint64_t lost_ = 0;
};

}  // namespace malus
