#include "malus/denoise/internal/memory_budget.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <cmath>

#include <fmt/format.h>

namespace malus::internal {
namespace {

// Measured: at 1024 MiB the program with its libraries and buffers takes 45 MiB besides.
constexpr double kPixelShare = 0.92;

}  // namespace

double MemoryBudget::bytes() const {
  return kPixelShare * memory_mib * 0x1p20 - kBytesPerValue * held_values;
}

double MemoryBudget::mib_for(double bytes) const {
  return std::ceil((bytes + kBytesPerValue * held_values) / (kPixelShare * 0x1p20));
}

void MemoryBudget::refuse(double needed_bytes, int rows, int cols) const {
  throw InputError(
      setting_name("memory"),
      fmt::format("{:.0f} MiB is too little for a frame of {} x {} pixels", memory_mib, cols, rows),
      fmt::format("give at least {:.0f} MiB", mib_for(needed_bytes)));
}

}  // namespace malus::internal
