// Whether dark noise ends in a pile of pixels at its lowest code: there it is cut off.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace malus {

/// The four lowest codes of any number of pixels, with their counts.
class LowestCodes {
 public:
  void add(float dn) {
    if (count_ == kKept && dn > codes_[kKept - 1].dn) return;
    insert(dn);
  }
  int count() const { return static_cast<int>(count_); }
  /// Contract, of both: count() > 0.
  float lowest_dn() const { return codes_[0].dn; }
  std::int64_t at_lowest() const { return codes_[0].pixels; }
  /// Whether the lowest code holds more than a thousandth of these pixels, and by a quarter and
  /// five errors more than the next three lead to expect, a parabola through the logarithms of
  /// their counts. Where noise ends by itself, its lowest code has but a few pixels, unless it is
  /// narrower than some 0.6 steps; then the parabola bends down.
  bool is_pile(double step_dn, double pixels) const;

 private:
  static constexpr std::size_t kKept = 4;
  struct Code {
    float dn = 0;
    std::int64_t pixels = 0;
  };
  void insert(float dn);
  std::array<Code, kKept> codes_{};  ///< rising
  std::size_t count_ = 0;
};

}  // namespace malus
