// What the setting memory leaves for pixels, and one refusal for all methods.
#pragma once

namespace malus::internal {

inline constexpr double kBytesPerValue = 4;

struct MemoryBudget {
  double memory_mib;
  double held_values = 0;  ///< float32 values that are held while it is spent: they count in it

  /// What is left for frames, tiles and planes; the program itself takes its part. May be negative.
  double bytes() const;
  /// While these values are held, too.
  MemoryBudget holding(double values) const { return {memory_mib, held_values + values}; }
  /// The setting that leaves this many bytes beside what is held.
  double mib_for(double bytes) const;
  /// Throws InputError that says how much memory a frame of this size would need.
  [[noreturn]] void refuse(double needed_bytes, int rows, int cols) const;
};

}  // namespace malus::internal
